"""Sentences about a report: the verdict of a comparison, and the notes below its table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from ...scoring import Report
from ...scoring.definitions import FORECASTS_PER_FRAME, RANKED_SUBSETS, SIGNIFICANT, Subset
from ...scoring.rank import NOT_CAUSAL
from ...scoring.rows import Details, Interval, PairedRow, Row
from ...submission.loader import controls
from ...tables import BLANK, Column, short
from .output import counted
from .paper import paper_figures, paper_gap, shipped_env
from .parts import label_of
from .tables import blocks_of

SAW_TRUTH = "saw the truth"  # reason of `why_unranked`
STP, TRUTH, CONTROL = (controls()[role] for role in ("single", "ground_truth", "same_samples"))
ASSOCIATED = "perfect_association_same_samples"
CONTROL_DRAWS = 20  # times k samples
_NO_OWN_GAP = "with its own predictor unknown: no reference pair is stated, or it does not differ significantly"
_SIGNED = Column(format="+.3f")
WHERE = {"all": "over all targets", "ids": "on ids", "reacquired": "on reacquired"}


def verdict(report: Report, names: Sequence[str]) -> list[str]:
    """Sentences about the submissions ``names``; those whose numbers are missing are left out.

    Of a submission with several settings they state the one with the most hypotheses, at equal k.
    """
    rows = [row for name in names if name not in (STP, TRUTH) and (row := _main_row(report, name)) is not None]
    sentences = [_bounds(report), _costs(report)]
    for row in rows:
        sentences += [_against_stp(report, row), _against_control(report, row), _gap(report, row)]
    sentences += [_unranked(report), _unknown_false_forecasts(report)]
    return [sentence for sentence in sentences if sentence]


def _main_row(report: Report, name: str) -> Row | None:
    """The row of all targets for the submission ``name``, in its main setting."""
    rows = [r for r in report.rows if r.subset == "all" and r.budget == "equal" and r.agent.split(" ")[0] == name]
    return max(rows, key=lambda row: (row.agent == name, row.hypotheses), default=None)


def _on_subset(report: Report, row: Row, subset: str) -> Row | None:
    """The row of the same agent and setting on another subset."""
    key = (row.agent, row.hypotheses, row.samples, row.budget, subset)
    return next((r for r in report.rows if (r.agent, r.hypotheses, r.samples, r.budget, r.subset) == key), None)


def _bounds(report: Report) -> str | None:
    real, ideal = _main_row(report, STP), _main_row(report, TRUTH)
    if real is None or ideal is None:
        return None
    return (
        f"bADE {WHERE['all']} is {_metres(real.error)} from the tracks of {STP} and {_metres(ideal.error)} from "
        f"ground-truth tracks. With every forecast kept (plain error): {_metres(real.plain_error)} and "
        f"{_metres(ideal.plain_error)}."
    )


def _costs(report: Report) -> str | None:
    """Costs of detection, tracking and association; only that of association is one of tracking errors alone."""
    parts, known = [], False
    for subset in ("all", "ids"):
        both, own = _paired(report, TRUTH, STP, subset), _paired(report, ASSOCIATED, CONTROL, subset)
        if both is None:
            continue
        known |= own is not None
        association = f", of which association {_cost(own)} (perfect association of the same detections)" if own else ""
        parts.append(f"{WHERE[subset]} {_cost(both)}{association}")
    if not parts:
        return None
    least = " The cost of association is a lower bound: duplicate detections still make switches." if known else ""
    return f"Detection and tracking together cost {'; '.join(parts)}.{least}"


def _paired(report: Report, agent: str, other: str, subset: str) -> PairedRow | None:
    """The difference of an agent to a control on a subset; None without both."""
    rows = (r for r in report.paired if (r.agent, r.budget, r.other, r.subset) == (agent, "equal", other, subset))
    return next((row for row in rows if row.error is not None), None)


def _cost(pair: PairedRow) -> str:
    """The error of the control less that of the agent."""
    interval = None if pair.interval is None else (-pair.interval[1], -pair.interval[0])
    return _difference(-(pair.error or 0.0), interval, pair.p)


def _against_stp(report: Report, row: Row) -> str | None:
    other = _main_row(report, STP)
    if row.difference_to_stp is None or other is None:
        return None
    return (
        f"{label_of(row)} against {STP} {WHERE['all']}: {_metres(row.error)} instead of {_metres(other.error)} "
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
    # with another predictor or number of samples the difference is not one of hypotheses alone
    alike = as_many and row.gap_closed is not None and row.gap_closed == row.gap_closed_same_predictor
    gain = f". This difference, not the one to {STP}, is the gain of hypotheses" if alike else ""
    return f"{label_of(row)} against {CONTROL}, {drawn}: {'; '.join(parts)}{gain}."


def _gap(report: Report, row: Row) -> str | None:
    """The share of the gap that is closed: between both reference pairs, by the plain error, and in the paper."""
    rows = [each for each in (row, _on_subset(report, row, "ids")) if each is not None]
    if _main_row(report, STP) is None or _main_row(report, TRUTH) is None:
        return None
    closed = _shares(rows, lambda r: r.gap_closed, lambda r: r.gap_interval)
    if not closed:
        return f"{label_of(row)}: no gap to close, {STP} is not significantly worse than ground-truth tracks."
    own = _shares(rows, lambda r: r.gap_closed_same_predictor, lambda r: r.gap_same_predictor_interval)
    parts = [
        f"{label_of(row)} closes {closed} of the gap between {STP} and ground-truth tracks",
        f"between references with its own predictor and presence {own}" if own else _NO_OWN_GAP,
    ]
    if (paper := paper_gap(shipped_env(report), row)) is not None:
        parts.append(f"in the paper, by minADE on IDS, {_percent(paper)}")
    return "; ".join(parts) + "."


def _shares(
    rows: Sequence[Row], share: Callable[[Row], float | None], interval: Callable[[Row], Interval | None]
) -> str:
    """Shares on the subsets of the rows, with intervals; empty where none is known."""
    known = [(row, value) for row in rows if (value := share(row)) is not None]
    return " and ".join(f"{_percent(value)}{_percents(interval(row))} {WHERE[row.subset]}" for row, value in known)


def _unranked(report: Report) -> str | None:
    """Reasons of missing ranks, by subset; ranks stand in the table."""
    parts = []
    for subset in ("all", *RANKED_SUBSETS):
        rows = [row for row in report.rows if row.subset == subset and row.budget == "equal"]
        reasons: dict[str, list[str]] = {}
        for row in rows:
            if row.unranked_because not in (None, SAW_TRUTH):
                reasons.setdefault(str(row.unranked_because), []).append(label_of(row))
        if any(row.place is not None for row in rows):
            parts += [f"Not ranked {WHERE[subset]} ({why}): {', '.join(labels)}" for why, labels in reasons.items()]
        elif reasons:
            parts.append(f"No agent is ranked {WHERE[subset]} ({'; '.join(reasons)})")
    ideal = dict.fromkeys(row.agent for row in report.rows if row.unranked_because == SAW_TRUTH)
    parts += [f"Never ranked, as they saw the truth: {', '.join(ideal)}"] if ideal else []
    return ". ".join(parts) + "." if parts else None


def _unknown_false_forecasts(report: Report) -> str | None:
    if report.condition.get("truth", "complete") == "complete":
        return None
    own = next((f" ({d.forecasts_per_frame:.1f})" for d in report.details if d.agent == STP), "")
    budgets = ", ".join(f"{budget:g}" for budget in FORECASTS_PER_FRAME)
    return (
        "The truth holds prediction targets only, so false forecasts are not known: bADE is taken at budgets of "
        f"forecasts per live frame, {budgets} and the number of {STP}{own}, on ids and reacquired at the last alone."
    )


def notes(report: Report) -> list[str]:
    """The meaning of the columns of the main table, its numbers of targets, and warnings."""
    return [_about(report), *_sizes(report), *_warnings(report)]


def _about(report: Report) -> str:
    allowed = "averaged over allowed numbers of false forecasts, up to one per target or as many as STP makes"
    if report.condition.get("truth", "complete") != "complete":
        allowed = "averaged over budgets of forecasts per live frame"
    empty = next((details.silence for details in report.details), None)
    nothing = "" if empty is None else f" If nothing is predicted: {short(empty)}."
    env = shipped_env(report)
    paper = " Dim: the paper's numbers." if any(paper_figures(env, row) for row in report.rows) else ""
    return (
        f"minADE/FDE: of the targets with a forecast (cov.); IDS, FRAG: where plain STP has that event.{paper} bADE "
        f"(budgeted ADE): {allowed}; on ids as many as STP makes.{nothing} #: rank, {BLANK} shown only. "
        f"Definitions {report.definitions}."
    )


def _sizes(report: Report) -> Iterator[str]:
    names: dict[Subset, str] = {"all": "all", "paper_ids": "IDS", "paper_frag": "FRAG", "ids": "ids"}
    for rows in blocks_of(report)[:1]:
        for subset, name in names.items():
            row = rows[subset]
            few = "" if subset != "ids" else f" ({row.effective_targets:.1f} and {row.effective_objects:.1f} effective)"
            on = f"{counted(row.targets, 'target')} on {counted(row.objects, 'object')}{few}"
            yield f"{name}: {on} in {counted(row.scenes, 'scene')}"


def _warnings(report: Report) -> Iterator[str]:
    honest = [row for row in report.rows if row.subset == "all" and row.unranked_because != SAW_TRUTH]
    agents = {row.agent for row in honest}
    details = [each for each in report.details if each.agent in agents]
    if report.rows and not report.rows[0].targets:
        yield "! there is no target: no object that may be one is present in all past and future frames"
    elif report.rows and not any(row.coverage for row in honest) and any(d.forecasts_per_frame for d in details):
        yield "! no forecast is near a target: are detections and truth in one frame of reference, in metres?"
    for agent in dict.fromkeys(row.agent for row in report.rows if row.unranked_because == NOT_CAUSAL):
        yield f"{agent}: never ranked, {NOT_CAUSAL}"
    if dropped := max((each.dropped_detections for each in details), default=0):
        yield f"! {counted(dropped, 'detection')} not shown to agents: beyond the range or the number of the task"
    for each in report.details:
        yield from _of_agent(each)


def _of_agent(details: Details) -> Iterator[str]:
    if details.guessed_parents:
        share = f"{100 * details.guessed_parents:.0f} %"
        yield f"* {details.agent} states no parents: the lineage of own events is guessed in {share} of frames"
    if rejected := sum(details.invalid.values()):
        yield rejected_line(details.agent, rejected)


def rejected_line(agent: str, rejected: int) -> str:
    """Note about rejected rows of an agent's actions."""
    return f"! {agent}: {counted(rejected, 'row')} rejected; `mtp-bench check` explains the errors"


def _metres(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3f} m"


def _difference(mean: float, interval: Interval | None, p: float | None) -> str:
    """A difference with its interval and p, in words where it could be chance."""
    if interval is None or p is None:
        return f"{_SIGNED.text(mean)} m, too few recordings for an interval"
    chance = ", could be chance" if p >= SIGNIFICANT else ""
    probability = "p < 0.001" if p < 0.001 else f"p = {p:.3f}"
    return f"{_SIGNED.text(mean)} m, 95 % {_SIGNED.text(interval)}, {probability}{chance}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _percents(interval: Interval | None) -> str:
    return "" if interval is None else f" (95 % {100 * interval[0]:.1f} to {100 * interval[1]:.1f} %)"
