"""What a comparison shows, in sentences: how much tracking errors cost, and what won it back."""

from __future__ import annotations

from collections.abc import Mapping

from ...scoring import Report
from ...scoring.definitions import RANKED_OBJECTS
from ...scoring.rank import enough_objects
from ...scoring.rows import PairedRow, Row
from .output import counted
from .tables import targets_on_objects

Rows = Mapping[tuple[str, int, str, str], Row]  # by agent, hypotheses, budget, subset


def findings(
    report: Report, truth: str = "truth_past", stp: str = "stp", control: str = "stp_same_budget"
) -> list[str]:
    """Sentences about a report; those whose rows are missing are left out."""
    rows: Rows = {(row.agent, row.hypotheses, row.budget, row.subset): row for row in report.rows}
    sentences = [_cost(rows, truth, stp, subset) for subset in ("ids", "lost", "reacquired")]
    best = max((key[1] for key in rows if key[0] == "mtp" and key[2] == "equal"), default=None)
    if best is not None:
        sentences += [_gap_closed(report, rows, stp, control, best, subset) for subset in ("all", "ids")]
        sentences += [_share_of_sampling(report, stp, control, best)]
        sentences += [_beyond_control(report, control, best, subset) for subset in ("ids", "lost", "reacquired")]
    sentences += [_silence(report), _few(report)]
    return [sentence for sentence in sentences if sentence]


def _cost(rows: Rows, truth: str, stp: str, subset: str) -> str | None:
    """How much worse prediction gets where the tracker erred."""
    ideal, real = rows.get((truth, 1, "equal", subset)), rows.get((stp, 1, "equal", subset))
    if not ideal or not real or not ideal.minADE or real.minADE is None:
        return None
    return (
        f"{subset}: minADE is {real.minADE:.2f} m from tracks and {ideal.minADE:.2f} m from true pasts "
        f"({real.minADE / ideal.minADE:.1f} times), {targets_on_objects(real)}."
    )


def _gap_closed(report: Report, rows: Rows, stp: str, control: str, hypotheses: int, subset: str) -> str | None:
    """How much of what tracking errors cost is won back at equal k, by hypotheses and by drawing as many samples."""
    mtp = rows.get(("mtp", hypotheses, "equal", subset))
    pair = _paired(report, "mtp", hypotheses, stp, subset)
    if not mtp or mtp.gap_closed is None or not pair or pair.gap_interval is None:
        return None
    low, high = (100 * share for share in pair.gap_interval)
    text = (
        f"{subset}: MTP (H = {hypotheses}, equal k) closes {100 * mtp.gap_closed:.0f} % of the gap between STP and "
        f"true pasts (95 % interval {low:.0f} to {high:.0f} %, {counted(pair.scenes, 'scene')})"
    )
    same = rows.get((control, 1, "equal", subset))
    if mtp.samples > 1 and same and same.gap_closed is not None:
        text += f"; as many samples from one hypothesis close {100 * same.gap_closed:.0f} %"
    return text + "."


def _share_of_sampling(report: Report, stp: str, control: str, hypotheses: int) -> str | None:
    """The part of the gain over STP that one hypothesis gets from drawing as many samples (paired minADE)."""
    gain = _paired(report, "mtp", hypotheses, stp, "all")
    sampling = _paired(report, control, 1, stp, "all")
    if not gain or gain.samples == 1:  # one sample is a mean, whatever the number of draws: no control of sampling
        return None
    if not sampling or gain.minADE is None or sampling.minADE is None:
        return None
    who = f"all: MTP (H = {hypotheses}, equal k)"
    if gain.minADE >= 0:
        return f"{who} does not lower minADE ({gain.minADE:+.3f} m)."
    who += f" lowers minADE by {-gain.minADE:.3f} m; as many samples from one hypothesis"
    if sampling.minADE >= 0:
        return f"{who} do not lower it ({sampling.minADE:+.3f} m): none of the global gain is sampling."
    return (
        f"{who} lower it by {-sampling.minADE:.3f} m. So {100 * sampling.minADE / gain.minADE:.0f} % of "
        "the global gain is sampling, not hypotheses."
    )


def _beyond_control(report: Report, control: str, hypotheses: int, subset: str) -> str | None:
    """What hypotheses add to the same sample budget on an event subset, by the missing-aware error."""
    row = _paired(report, "mtp", hypotheses, control, subset)
    if not row or row.missing_aware is None:
        return None
    return (
        f"{subset}: beyond the same-budget control MTP (H = {hypotheses}) changes the missing-aware error by "
        f"{row.missing_aware:+.2f} m ({_certainty(row)})."
    )


def _certainty(row: PairedRow) -> str:
    scenes = counted(row.scenes, "scene")
    if row.interval is None:
        return f"{scenes}: too few for an interval"
    low, high = row.interval
    covers = "" if low > 0 or high < 0 else ", the interval covers 0"
    return f"95 % interval {low:+.2f} to {high:+.2f}, p {_p(row.p)}, {scenes}{covers}"


def _p(value: float | None) -> str:
    return "unknown" if value is None else "< 0.001" if value < 0.001 else f"= {value:.3f}"


def _silence(report: Report) -> str | None:
    """Who would score better by saying nothing: false forecasts can cost more than all others win."""
    silence = next((row.silence for row in report.details), None)
    if silence is None:
        return None
    ranked = [row for row in report.rows if row.subset == "all" and row.budget == "equal"]
    worse = list(dict.fromkeys(row.agent for row in ranked if (row.missing_aware or 0.0) > silence))
    if not worse:
        return None
    return (
        f"all: an agent that says nothing scores {silence:.2f} m. Worse than that: {', '.join(worse)}; their false "
        "positives cost more than their forecasts win, so withholding weak tracks improves the ranked number."
    )


def _few(report: Report) -> str | None:
    few = sorted({r.subset for r in report.rows if r.subset != "all" and not enough_objects(r.objects)})
    return f"Shown but not ranked, with fewer than {RANKED_OBJECTS} objects: {', '.join(few)}." if few else None


def _paired(report: Report, agent: str, hypotheses: int, other: str, subset: str) -> PairedRow | None:
    wanted = (agent, hypotheses, other, subset)
    return next((r for r in report.paired if (r.agent, r.hypotheses, r.other, r.subset) == wanted), None)
