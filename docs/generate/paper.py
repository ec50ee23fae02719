"""Relations between agents in the tables of the paper, and on the leaderboard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from mtp_bench.core import Column, Table, Value
from mtp_bench.scoring.definitions import Subset
from mtp_bench.viz.board.entries import Entry, by_board

_TARGETS: dict[Subset, str] = {"paper_ids": "IDS", "paper_frag": "FRAG", "all": "all"}
_ENVS = {
    "KITTI": "MTP-KITTI-noego-v0",
    "nuScenes": "MTP-nuScenes-v0",
    "WILDTRACK": "MTP-WILDTRACK-v0",
}
_CONTROL = "stp_same_samples"
_WITH_PTP = {"stp": "stp_ptp", "gt_tracks": "gt_tracks_ptp", "mtp": "mtp_ptp"}


@dataclass(frozen=True)
class Relation:
    """Change of minADE from one agent to another in a table of the paper."""

    table: str
    data: str
    subset: Subset
    agents: tuple[str, str]
    values: tuple[float, float]  # m, minADE of these agents in the paper


Names = tuple[str, str]  # of two agents
Pair = Callable[[Relation], Names | None]
RelationRow = tuple[
    Relation, dict[str, Entry]
]  # with the entries of its environment by name

_GIVEN, _KEPT = ("stp", "gt_tracks"), ("stp", "mtp")  # k samples each
RELATIONS = (  # Weng, Ivanovic, Pavone: MTP, 2022
    Relation("I", "KITTI", "paper_ids", _GIVEN, (2.820, 0.100)),
    Relation("I", "KITTI", "paper_frag", _GIVEN, (1.621, 0.177)),
    Relation("I", "nuScenes", "paper_ids", _GIVEN, (8.345, 0.473)),
    Relation("I", "nuScenes", "paper_frag", _GIVEN, (14.520, 0.621)),
    Relation("II", "KITTI", "paper_ids", _KEPT, (2.820, 0.747)),
    Relation("II", "KITTI", "paper_frag", _KEPT, (1.621, 1.335)),
    Relation("II", "nuScenes", "paper_ids", _KEPT, (8.345, 3.923)),
    Relation("II", "nuScenes", "paper_frag", _KEPT, (14.520, 8.476)),
    Relation("III", "KITTI", "all", _KEPT, (0.185, 0.162)),
    Relation("III", "nuScenes", "all", _KEPT, (2.320, 1.585)),
    Relation("V", "WILDTRACK", "all", _KEPT, (1.024, 0.852)),
)


def paper_table(entries: Sequence[Entry]) -> Table:
    """Relations of the paper beside those of the records: a row for each of `RELATIONS` with records and targets."""
    known: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        known.setdefault(listed[0].env, {entry.name: entry for entry in listed})
    rows = [(relation, known.get(_ENVS[relation.data], {})) for relation in RELATIONS]
    rows = [row for row in rows if {*row[0].agents, _CONTROL} <= {*row[1]}]
    columns = [
        Column("table", key="table", read=lambda row: row[0].table),
        Column("environment", key="env", read=lambda row: row[1]["stp"].env),
        Column("targets", key="targets", read=lambda row: _TARGETS[row[0].subset]),
        Column("to", key="to", read=lambda row: f"`{row[0].agents[1]}`"),
        Column(
            "paper",
            key="paper",
            format="+.0%",
            read=lambda row: row[0].values[1] / row[0].values[0] - 1,
        ),
        Column("here", key="here", format="+.0%", read=_change(_as_in_the_paper)),
        Column(
            "samples alone", key="control", format="+.0%", read=_change(_samples_alone)
        ),
        Column("here, with PTP", key="ptp", format="+.0%", read=_change(_with_ptp)),
        *_difference("bADE to `stp`", "difference", _as_in_the_paper),
        *_difference("bADE beyond the samples", "beyond", _beyond_the_samples),
        *_difference("bADE with PTP", "with_ptp", _with_ptp),
        Column(
            "effective objects", key="objects", format=".1f", read=_effective_objects
        ),
    ]
    return Table("paper", "Relations of the paper", "", rows, columns)


def _as_in_the_paper(relation: Relation) -> Names:
    return relation.agents


def _samples_alone(relation: Relation) -> Names | None:
    return (
        (relation.agents[0], _CONTROL) if relation.agents == _KEPT else None
    )  # a control of hypotheses


def _beyond_the_samples(relation: Relation) -> Names | None:
    return (_CONTROL, relation.agents[1]) if relation.agents == _KEPT else None


def _with_ptp(relation: Relation) -> Names:
    one, other = relation.agents
    return _WITH_PTP[one], _WITH_PTP[other]


def _effective_objects(row: RelationRow) -> Value:
    return row[1]["stp"].row_of(row[0].subset).effective_objects


def _change(names: Pair) -> Callable[[RelationRow], Value]:
    """Change of minADE from the first of two agents to the second."""

    def read(row: RelationRow) -> Value:
        entries = _entries(names, row)
        one, other = (
            (entry.row_of(row[0].subset).minADE for entry in entries)
            if entries
            else (None, None)
        )
        return other / one - 1 if one and other else None

    return read


def _difference(heading: str, key: str, names: Pair) -> list[Column]:
    """Columns of bADE of the second of two agents less that of the first, with the interval."""

    def read(field: str, row: RelationRow) -> Value:
        one, other = _entries(names, row) or (None, None)
        if one is None or other is None or one.conditions != other.conditions:
            return None
        return getattr(other.minus(one, row[0].subset), field, None)

    return [
        Column(heading, "m", key=key, format="+.2f", read=partial(read, "mean")),
        Column(
            interval=True,
            key=f"{key}_interval",
            format="+.2f",
            read=partial(read, "interval"),
        ),
    ]


def _entries(names: Pair, row: RelationRow) -> list[Entry] | None:
    """The entries of two agents; None if one has none, or the relation has no such pair."""
    relation, known = row
    found = [known[name] for name in names(relation) or () if name in known]
    return found if len(found) == 2 else None
