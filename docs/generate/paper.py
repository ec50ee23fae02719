"""Relations between agents in the tables of the paper, and on the leaderboard."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mtp_bench.core import Column, Table, Value
from mtp_bench.scoring.definitions import Subset
from mtp_bench.viz.board.entries import Entry, by_board

_TARGET_NAMES: dict[Subset, str] = {
    "paper_ids": "IDS",
    "paper_frag": "FRAG",
    "all": "all",
}
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


_TRUTH_PAIR = ("stp", "gt_tracks")  # k samples each
_HYPOTHESES_PAIR = ("stp", "mtp")
RELATIONS = (  # Weng, Ivanovic, Pavone: MTP, 2022
    Relation("I", "KITTI", "paper_ids", _TRUTH_PAIR, (2.820, 0.100)),
    Relation("I", "KITTI", "paper_frag", _TRUTH_PAIR, (1.621, 0.177)),
    Relation("I", "nuScenes", "paper_ids", _TRUTH_PAIR, (8.345, 0.473)),
    Relation("I", "nuScenes", "paper_frag", _TRUTH_PAIR, (14.520, 0.621)),
    Relation("II", "KITTI", "paper_ids", _HYPOTHESES_PAIR, (2.820, 0.747)),
    Relation("II", "KITTI", "paper_frag", _HYPOTHESES_PAIR, (1.621, 1.335)),
    Relation("II", "nuScenes", "paper_ids", _HYPOTHESES_PAIR, (8.345, 3.923)),
    Relation("II", "nuScenes", "paper_frag", _HYPOTHESES_PAIR, (14.520, 8.476)),
    Relation("III", "KITTI", "all", _HYPOTHESES_PAIR, (0.185, 0.162)),
    Relation("III", "nuScenes", "all", _HYPOTHESES_PAIR, (2.320, 1.585)),
    Relation("V", "WILDTRACK", "all", _HYPOTHESES_PAIR, (1.024, 0.852)),
)


def paper_table(entries: Sequence[Entry]) -> Table:
    """Return the paper's relations beside those of the records.

    `RELATIONS` without records of their agents and of the control have no row.
    """
    envs: dict[str, dict[str, Entry]] = defaultdict(dict)
    for listed in by_board(entries).values():
        env = listed[0].env
        if env not in envs:
            envs[env] = {entry.name: entry for entry in listed}
    rows = []
    for relation in RELATIONS:
        agents = envs[_ENVS[relation.data]]
        if {*relation.agents, _CONTROL} <= agents.keys():
            rows.append(_row(relation, agents))
    columns = [
        Column(key="table"),
        Column("environment", key="env"),
        Column(key="targets"),
        Column(key="to"),
        Column(key="paper", format="+.0%"),
        Column(key="here", format="+.0%"),
        Column("samples alone", key="control", format="+.0%"),
        Column("here, with PTP", key="ptp", format="+.0%"),
        *_difference_columns("bADE to `stp`", "difference"),
        *_difference_columns("bADE beyond the samples", "beyond"),
        *_difference_columns("bADE with PTP", "with_ptp"),
        Column("effective objects", key="objects", format=".1f"),
    ]
    return Table("paper", "Relations of the paper", "", rows, columns)


def _difference_columns(heading: str, key: str) -> tuple[Column, Column]:
    """Return the columns of a difference and of its interval."""
    return (
        Column(heading, "m", key=key, format="+.2f"),
        Column(key=f"{key}_interval", format="+.2f", interval=True),
    )


def _row(relation: Relation, agents: Mapping[str, Entry]) -> dict[str, Value]:
    """Return the row of a relation; ``agents``: entries of its environment."""
    subset = relation.subset
    first, second = (agents[name] for name in relation.agents)
    first_ptp, second_ptp = (agents.get(_WITH_PTP[name]) for name in relation.agents)
    control = None  # of hypotheses
    if relation.agents == _HYPOTHESES_PAIR:
        control = agents[_CONTROL]
    return {
        "table": relation.table,
        "env": first.env,
        "targets": _TARGET_NAMES[subset],
        "to": f"`{relation.agents[1]}`",
        "paper": relation.values[1] / relation.values[0] - 1,
        "here": _change(first, second, subset),
        "control": _change(first, control, subset),
        "ptp": _change(first_ptp, second_ptp, subset),
        **_difference("difference", first, second, subset),
        **_difference("beyond", control, second, subset),
        **_difference("with_ptp", first_ptp, second_ptp, subset),
        "objects": first.row_of(subset).effective_objects,
    }


def _change(first: Entry | None, second: Entry | None, subset: Subset) -> Value:
    """Return the relative change of minADE from the first to the second agent."""
    if first is None or second is None:
        return None
    first_m = first.row_of(subset).minADE
    second_m = second.row_of(subset).minADE
    return second_m / first_m - 1 if first_m and second_m else None


def _difference(
    key: str, first: Entry | None, second: Entry | None, subset: Subset
) -> dict[str, Value]:
    """Return bADE of the second agent less that of the first, with the interval."""
    if first is None or second is None or first.conditions != second.conditions:
        return {}
    difference = second.minus(first, subset)
    if difference is None:
        return {}
    return {key: difference.mean, f"{key}_interval": difference.interval}
