"""What a comparison shows, in five sentences: what tracking errors cost, what wins it back, and who is ranked."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ...running.compare import STP, TRUTH
from ...scoring import Report
from ...scoring.definitions import FORECASTS_PER_FRAME, RANKED_SUBSETS, SIGNIFICANT
from ...scoring.rows import Interval, Row
from .paper import paper_gap, shipped_env

SAW_TRUTH = "saw the truth"  # of `why_unranked`
CONTROL = "stp_same_budget"  # draws as many samples from one hypothesis as 20 hypotheses do
CONTROL_DRAWS = 20  # times k samples
_NO_OWN_GAP = "no share is given between its own ends: none are stated, or they do not differ significantly"
WHERE = {"all": "over all targets", "ids": "on ids", "reacquired": "on reacquired"}


def verdict(report: Report, names: Sequence[str]) -> list[str]:
    """Sentences about a report that speak of the submissions ``names``; those whose numbers are missing are left out.

    A submission with several settings is spoken of in the one with the most hypotheses, at equal k.
    """
    speakers = [row for name in names if name not in (STP, TRUTH) and (row := _setting(report, name)) is not None]
    sentences = [_cost(report)]
    for row in speakers:
        sentences += [_against_stp(report, row), _against_control(report, row), _gap(report, row)]
    sentences += [_ranks(report), _unknown(report)]
    return [sentence for sentence in sentences if sentence]


def _setting(report: Report, name: str) -> Row | None:
    """The row of all targets that speaks for the submission ``name``."""
    rows = [r for r in report.rows if r.subset == "all" and r.budget == "equal" and r.agent.split(" ")[0] == name]
    return max(rows, key=lambda row: (row.agent == name, row.hypotheses), default=None)


def _beside(report: Report, row: Row | None, subset: str) -> Row | None:
    """The row of the same agent and setting on another subset."""
    if row is None:
        return None
    key = (row.agent, row.hypotheses, row.samples, row.budget, subset)
    return next((r for r in report.rows if (r.agent, r.hypotheses, r.samples, r.budget, r.subset) == key), None)


def _cost(report: Report) -> str | None:
    real, ideal = _setting(report, STP), _setting(report, TRUTH)
    if real is None or ideal is None or ideal.difference_to_stp is None:
        return None
    return (
        f"From true pasts the error {WHERE['all']} is {_metres(ideal.error)}, from the tracks of {STP} "
        f"{_metres(real.error)} "
        f"({_difference(ideal.difference_to_stp, ideal.difference_interval, ideal.p)}): that is what tracking errors "
        f"cost. With every forecast kept (plain error): {_metres(ideal.plain_error)} and {_metres(real.plain_error)}."
    )


def _against_stp(report: Report, row: Row) -> str | None:
    other = _setting(report, STP)
    if row.difference_to_stp is None or other is None:
        return None
    return (
        f"{_who(row)} against {STP} {WHERE['all']}: {_metres(row.error)} instead of {_metres(other.error)} "
        f"({_difference(row.difference_to_stp, row.difference_interval, row.p)})."
    )


def _against_control(report: Report, row: Row) -> str | None:
    parts = []
    for subset in ("all", "ids"):
        key = (row.agent, row.hypotheses, row.samples, row.budget, CONTROL, subset)
        for r in report.paired:
            if (r.agent, r.hypotheses, r.samples, r.budget, r.other, r.subset) == key and r.error is not None:
                parts.append(f"{WHERE[subset]} {_difference(r.error, r.interval, r.p)}")
    if not parts:
        return None
    as_many = row.hypotheses == CONTROL_DRAWS
    drawn = "as many samples from one hypothesis" if as_many else f"one hypothesis with {CONTROL_DRAWS} times k samples"
    # with another predictor or another number of samples than the control's the difference is not of hypotheses alone
    alike = as_many and row.gap_closed is not None and row.gap_closed == row.gap_closed_same_predictor
    gain = f". This difference, not the one to {STP}, is the gain of hypotheses" if alike else ""
    return f"{_who(row)} against {CONTROL}, {drawn}: {'; '.join(parts)}{gain}."


def _gap(report: Report, row: Row) -> str | None:
    """The share of the gap that is closed: between both kinds of ends, by the plain error, in the paper."""
    rows = [row, _beside(report, row, "ids")]
    low, high = (_setting(report, name) for name in (STP, TRUTH))
    if low is None or high is None:
        return None

    def said(share: Callable[[Row], float | None], interval: Callable[[Row], Interval | None] = lambda _: None) -> str:
        known = [(r, value, interval(r)) for r in rows if r is not None and (value := share(r)) is not None]
        return " and ".join(f"{_percent(value)}{_percents(ends)} {WHERE[r.subset]}" for r, value, ends in known)

    def plain(of: Row) -> float | None:
        bad, good = (_beside(report, end, of.subset) for end in (low, high))
        if not (bad and good) or None in (of.plain_error, bad.plain_error, good.plain_error):
            return None
        whole = (bad.plain_error or 0.0) - (good.plain_error or 0.0)
        return ((bad.plain_error or 0.0) - (of.plain_error or 0.0)) / whole if whole > 0 else None

    closed = said(lambda r: r.gap_closed, lambda r: r.gap_interval)
    if not closed:
        return f"{_who(row)}: no share of the gap is given, for {STP} is not significantly worse than true pasts."
    parts = [f"{_who(row)} closes {closed} of the gap between {STP} and true pasts"]
    own = said(lambda r: r.gap_closed_same_predictor, lambda r: r.gap_same_predictor_interval)
    parts.append(f"between ends with its own predictor and presence {own}" if own else _NO_OWN_GAP)
    parts.append(f"by the plain error {said(plain) or 'unknown'}")
    if (paper := paper_gap(shipped_env(report), row)) is not None:
        parts.append(f"in the paper, by minADE on IDS, {_percent(paper)}")
    return "; ".join(parts) + "."


def _ranks(report: Report) -> str | None:
    """Who is ranked where, and why others are not."""
    parts, nobody = [], []
    for subset in ("all", *RANKED_SUBSETS):
        rows = [row for row in report.rows if row.subset == subset and row.budget == "equal"]
        ranked = sorted((row for row in rows if row.rank is not None), key=lambda row: row.rank or 0)
        left = [row for row in rows if row.unranked_because not in (None, SAW_TRUTH)]
        if ranked:
            parts.append(f"Ranks {WHERE[subset]}: " + ", ".join(f"{row.rank} {_who(row)}" for row in ranked))
            why = ", ".join(f"{_who(row)} ({row.unranked_because})" for row in left)
            parts += [f"Not ranked there: {why}"] if left else []
        elif left:
            why = "; ".join(dict.fromkeys(str(row.unranked_because) for row in left))
            nobody.append(f"{WHERE[subset]} ({why})")
    parts += [f"Nobody is ranked {', '.join(nobody)}"] if nobody else []
    never = dict.fromkeys(row.agent for row in report.rows if row.unranked_because == SAW_TRUTH)
    parts += [f"Never ranked, as they saw the truth: {', '.join(never)}"] if never else []
    return ". ".join(parts) + "." if parts else None


def _unknown(report: Report) -> str | None:
    if report.condition.get("truth", "complete") == "complete":
        return None
    own = next((f" ({d.forecasts_per_frame:.1f})" for d in report.details if d.agent == STP), "")
    few = ", ".join(f"{budget:g}" for budget in FORECASTS_PER_FRAME)
    return (
        "The truth holds prediction targets only, so false forecasts cannot be known: the error is taken at budgets of "
        f"forecasts per live frame, {few} and the number of {STP}{own}, on ids and reacquired at the last alone."
    )


def _who(row: Row) -> str:
    return f"{row.agent} (H = {row.hypotheses})" if row.hypotheses > 1 else row.agent


def _metres(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3f} m"


def _difference(mean: float, interval: Interval | None, p: float | None) -> str:
    """A difference with its interval and p, in words where it could be chance."""
    if interval is None or p is None:
        return f"{mean:+.3f} m, too few recordings for an interval"
    chance = ", could be chance" if p >= SIGNIFICANT else ""
    said = "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
    return f"{mean:+.3f} m, 95 % {interval[0]:+.3f} to {interval[1]:+.3f}, {said}{chance}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _percents(interval: Interval | None) -> str:
    return "" if interval is None else f" (95 % {100 * interval[0]:.1f} to {100 * interval[1]:.1f} %)"
