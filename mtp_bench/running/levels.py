"""Agents over the strength of one error of the detector: a comparison at each level."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..agent import controls
from ..cards import PerturbSection
from ..core import (
    Column,
    Section,
    Table,
    columns_of,
)
from ..scoring import (
    DEFINITIONS,
    SIGNIFICANT,
    SUBSET_NAMES,
    IntervalColumn,
    PairedDifference,
    Subset,
    data_frame,
    numbers_of,
    paired_difference,
)
from .detector_rows import DetectorRow

LEVELS = {  # of each knob of `PerturbSection`
    "score": (0.0, 0.1, 0.2, 0.3, 0.5),
    "misses": (0.0, 1.0, 2.0, 4.0),
    "false": (0.0, 1.0, 2.0, 4.0),
    "noise": (0.0, 0.5, 1.0, 2.0, 4.0),
    "delay": (0.0, 0.5, 1.0, 2.0),
}
SUBSETS_SHOWN: tuple[Subset, ...] = ("all", "ids")
SINGLE, _SAME, _NEIGHBOURS, _ASSOCIATED = CONTROLS = tuple(
    controls()[role]
    for role in ("single", "same_samples", "neighbours", "associated_same_samples")
)
_SENTENCE = (
    "Below a number: 95 % interval. Differences are to stp and to controls; a gain of "
    "hypotheses must exceed those of same samples and of neighbours."
)


class LevelRow(Section):
    """An agent at a level of a knob, on a subset of the targets."""

    level: Annotated[float, Column(format="g", help="Of the knob.")]
    agent: Annotated[str, Column(help="Name of the submission.")]
    subset: Subset
    value: Annotated[float, Column(help="bADE in m; in a closed loop the drive score.")]
    interval: IntervalColumn
    # of the units: the value times the weight, and the weight
    sums: list[float]
    weights: list[float]
    switches: Annotated[
        float | None,
        Column("IDS", format=".1f", optional=True, help="Per 100 true boxes."),
    ] = None
    effective_objects: float | None = None


class Level(Section):
    """Numbers at a level; ``key``: digest of all that they depend on."""

    key: str
    detector: DetectorRow | None
    rows: list[LevelRow]


class Leader(NamedTuple):
    """The best agent at a level; ``is_ahead``: significantly before the next one."""

    level: float
    agent: str
    is_ahead: bool


@dataclass(frozen=True, repr=False)
class Robustness:
    """Agents at the levels of a knob.

    ``agents``: those that were asked for and are not shown the truth; ``several``: of
    these, those with several hypotheses.
    """

    env: str
    knob: str
    agents: tuple[str, ...]
    several: tuple[str, ...]
    levels: tuple[Level, ...]
    is_drive: bool

    @property
    def rows(self) -> list[LevelRow]:
        """Rows of all levels, agents and subsets."""
        return [row for level in self.levels for row in level.rows]

    def on(self, subset: str) -> list[LevelRow]:
        """Return the rows on a subset."""
        return [row for row in self.rows if row.subset == subset]

    def difference(
        self, row: LevelRow, agent: str | None = None, level: float | None = None
    ) -> PairedDifference | None:
        """Return a row less that of another agent or level, by unit.

        None: the same row, or no such one.
        """
        key = (agent or row.agent, row.level if level is None else level)
        for other in self.on(row.subset):
            if other is not row and (other.agent, other.level) == key:
                return paired_difference(row.sums, other.sums, row.weights)
        return None

    @property
    def recorded(self) -> float:
        """Level of the detections as recorded."""
        return float(getattr(PerturbSection(), self.knob))

    def table(self, subset: Subset | None = None) -> Table:
        """Return the rows, or those of a subset, with differences to controls."""
        rows = self.rows if subset is None else self.on(subset)
        name = "" if subset is None else f": {SUBSET_NAMES[subset]}"
        subsets = [Column(key="subset")] if subset is None else []
        columns = [
            *columns_of(LevelRow),
            *subsets,
            *_columns(
                "recorded", lambda row: self.difference(row, None, self.recorded)
            ),
            *_columns("stp", lambda row: self.difference(row, SINGLE)),
            *_columns("same samples", lambda row: self.difference(row, _SAME)),
            *_columns("neighbours", lambda row: self.difference(row, _NEIGHBOURS)),
            *_columns("associated", lambda row: self.difference(row, _ASSOCIATED)),
        ]
        title = f"{self.env}, {self.knob}{name}"
        return Table(subset or "robustness", title, _SENTENCE, rows, columns)

    @property
    def tables(self) -> list[Table]:
        """Tables of the subsets, and of the detector."""
        tables = [self.table(subset) for subset in SUBSETS_SHOWN if self.on(subset)]
        detector = [level.detector for level in self.levels if level.detector]
        if detector:
            title = f"{self.env}, {self.knob}: detections"
            tables.append(Table("detector", title, "", detector))
        return tables

    @property
    def mean_relative(self) -> dict[str, float]:
        """Mean over levels of each agent's value by that of stp."""
        stp = {row.level: row.value for row in self.on("all") if row.agent == SINGLE}
        ratios: dict[str, list[float]] = {}
        for row in self.on("all"):
            if stp[row.level] > 0:  # a drive score may be 0
                ratios.setdefault(row.agent, []).append(row.value / stp[row.level])
        return {agent: float(np.mean(each)) for agent, each in ratios.items()}

    @property
    def leaders(self) -> list[Leader]:
        """The best agent at each level."""
        agents = (*self.agents, SINGLE)
        leaders = []
        for level in self.levels:
            rows = [
                row for row in level.rows if row.agent in agents and row.subset == "all"
            ]
            rows.sort(key=lambda row: row.value, reverse=self.is_drive)
            best, *others = rows
            lead = self.difference(best, others[0].agent) if others else None
            is_ahead = lead is not None and lead.significant
            leaders.append(Leader(best.level, best.agent, is_ahead))
        return leaders

    @property
    def answer(self) -> str:
        """Sentences: the best agent by level, and gains of hypotheses beyond the controls."""
        parts = []
        for agent, leaders in groupby(self.leaders, key=attrgetter("agent")):
            same_agent = list(leaders)
            part = f"{agent} at {_listed([leader.level for leader in same_agent])}"
            sure = [leader.level for leader in same_agent if leader.is_ahead]
            if sure:
                part += (
                    f" (before the next with p < {SIGNIFICANT:g} at {_listed(sure)})"
                )
            parts.append(part)
        name = "Highest drive score" if self.is_drive else "Lowest bADE"
        order = f"{name} by {self.knob}: {', then '.join(parts)}."
        return " ".join([order, *map(self._gain, self.several)])

    def _gain(self, agent: str) -> str:
        gains = []
        for row in self.on("ids"):
            controls = (self.difference(row, name) for name in (_SAME, _NEIGHBOURS))
            if row.agent == agent and all(
                each is not None and each.mean < 0 and each.significant
                for each in controls
            ):
                gains.append(row.level)
        where = _listed(gains) if gains else "no level"
        return (
            f"On identity switches {agent} gains beyond same samples and neighbours "
            f"(p < {SIGNIFICANT:g}) at {where}."
        )

    def to_frame(self) -> Any:
        """Return the rows as a DataFrame.

        Raises MtpBenchError without pandas.
        """
        return data_frame(self.table().records)

    def to_json(self) -> dict[str, Any]:
        """Return all numbers, the answer and `mean_relative` as plain values."""
        return {
            "env": self.env,
            "definitions": DEFINITIONS,
            "knob": self.knob,
            "answer": self.answer,
            "mean_relative": self.mean_relative,
            "rows": self.table().records,
            "levels": [level.model_dump(mode="json") for level in self.levels],
        }

    def __repr__(self) -> str:
        return self.answer


def _columns(
    name: str, find: Callable[[LevelRow], PairedDifference | None]
) -> Iterator[Column]:
    """Yield the columns of a difference, its interval and its p."""
    key = name.replace(" ", "_")
    numbers = (lambda row, i=i: numbers_of(find(row))[i] for i in range(3))
    mean, interval, p = numbers
    yield Column(
        f"to {name}", "", "", "+.3f", optional=True, key=f"to_{key}", read=mean
    )
    yield Column(optional=True, interval=True, key=f"to_{key}_interval", read=interval)
    yield Column("p", format=".3f", optional=True, key=f"to_{key}_p", read=p)


def _listed(levels: Sequence[float]) -> str:
    *first, last = (f"{level:g}" for level in levels)
    return f"{', '.join(first)} and {last}" if first else last
