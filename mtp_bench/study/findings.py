"""Everything that a study measured: scores of all settings, the report over them, and means of any targets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..running.compare import AtThreshold, scores_of
from ..running.settings import Setting
from ..scoring import AgentScores, Ends, Reference, Report, summarise
from ..scoring.causes import causes
from ..scoring.report import paired_row
from ..scoring.rows import Details, PairedRow, Row
from ..scoring.statistics import bootstrap_interval, ratio
from ..scoring.subsets import Subset
from ..scoring.table import AgentTable
from ..types import Bools, Floats, Ints
from .plan import Plan, Subject, key_of
from .runs import Bench, Measured
from .speed import Speed


class Mean(NamedTuple):
    """A mean over some targets, with its interval (95 %) over resampled units."""

    value: float | None
    low: float | None
    high: float | None
    targets: int
    objects: int


@dataclass(frozen=True, eq=False)
class Findings:
    """What a study measured; every number comes from `mtp_bench.scoring`."""

    bench: Bench
    plan: Plan
    reference: Reference
    measured: dict[str, Measured]  # by `key_of`
    speed: tuple[Speed, ...] = ()  # of the subject
    cuts: tuple[AtThreshold, ...] = ()  # of the input

    @property
    def subject(self) -> Subject:
        """The agent that the story is about: the first."""
        return self.plan.subjects[0]

    def of(self, setting: Setting) -> Measured:
        """What was measured of a setting."""
        return self.measured[key_of(setting)]

    @cached_property
    def tables(self) -> dict[str, AgentTable]:
        """Targets of every setting with or without sampling, by `key_of`."""
        keys = [key_of(setting) for setting in [*self.plan.equal, *self.plan.free]]
        return dict(zip(keys, self.report.tables, strict=True))

    def table(self, setting: Setting) -> AgentTable:
        """The targets of a setting."""
        return self.tables[key_of(setting)]

    @cached_property
    def report(self) -> Report:
        """The report over all settings, with the ends of every subject."""
        settings = [*self.plan.equal, *self.plan.free]
        ends = {
            self.of(subject.equal[count]).setting.label: Ends(self._scores(subject.end), self._scores(subject.truth))
            for subject in self.plan.subjects
            if subject.own_ends
            for count in subject.equal
        }
        return summarise([self._scores(s) for s in settings], self.bench.card, self.reference, own_ends=ends)

    def row(self, setting: Setting, subset: Subset) -> Row:
        """The row of the report."""
        own = self._scores(setting)
        who = own.agent, own.hypotheses, own.samples, own.budget, subset
        return next(r for r in self.report.rows if (r.agent, r.hypotheses, r.samples, r.budget, r.subset) == who)

    def details(self, setting: Setting) -> Details:
        """The details of the report."""
        own = self._scores(setting)
        who = own.agent, own.hypotheses, own.samples, own.budget
        return next(d for d in self.report.details if (d.agent, d.hypotheses, d.samples, d.budget) == who)

    def difference(self, setting: Setting, other: Setting, subset: Subset) -> PairedRow:
        """A setting minus another one: what ranks, and minADE where both cover a target."""
        return paired_row(self.table(setting), self.table(other), subset)

    def _scores(self, setting: Setting) -> AgentScores:
        measured = self.of(setting)
        return scores_of(setting, measured.scores, measured.setting.label)  # equal runs have one name in the report

    def mean(self, table: AgentTable, value: Floats, weight: Floats | Bools) -> Mean:
        """Mean of ``value`` [n] over targets by their ``weight`` [n]."""
        share = np.asarray(weight, dtype=np.float64)
        top, whole = table.per_unit(np.asarray(value, dtype=np.float64), share), table.unit_weight(share)
        low, high = bootstrap_interval(top, whole) or (None, None)
        some = share > 0
        return Mean(ratio(top.sum(), whole.sum()), low, high, int(some.sum()), len(np.unique(table.person[some])))

    def covered_mean(self, table: AgentTable, summed: Floats, weight: Floats | Bools) -> Mean:
        """Mean over targets with a forecast, of what is ``summed`` [n] over the seeds that have one."""
        mean = np.divide(summed, table.covered, out=np.zeros(len(summed)), where=table.covered > 0)
        return self.mean(table, mean, weight * table.covered)

    def causes(self, subject: Subject, setting: Setting, subset: Subset = "all") -> Floats:
        """Parts [len(CAUSES), n], m, of the number that ranks on a subset, per target."""
        table, measured = self.table(setting), self.of(setting)
        from_truth = self.table(subject.truth).capped
        switched = table.weight["ids"] > 0
        return causes(measured.scores, measured.around, table.budgets, from_truth, switched, subset != "all")

    def since(self, kind: str) -> Ints:
        """Frames since the last event of this kind of the subject with one hypothesis (first seed) [n]; -1 none yet."""
        near = self.of(self.subject.single).around[0]
        return np.concatenate([scene.since[kind] for scene in near])
