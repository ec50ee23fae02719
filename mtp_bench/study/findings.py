"""Everything that a study has measured: scores of all settings, and the report over them."""

from dataclasses import dataclass
from functools import cached_property

from ..running.compare import scores_of
from ..running.settings import Setting, references_of
from ..scoring import AgentScores, Reference, References, Report, summarise
from ..scoring.definitions import RANKED_UNITS, Subset
from ..scoring.report import paired_row
from ..scoring.rows import PairedRow, Row
from ..scoring.table import AgentTable
from .plan import StudiedAgent, StudyPlan, key_of
from .runs import Bench, Measured


@dataclass(frozen=True, eq=False)
class Findings:
    """Results of a study; every number comes from the scorer."""

    bench: Bench
    plan: StudyPlan
    reference: Reference
    measured: dict[str, Measured]  # by `key_of`

    @property
    def subject(self) -> StudiedAgent:
        """The main agent of the study: the first one that was named."""
        return self.plan.subjects[0]

    @cached_property
    def units(self) -> float:
        """Effective number of units of all targets."""
        return self.row(self.subject.single, "all").effective_units

    @property
    def few(self) -> bool:
        """True with fewer effective units than a rank needs: no difference between agents can be told."""
        return self.units < RANKED_UNITS

    def of(self, setting: Setting) -> Measured:
        """Runs and scores of a setting."""
        return self.measured[key_of(setting)]

    @cached_property
    def tables(self) -> dict[str, AgentTable]:
        """Targets of every setting, by `key_of`."""
        keys = [key_of(setting) for setting in [*self.plan.equal, *self.plan.free]]
        return dict(zip(keys, self.report.tables, strict=True))

    def table(self, setting: Setting) -> AgentTable:
        """Targets of a setting."""
        return self.tables[key_of(setting)]

    @cached_property
    def report(self) -> Report:
        """The report over all settings, with the references of every subject and of controls."""
        found = [(each, references_of(each, self.bench.card)) for each in self.plan.controls]
        found = [(each, runs) for each, runs in found if all(key_of(run) in self.measured for run in runs.values())]
        found += [(s.equal[count], runs) for s in self.plan.subjects for count, runs in s.references.items()]
        own = {
            self.of(setting).setting.label: References(**{name: self._scores(run) for name, run in runs.items()})
            if runs
            else None
            for setting, runs in found
        }
        settings = [*self.plan.equal, *self.plan.free]
        return summarise([self._scores(s) for s in settings], self.bench.card, self.reference, references=own)

    def row(self, setting: Setting, subset: Subset) -> Row:
        """Row of the report for a setting and a subset."""
        own = self._scores(setting)
        key = own.agent, own.hypotheses, own.samples, own.budget, subset
        return next(r for r in self.report.rows if (r.agent, r.hypotheses, r.samples, r.budget, r.subset) == key)

    def difference(self, setting: Setting, other: Setting, subset: Subset) -> PairedRow:
        """A setting minus another one: bADE, and minADE over targets that both cover."""
        return paired_row(self.table(setting), self.table(other), subset)

    def _scores(self, setting: Setting) -> AgentScores:
        measured = self.of(setting)
        return scores_of(setting, measured.scores, measured.setting.label)  # equal runs have one name in the report
