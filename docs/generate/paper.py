"""Relations between agents in the tables of the paper, and on the leaderboard."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.rows import Row
from mtp_bench.tables import Column, Table, Value
from mtp_bench.viz.board.entries import Entry, by_board

_TARGETS: dict[Subset, str] = {"paper_ids": "IDS", "paper_frag": "FRAG", "all": "all"}
_ENVS = {"KITTI": "MTP-KITTI-noego-v0", "nuScenes": "MTP-nuScenes-v0", "WILDTRACK": "MTP-WILDTRACK-v0"}
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

    def row(self, known: dict[str, Entry], agent: str) -> Row:
        """Row of an agent on the targets of the relation."""
        return known[agent].row_of(self.subset)


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
        Column("paper", key="paper", format="+.0%", read=lambda row: row[0].values[1] / row[0].values[0] - 1),
        Column("here", key="here", format="+.0%", read=lambda row: _change(row, row[0].agents[1])),
        Column("samples alone", key="control", format="+.0%", read=lambda row: _change(row, _CONTROL)),
        Column("here, with PTP", key="ptp", format="+.0%", read=_change_with_ptp),
        Column("bADE to `stp`", "m", key="difference", format="+.2f", read=_difference("mean")),
        Column(interval=True, key="difference_interval", format="+.2f", read=_difference("interval")),
        Column("bADE beyond the samples", "m", key="beyond", format="+.2f", read=_difference("mean", _CONTROL)),
        Column(interval=True, key="beyond_interval", format="+.2f", read=_difference("interval", _CONTROL)),
        Column("bADE with PTP", "m", key="with_ptp", format="+.2f", read=_difference_with_ptp("mean")),
        Column(interval=True, key="with_ptp_interval", format="+.2f", read=_difference_with_ptp("interval")),
        Column("effective objects", key="objects", format=".1f", read=_effective_objects),
    ]
    return Table("paper", "Relations of the paper", "", rows, columns)


def _effective_objects(row: tuple[Relation, dict[str, Entry]]) -> Value:
    return row[0].row(row[1], "stp").effective_objects


def _change(row: tuple[Relation, dict[str, Entry]], agent: str) -> Value:
    """Change of minADE from `stp` to another agent."""
    relation, known = row
    if (agent, relation.agents) == (_CONTROL, _GIVEN):
        return None  # a control of hypotheses
    return _change_between(relation.row(known, "stp").minADE, relation.row(known, agent).minADE)


def _change_with_ptp(row: tuple[Relation, dict[str, Entry]]) -> Value:
    """Change of minADE between the two agents of a relation where both forecast with PTP."""
    pair = _both_with_ptp(row)
    return None if pair is None else _change_between(*(entry.row_of(row[0].subset).minADE for entry in pair))


def _change_between(one: float | None, other: float | None) -> Value:
    return other / one - 1 if one and other else None


def _both_with_ptp(row: tuple[Relation, dict[str, Entry]]) -> tuple[Entry, Entry] | None:
    relation, known = row
    one, other = (known.get(_WITH_PTP[agent]) for agent in relation.agents)
    return (one, other) if one is not None and other is not None else None


def _difference_with_ptp(name: str) -> Callable[[tuple[Relation, dict[str, Entry]]], Value]:
    """A field of the difference of bADE between the two agents of a relation where both forecast with PTP."""

    def read(row: tuple[Relation, dict[str, Entry]]) -> Value:
        pair = _both_with_ptp(row)
        return None if pair is None else getattr(pair[1].minus(pair[0], row[0].subset), name, None)

    return read


def _difference(name: str, less: str = "stp") -> Callable[[tuple[Relation, dict[str, Entry]]], Value]:
    """A field of the difference of bADE to the agent ``less``."""

    def read(row: tuple[Relation, dict[str, Entry]]) -> Value:
        relation, known = row
        if (less, relation.agents) == (_CONTROL, _GIVEN):
            return None
        one, other = known[relation.agents[1]], known[less]
        return getattr(one.minus(other, relation.subset), name, None) if one.conditions == other.conditions else None

    return read
