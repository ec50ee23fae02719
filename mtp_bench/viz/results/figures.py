"""The figures that a template can ask for, each by agent, environment and subset of the targets.

Numbers of one agent are those of its record. What compares agents comes from the sums per unit of their records, by
the functions of the scorer.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ...errors import RecordError
from ...records.attestation import LEVELS
from ...records.ranking import STP, TRUTH, difference_of, own_ends
from ...scoring.rank import why_not_on
from ...scoring.statistics import gap_closed, kendall_tau, order_agreement, share_interval
from ...types import Floats
from ..board.entries import LEVEL_TEXT
from ..terminal.paper import PAPER_SUBSETS, figures_of
from .figure import Figure, Kind
from .known import Known, Scored, subset_of


class Figures:
    """Figures of known records."""

    def __init__(self, known: Known) -> None:
        self._known = known

    def error(self, agent: str, env: str, subset: str = "all") -> Figure:
        """What ranks, metres, with its interval."""
        row = self._known.of(agent, env).row(subset)
        return self._of("error", agent, env, subset, row.error, interval=row.interval)

    def plain(self, agent: str, env: str, subset: str = "all") -> Figure:
        """The plain error, metres: every forecast is kept, and no forecast costs c."""
        return self._of_row("plain error", "plain_error", agent, env, subset)

    def missed(self, agent: str, env: str, subset: str = "all") -> Figure:
        """The part of the error from targets without a forecast, metres."""
        return self._of_row("missed part of the error", "missed", agent, env, subset)

    def min_ade(self, agent: str, env: str, subset: str = "all") -> Figure:
        """MinADE, metres, over targets that have a forecast."""
        return self._of_row("minADE", "minADE", agent, env, subset)

    def min_fde(self, agent: str, env: str, subset: str = "all") -> Figure:
        """MinFDE, metres, over targets that have a forecast."""
        return self._of_row("minFDE", "minFDE", agent, env, subset)

    def coverage(self, agent: str, env: str, subset: str = "all") -> Figure:
        """Share of the targets that have a forecast."""
        return self._of_row("coverage", "coverage", agent, env, subset, "share")

    def ms(self, agent: str, env: str) -> Figure:
        """Milliseconds per frame, mean."""
        value = self._known.of(agent, env).record.measured.ms_per_frame
        return self._of("time per frame", agent, env, "all", value, "time")

    def silence(self, env: str, agent: str = STP) -> Figure:
        """What an agent that says nothing scores, metres; the record of ``agent`` knows it."""
        return self._of("silence beside the record", agent, env, "all", self._known.of(agent, env).sums.silence)

    def rank(self, agent: str, env: str, subset: str = "all") -> Figure:
        """Its rank; RecordError where it has none."""
        place = self._known.of(agent, env).place(subset)
        if place.rank is None:
            raise RecordError(f"{_named('rank', agent, env, subset)}: none ({place.why})")
        return Figure(_named("rank", agent, env, subset), place.rank, "count")

    def ranked(self, agent: str, env: str, subset: str = "all") -> bool:
        """Whether it has a rank."""
        return self._known.of(agent, env).place(subset).rank is not None

    def why_unranked(self, env: str, subset: str = "all", agent: str = STP) -> str:
        """Why nobody can be ranked on a subset, in a few words; empty where agents are."""
        sums, row = self._known.of(agent, env).sums, self._known.of(agent, env).row(subset)
        return why_not_on(subset, row.effective_objects, sums.unit_weight(subset_of(subset))) or ""

    def difference(self, agent: str, other: str, env: str, subset: str = "all") -> Figure:
        """Error of ``agent`` less that of ``other``, metres, with its interval and p; below 0 ``agent`` is better."""
        one, second = self._known.beside(env, agent, other)
        on = subset_of(subset)
        found = difference_of(one, second, on)
        value, interval, p = found or (None, None, None)
        return self._of("error", f"{agent} less {other}", env, subset, value, interval=interval, p=p)

    def gain(self, agent: str, other: str, env: str, subset: str = "all") -> Figure:
        """How much smaller the error of ``agent`` is than that of ``other``, metres, with its interval and p."""
        found = self.difference(other, agent, env, subset)
        of = _named("gain", f"{agent} over {other}", env, subset)
        return Figure(of, found.value, "length", found.interval, found.p)

    def gap(self, agent: str, env: str, subset: str = "all", start: str = STP, end: str = TRUTH) -> Figure:
        """The share that ``agent`` closes of the gap from ``start`` (0) to ``end`` (1), with its interval.

        With other ends than STP and true pasts, such as ``end="mtp"``: the share of what "mtp" gains.
        """
        found = self._gap(agent, env, subset, start, end)
        what = "gap closed" if (start, end) == (STP, TRUTH) else f"gap closed from {start} to {end}"
        if found is None:
            raise RecordError(
                f"{_named(what, agent, env, subset)}: no gap, {start} is not significantly worse than {end}"
            )
        return found

    def has_gap(self, env: str, subset: str = "all", start: str = STP, end: str = TRUTH) -> bool:
        """Whether there is a gap to close: ``start`` is significantly worse than ``end``."""
        return self._gap(start, env, subset, start, end) is not None

    def same_predictor_gap(self, agent: str, env: str, subset: str = "all") -> Figure:
        """The share that it closes of the gap between ends with its own predictor, with its interval."""
        scored, what = self._known.of(agent, env), "gap closed with the same predictor"
        ends = self._ends(scored, env)
        if ends is not None:
            return self.gap(agent, env, subset, *ends)
        row = scored.row(subset)
        value, interval = row.gap_closed_same_predictor, row.gap_same_predictor_interval
        return self._of(what, agent, env, subset, value, "share", interval)

    def has_same_predictor_gap(self, agent: str, env: str, subset: str = "all") -> bool:
        """Whether the ends with its own predictor are known, and there is a gap between them."""
        scored = self._known.of(agent, env)
        ends = self._ends(scored, env)
        if ends is not None:
            return self.has_gap(env, subset, *ends)
        return scored.row(subset).gap_closed_same_predictor is not None

    def _ends(self, scored: Scored, env: str) -> tuple[str, str] | None:
        """Whose records are the ends with its predictor; None where there are none."""
        ends = own_ends(scored.record.submission)
        return ends if ends in (None, (STP, TRUTH)) or self._known.has(ends, env) else None

    def ratio(self, figure: Figure, other: Figure) -> Figure:
        """How many times a figure is another one; without an interval."""
        of = f"{figure.of} over {other.of}"
        if other.value == 0:
            raise RecordError(f"{of}: undefined, the second is 0")
        return Figure(of, figure.value / other.value, "times")

    def times(self, agent: str, other: str, env: str, subset: str = "all") -> Figure:
        """How many times the error of ``agent`` is that of ``other``, with its interval."""
        one, second = self._known.beside(env, agent, other)
        on = subset_of(subset)
        interval = share_interval(one.sums.unit_error(on), second.sums.unit_error(on))
        found = self.ratio(self.error(agent, env, subset), self.error(other, env, subset))
        return Figure(found.of, found.value, "times", interval)

    def targets(self, env: str, subset: str = "all", agent: str = STP) -> Figure:
        """Targets of a subset; the record of ``agent`` knows them."""
        return self._count("targets", env, subset, agent)

    def objects(self, env: str, subset: str = "all", agent: str = STP) -> Figure:
        """Objects of a subset."""
        return self._count("objects", env, subset, agent)

    def scenes(self, env: str, subset: str = "all", agent: str = STP) -> Figure:
        """Scenes of a subset."""
        return self._count("scenes", env, subset, agent)

    def events(self, env: str, subset: str, agent: str = STP) -> Figure:
        """Expected events on targets in a run of the reference tracker; of the paper's subsets those of plain STP."""
        return self._count("events", env, subset, agent)

    def units(self, env: str, subset: str = "all", agent: str = STP) -> Figure:
        """The effective number of units."""
        return self._count("effective_units", env, subset, agent).to(1)

    def agents(self, *envs: str) -> list[str]:
        """The agents that have a record on each of ``envs``, without those that saw the truth."""
        causal = (
            [s.record.submission.name for s in self._known.all_of(e) if s.record.env.observe != "truth"] for e in envs
        )
        first, *others = map(dict.fromkeys, causal)
        return [name for name in first if all(name in other for other in others)]

    def agreement(self, env: str, other: str, subset: str = "all") -> Figure:
        """Kendall's tau of the orders of `agents` by their errors on two environments, with its interval.

        RecordError with fewer than two such agents, or without targets.
        """
        names, value, interval = self.agents(env, other), None, None
        if names:
            both = (*self._errors(env, names, subset), *self._errors(other, names, subset))
            value, interval = order_agreement(*both) or (None, None)
        of = f"{len(names)} agents"
        return self._of("agreement of order", of, f"{env} and {other}", subset, value, "order", interval)

    def plain_agreement(self, env: str, other: str, subset: str = "all") -> Figure:
        """`agreement` by the plain error; without an interval, for records keep no sums of it."""
        names = self.agents(env, other)
        errors = [np.array([[self.plain(name, place, subset).value] for name in names]) for place in (env, other)]
        tau = kendall_tau(*errors)[0] if len(names) > 1 else None
        of = f"{len(names)} agents"
        return self._of("agreement of order by the plain error", of, f"{env} and {other}", subset, tau, "order")

    def paper(self, agent: str, env: str, subset: str = "all", hypotheses: int = 20) -> Figure:
        """The paper's minADE of "truth_past", "stp" or "mtp" at equal k, metres; RecordError where it has none."""
        name = PAPER_SUBSETS.get(subset_of(subset), "")
        found = figures_of(env, agent, "equal", hypotheses if agent == "mtp" else 1).get(name)
        what = _named("the paper's minADE", agent, env, subset)
        if found is None:
            raise RecordError(f"{what}: the paper has none")
        return Figure(what, found[0])

    def levels(self, env: str) -> str:
        """How far the records of an environment were checked, for people."""
        count = Counter(scored.level for scored in self._known.all_of(env))
        return ", ".join(f"{count[level]} {LEVEL_TEXT[level]}" for level in reversed(LEVELS) if count[level])

    def _errors(self, env: str, names: list[str], subset: str) -> tuple[Floats, Floats]:
        """Errors [A, U] of agents summed over the targets of each unit, and the weight of these [U]."""
        sums, on = [scored.sums for scored in self._known.beside(env, *names)], subset_of(subset)
        return np.array([each.unit_error(on) for each in sums]), np.array(sums[0].unit_weight(on))

    def _gap(self, agent: str, env: str, subset: str, start: str, end: str) -> Figure | None:
        found, on = self._known.beside(env, agent, start, end), subset_of(subset)
        _require_one_k(found, env)
        own, high, low = (each.sums.unit_error(on) for each in found)
        gap = gap_closed(own, high, low, found[1].sums.unit_weight(on))
        what = "gap closed" if (start, end) == (STP, TRUTH) else f"gap closed from {start} to {end}"
        return gap and Figure(_named(what, agent, env, subset), gap.closed, "share", gap.interval)

    def _of_row(self, what: str, name: str, agent: str, env: str, subset: str, kind: Kind = "length") -> Figure:
        return self._of(what, agent, env, subset, getattr(self._known.of(agent, env).row(subset), name), kind)

    def _count(self, name: str, env: str, subset: str, agent: str) -> Figure:
        row = self._known.of(agent, env).row(subset)
        return self._of(name.replace("_", " "), agent, env, subset, getattr(row, name), "count")

    def _of(
        self,
        what: str,
        agent: str,
        env: str,
        subset: str,
        value: float | None,
        kind: Kind = "length",
        interval: tuple[float, float] | None = None,
        p: float | None = None,
    ) -> Figure:
        """A figure of a record; RecordError where it has no such number."""
        of = _named(what, agent, env, subset)
        if value is None:
            raise RecordError(f"{of}: its record has no such number; write the sentence without it")
        return Figure(of, value, kind, interval, p)


def _named(what: str, agent: str, env: str, subset: str) -> str:
    return f"{what} of {agent} on {env} ({subset})"


def _require_one_k(scored: list[Scored], env: str) -> None:
    samples = [each.record.samples for each in scored]
    if len(set(samples)) > 1:
        raise RecordError(f"records on {env} have {', '.join(map(str, samples))} samples per object, expected one k")
