"""Rows of the tables of errors: the paper's tables, gaps, knees, speed, budgets and score thresholds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import SimpleNamespace as Row
from typing import Any

import numpy as np

from ..running.compare import threshold_agents
from ..running.settings import Setting
from ..scoring.rows import PairedRow
from ..scoring.statistics import ratio
from ..scoring.subsets import Subset
from ..viz.terminal.paper import PAPER_SUBSETS, figures_of, paper_facts, paper_gap
from .findings import Findings
from .plan import StudiedAgent

EVENT_SUBSETS: tuple[Subset, ...] = ("paper_ids", "paper_frag", "ids", "reacquired")
_SUBSET_NAMES = {"ids": "identity switch", "paper_ids": "IDS", "paper_frag": "FRAG"}
_UNKNOWN = (None, None)  # minADE and minFDE of the paper


def subset_name(subset: str) -> str:
    """Name of a subset for readers."""
    return _SUBSET_NAMES.get(subset, subset)


def settings_of_rows(findings: Findings) -> Iterator[tuple[StudiedAgent, Setting]]:
    """Settings of the tables over H and k, each with the studied agent whose rows it belongs to."""
    for subject in findings.plan.subjects:
        equal = [setting for setting in subject.equal.values() if setting != subject.single]
        controls = findings.plan.shown_controls
        for setting in [subject.truth, subject.single, *controls, *equal, *subject.free.values()]:
            yield subject, setting


def shown_settings(findings: Findings) -> list[Setting]:
    """Settings of figures over all agents: GT tracks, one hypothesis, the control, the most hypotheses."""
    control = findings.plan.same_samples
    picked = []
    for subject in findings.plan.subjects:
        picked += [subject.truth, subject.single, *([control] if control else []), subject.most]
    return [s for i, s in enumerate(picked) if s not in picked[:i]]


def values_of(row: Any, names: str) -> dict[str, Any]:
    """Attributes of a row of the report, by name; ``names`` are separated by blanks."""
    return {name: getattr(row, name) for name in names.split()}


def _difference(paired: PairedRow | None, name: str) -> dict[str, Any]:
    """A difference of ranking errors under this name, with its interval and p-value; None without one."""
    known = (None, None, None) if paired is None else (paired.error, paired.interval, paired.p)
    return dict(zip((name, f"{name}_interval", "p"), known, strict=True))


def _of_paper(figures: Sequence[float | None]) -> dict[str, float | None]:
    """The paper's minADE and minFDE."""
    return {"paper_minADE": figures[0], "paper_minFDE": figures[1]}


def past_rows(findings: Findings) -> Iterator[Row]:
    """Table I of the paper: ground-truth tracks against tracklets, on targets with events."""
    of_paper = findings.bench.of_paper
    for subject in findings.plan.subjects:
        pasts = (("GT tracks", "truth_past", subject.truth), ("tracklets", "stp", subject.reference))
        for subset in (*EVENT_SUBSETS, "all"):
            key = PAPER_SUBSETS.get(subset, "")
            for past, role, setting in pasts:
                row, table = findings.row(setting, subset), findings.table(setting)
                plain = findings.mean(table, table.capped, table.weight[subset])
                paper = figures_of(of_paper, role, "equal", 1).get(key, _UNKNOWN)
                yield Row(
                    agent=subject.name,
                    targets_of=subset_name(subset),
                    past=past,
                    minADE=row.minADE,
                    minADE_interval=findings.mean_ade(table, table.weight[subset]).interval,
                    minFDE=row.minFDE,
                    plain_error=plain.value,
                    plain_error_interval=plain.interval,
                    **values_of(row, "coverage targets objects events"),
                    **_of_paper(paper),
                    paper_objects=paper_facts(of_paper, "objects").get(key),
                )


def targeted_rows(findings: Findings) -> Iterator[Row]:
    """Table II of the paper: targets with events, over H and k."""
    for subset in EVENT_SUBSETS:
        for subject, setting in settings_of_rows(findings):
            yield _gain_row(findings, subject, setting, subset)


def global_rows(findings: Findings) -> Iterator[Row]:
    """Table III of the paper: all targets, over H and k."""
    for subject, setting in settings_of_rows(findings):
        yield _gain_row(findings, subject, setting, "all")


def _gain_row(findings: Findings, subject: StudiedAgent, setting: Setting, subset: Subset) -> Row:
    row, paired = findings.row(setting, subset), None
    if setting.budget == "equal" and setting is not subject.single:
        paired = findings.difference(setting, subject.single, subset)
    return Row(
        targets_of=subset_name(subset),
        agent=setting.label,
        H=row.hypotheses,
        k=row.samples,
        sampling="–" if row.hypotheses == 1 else "k of all" if setting.budget == "equal" else "none",
        **values_of(row, "minADE minFDE plain_error error"),
        error_interval=row.interval,
        **_difference(paired, "to_single"),
        **values_of(row, "coverage targets objects"),
        **_of_paper(_paper_figures(findings, subject, setting, subset)),
    )


def _paper_figures(
    findings: Findings, subject: StudiedAgent, setting: Setting, subset: Subset
) -> Sequence[float | None]:
    """The paper's minADE and minFDE for the role of a setting."""
    role = "truth_past" if setting == subject.truth else "stp" if setting == subject.single else "mtp"
    if setting in findings.plan.controls and role == "mtp":
        return _UNKNOWN
    figures = figures_of(findings.bench.of_paper, role, setting.budget, setting.hypotheses or 1)
    return figures.get(PAPER_SUBSETS.get(subset, ""), _UNKNOWN)


def people_rows(findings: Findings) -> Iterator[Row]:
    """Table V of the paper: re-tracking and hypotheses, alone and together."""
    papers = paper_facts(findings.bench.of_paper, "people")
    names = ("plain", "retracking", "hypotheses", "both")
    for name, setting in zip(names, findings.plan.retracking, strict=False):
        row, plain = findings.row(setting, "all"), findings.plan.retracking[0]
        paired = None if name == "plain" else findings.difference(setting, plain, "all")
        yield Row(
            agent=setting.submission.name if name in ("plain", "both") else setting.label,
            retracking="yes" if name in ("retracking", "both") else "no",
            H=row.hypotheses,
            **values_of(row, "minADE minFDE error"),
            error_interval=row.interval,
            **_difference(paired, "to_plain"),
            **values_of(row, "coverage targets"),
            **_of_paper(papers.get(name, _UNKNOWN)),
        )


def speed_rows(findings: Findings) -> Iterator[Row]:
    """Table IV of the paper: time per frame of tracking, prediction and the whole agent, by number of hypotheses H."""
    papers = paper_facts(findings.bench.of_paper, "speed")
    for speed in findings.speed:
        count = str(speed.hypotheses)
        yield Row(
            H=speed.hypotheses,
            **values_of(speed, "tracking prediction whole"),
            tracking_rate=1e3 / speed.tracking if speed.tracking else None,
            prediction_rate=1e3 / speed.prediction if speed.prediction else None,
            frames=speed.frames,
            paper_tracking_rate=papers.get("tracking", {}).get(count),
            paper_prediction_rate=papers.get("prediction", {}).get(count),
        )


def surface_rows(findings: Findings) -> Iterator[Row]:
    """MinADE over H and k, and the cost of a frame."""
    cost = {speed.hypotheses: speed.whole for speed in findings.speed}
    for subject in findings.plan.subjects if findings.subject.free else ():
        for count, setting in {1: subject.single, **subject.free}.items():
            table = findings.table(setting)
            ids = table.weight["ids"]
            for k, curve in zip(findings.of(setting).scores[0][0].ks, table.curve.T, strict=True):
                yield Row(
                    agent=subject.name,
                    H=count,
                    k=k,
                    minADE=ratio(curve.sum(), table.covered.sum()),
                    minADE_ids=ratio(float((curve * ids).sum()), float((table.covered * ids).sum())),
                    cost=cost.get(count) if subject is findings.subject else None,
                )


def k_rows(findings: Findings) -> Iterator[Row]:
    """The k-curve of every setting with all samples."""
    for subject, setting in settings_of_rows(findings):
        if setting.budget == "free" or setting in (subject.truth, subject.single):
            detail = findings.details(setting)
            for k, error in detail.k_curve.items():
                yield Row(agent=detail.agent, H=detail.hypotheses, k=int(k), minADE=error)


def knee_rows(findings: Findings) -> Iterator[Row]:
    """Knees of the error over H, and over k."""
    cost, subject = {speed.hypotheses: speed.whole for speed in findings.speed}, findings.subject
    counts = sorted(subject.equal)
    if len(counts) > 2 and all(count in cost for count in counts):
        for subset in ("all", "ids"):
            errors = [findings.row(subject.equal[count], subset).error for count in counts]
            yield from _knee_rows(subject, f"H, error on {subset_name(subset)}", counts, errors, cost)
    if subject.free:
        most = max(subject.free)
        curve = findings.details(subject.free[most]).k_curve
        ks = [int(k) for k in curve]
        yield from _knee_rows(subject, f"k, minADE with H = {most}", ks, list(curve.values()), {})


def _knee_rows(
    subject: StudiedAgent, of: str, counts: list[int], errors: Sequence[float | None], cost: dict[int, float]
) -> Iterator[Row]:
    """The knee over ``counts`` by their ``cost``, or by their logarithm without costs."""
    known = [float(error) for error in errors if error is not None]
    if len(known) < len(errors):
        return
    i = knee([cost[count] if cost else np.log2(count) for count in counts], known)
    yield Row(
        agent=subject.name,
        of=of,
        knee=None if i is None else counts[i],
        error_there=None if i is None else known[i],
        error_least=min(known),
        cost_there=None if i is None else cost.get(counts[i]),
        cost_most=cost.get(counts[-1]),
        share_of_gain=None if i is None else (known[0] - known[i]) / (known[0] - known[-1]),
    )


def knee(cost: Sequence[float], error: Sequence[float]) -> int | None:
    """Index of the knee of ``error`` over rising ``cost``; None without a knee.

    Both axes are scaled to one; the knee is the point farthest below the straight line from the first point to the
    last (Satopaa et al. 2011, "Finding a kneedle in a haystack", without smoothing). None with fewer than three points,
    if the last error is not below the first, and if all points lie on the line or above.
    """
    at, value = np.asarray(cost, dtype=np.float64), np.asarray(error, dtype=np.float64)
    if len(at) < 3 or value[-1] >= value[0] or at[-1] <= at[0]:
        return None
    below = (value[0] - value) / (value[0] - value[-1]) - (at - at[0]) / (at[-1] - at[0])
    place = int(np.argmax(below))
    return place if below[place] > 1e-9 else None


def budget_rows(findings: Findings) -> Iterator[Row]:
    """The error over the number of forecasts that are allowed."""
    for setting in shown_settings(findings):
        detail = findings.details(setting)
        for allowed, error in detail.curve:
            yield Row(agent=detail.agent, H=detail.hypotheses, allowed=allowed, error=error)


def gap_rows(findings: Findings) -> Iterator[Row]:
    """Share of the gap that is closed, between both reference pairs, and the energy score."""
    rows: list[Row] = []
    for subset in ("all", "ids", "reacquired"):
        for subject, setting in settings_of_rows(findings):
            if setting.budget != "equal" or setting == subject.truth:
                continue
            row = findings.row(setting, subset)
            gap = Row(
                targets_of=subset_name(subset),
                agent=row.agent,
                H=row.hypotheses,
                closed=row.gap_closed,
                closed_interval=row.gap_interval,
                closed_own_predictor=row.gap_closed_same_predictor,
                closed_own_predictor_interval=row.gap_same_predictor_interval,
                energy_score=row.energy_score,
                paper_closed=paper_gap(findings.bench.of_paper, row) if subset == "ids" else None,
            )
            rows += [] if gap in rows else [gap]  # a control stands beside every subject
    yield from rows


def cut_rows(findings: Findings) -> Iterator[Row]:
    """Scores of the baselines above each score threshold of the detections."""
    for cut in findings.cuts:
        for agent, error in cut.all.items():
            paired = agent == threshold_agents()[1]
            yield Row(
                true_detections_below=cut.threshold,
                agent=agent,
                error=error,
                error_ids=cut.ids.get(agent),
                switches_of_stp=cut.switches,
                mtp_minus_control_ids=cut.beyond_control.get("ids") if paired else None,
                mtp_minus_control_ids_interval=cut.interval.get("ids") if paired else None,
                p=cut.p.get("ids") if paired else None,
            )
