"""How many hypotheses and samples, at what cost; what false forecasts, weak detections and gaps do to the error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...running.settings import Setting
from ...scoring.knee import knee
from ...scoring.statistics import ratio
from ...viz.terminal.paper import paper_gap
from ..findings import Findings
from ..plan import SAME_BUDGET, Subject
from ..table import Count, Metres, Milliseconds, Number, Share, Table, Text
from .paper import settings_told, subset_name


@dataclass(frozen=True)
class SurfaceRow:
    """H hypotheses, k samples."""

    agent: Text
    H: Count
    k: Count
    minADE: Metres  # noqa: N815
    minADE_ids: Metres  # noqa: N815
    cost: Milliseconds


def surface_table(found: Findings) -> Table:
    """MinADE over H and k, and what a frame costs."""
    rows = []
    cost = {speed.hypotheses: speed.whole for speed in found.speed}
    for subject in found.plan.subjects:
        for count, setting in {1: subject.single, **subject.free}.items():
            table = found.table(setting)
            ids, spent = table.weight["ids"], cost.get(count) if subject is found.subject else None
            for k, curve in zip(found.of(setting).scores[0][0].ks, table.curve.T, strict=True):
                every = ratio(curve.sum(), table.covered.sum())
                on_ids = ratio(float((curve * ids).sum()), float((table.covered * ids).sum()))
                rows.append(SurfaceRow(subject.name, count, k, every, on_ids, spent))
    return Table(
        "surface",
        "How many hypotheses, how many samples",
        "Expected minADE of k random samples out of all that H hypotheses give, over targets with a forecast, and on "
        "ids; the cost is that of a frame with H hypotheses on one core. k costs next to nothing. Random samples, not "
        "those that a sampler chooses: the k-curve has no noise of sampling.",
        rows if len(found.subject.free) > 0 else [],
    )


@dataclass(frozen=True)
class CurveRow:
    """One number of samples."""

    agent: Text
    H: Count
    k: Count
    minADE: Metres  # noqa: N815


def k_table(found: Findings) -> Table:
    """The k-curve of every setting with most samples."""
    rows = []
    for subject, setting in settings_told(found):
        if setting.budget == "free" or setting in (subject.truth, subject.single):
            detail = found.details(setting)
            rows += [CurveRow(detail.agent, detail.hypotheses, int(k), v) for k, v in detail.k_curve.items()]
    return Table(
        "k_curve",
        "The error over the number of samples",
        "Expected minADE of k random samples out of all that a run gives, over targets with a forecast: minADE falls "
        "with k whatever the samples are worth.",
        rows,
    )


@dataclass(frozen=True)
class KneeRow:
    """Where more stops to pay."""

    agent: Text
    of: Text
    knee: Number
    error_there: Metres
    error_least: Metres
    cost_there: Milliseconds
    cost_most: Milliseconds
    share_of_gain: Share


def knee_table(found: Findings) -> Table:
    """The knees of the error over H, and over k."""
    rows = []
    cost = {speed.hypotheses: speed.whole for speed in found.speed}
    subject = found.subject
    if len(subject.equal) > 2 and all(count in cost for count in subject.equal):
        counts = sorted(subject.equal)
        for subset in ("all", "ids"):
            errors = [found.row(subject.equal[count], subset).error for count in counts]
            what = f"H, error on {subset_name(subset)}"
            rows += _knee_of(subject, what, counts, errors, [cost[c] for c in counts], cost)
    if subject.free:
        most = max(subject.free)
        curve = found.details(subject.free[most]).k_curve
        ks = [int(k) for k in curve]
        rows += _knee_of(subject, f"k, minADE with H = {most}", ks, list(curve.values()), [np.log2(k) for k in ks], {})
    return Table(
        "knee",
        "Where more stops to pay",
        "The knee is the point farthest below the straight line from the first to the last, both axes scaled to one: "
        "over H the axis is the cost of a frame, over k its logarithm (Satopaa et al. 2011).",
        rows,
    )


def _knee_of(
    subject: Subject, of: str, at: list[int], errors: list[float | None], cost: list[float], spent: dict[int, float]
) -> list[KneeRow]:
    known = [float(e) for e in errors if e is not None]
    if len(known) < len(errors):
        return []
    place = knee(cost, known)
    if place is None:
        return [KneeRow(subject.name, of, None, None, min(known), None, spent.get(at[-1]), None)]
    gained = (known[0] - known[place]) / (known[0] - known[-1])
    return [
        KneeRow(
            subject.name, of, at[place], known[place], min(known), spent.get(at[place]), spent.get(at[-1]), gained
        )
    ]  # fmt: skip


@dataclass(frozen=True)
class BudgetRow:
    """The error at one number of false forecasts."""

    agent: Text
    H: Count
    allowed: Number  # false forecasts per target, or forecasts per live frame
    error: Metres


def budget_table(found: Findings) -> Table:
    """The error over false forecasts."""
    rows = []
    known = found.table(found.subject.single).budgets.false_known
    for setting in shown(found):
        detail = found.details(setting)
        rows += [BudgetRow(detail.agent, detail.hypotheses, at, error) for at, error in detail.curve]
    what = "false forecasts per target" if known else "forecasts per live frame"
    return Table(
        "budgets",
        "The error over what is allowed",
        f"The error where at most so many {what} are made, the surest first. What ranks is a mean over it.",
        rows,
    )


def shown(found: Findings) -> list[Setting]:
    """The settings that figures of all agents show: true pasts, one hypothesis, the control, the most hypotheses."""
    picked = []
    for subject in found.plan.subjects:
        controls = [s for s in found.plan.controls if s.label == SAME_BUDGET]
        picked += [subject.truth, subject.single, *controls, subject.most]
    return [s for i, s in enumerate(picked) if s not in picked[:i]]


@dataclass(frozen=True)
class GapRow:
    """What an agent closes of the gap between one hypothesis and true pasts."""

    targets_of: Text
    agent: Text
    H: Count
    closed: Share
    low: Share
    high: Share
    closed_own_predictor: Share
    own_low: Share
    own_high: Share
    energy_score: Metres
    paper_closed: Share


def gap_table(found: Findings) -> Table:
    """The share of the gap that is closed, between both kinds of ends, and the energy score."""
    rows = []
    for subset in ("all", "ids", "reacquired"):
        for subject, setting in settings_told(found):
            if setting.budget != "equal" or setting == subject.truth:
                continue
            row = found.row(setting, subset)
            low, high = row.gap_interval or (None, None)
            own_low, own_high = row.gap_same_predictor_interval or (None, None)
            rows.append(
                GapRow(
                    subset_name(subset), row.agent, row.hypotheses, row.gap_closed, low, high,
                    row.gap_closed_same_predictor, own_low, own_high, row.energy_score,
                    paper_gap(found.bench.of_paper, row) if subset == "ids" else None,
                )
            )  # fmt: skip
    return Table(
        "gaps",
        "How much of the gap is closed",
        "0 is one hypothesis, 1 is prediction from true pasts. The first ends are stp and truth_past, the second have "
        "the agent's own predictor; nothing is said where the gap is not significantly above 0. The energy score is "
        "proper: unlike minADE it does not fall with junk samples.",
        list(dict.fromkeys(rows)),  # a control stands beside every subject
    )


@dataclass(frozen=True)
class CutRow:
    """The input cut at one score."""

    true_detections_below: Share
    agent: Text
    error: Metres
    error_ids: Metres
    switches_of_stp: Count
    mtp_minus_control_ids: Metres
    low: Metres
    high: Metres
    p: Number


def cut_table(found: Findings) -> Table:
    """The baselines with weak detections left out."""
    rows = []
    for cut in found.cuts:
        beyond = cut.beyond_control.get("ids"), *(cut.interval.get("ids") or (None, None)), cut.p.get("ids")
        for agent, error in cut.all.items():
            control = beyond if agent == "mtp" else (None,) * 4
            rows.append(CutRow(cut.threshold, agent, error, cut.ids.get(agent), cut.switches, *control))
    return Table(
        "cuts",
        "How much the cut of the input decides",
        "The baselines where detections below a score are left out: per class that below which so many detections of "
        "true objects lie. One seed. A cut removes switches, and with them what hypotheses can win back.",
        rows,
    )
