"""The tables of the paper, each with the paper's own numbers beside ours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ...running.settings import Setting
from ...scoring.subsets import Subset
from ...viz.terminal.paper import PAPER_SUBSETS, figures_of, paper_facts
from ..findings import Findings
from ..plan import HEDGED, SAME_BUDGET, Subject
from ..table import Count, Metres, Number, Share, Table, Text

EVENTS: tuple[Subset, ...] = ("paper_ids", "paper_frag", "ids", "reacquired")


@dataclass(frozen=True)
class PastRow:
    """One kind of input to the predictor on one subset."""

    agent: Text
    targets_of: Text
    past: Text  # "true pasts" or "tracklets"
    minADE: Metres  # noqa: N815
    minADE_low: Metres  # noqa: N815
    minADE_high: Metres  # noqa: N815
    minFDE: Metres  # noqa: N815
    plain_error: Metres
    plain_low: Metres
    plain_high: Metres
    coverage: Share
    targets: Count
    objects: Count
    events: Number
    paper_minADE: Metres  # noqa: N815
    paper_minFDE: Metres  # noqa: N815
    paper_objects: Number


def past_table(found: Findings) -> Table:
    """Table I of the paper: true pasts against tracklets, where there are events."""
    rows = []
    for subject in found.plan.subjects:
        for subset in (*EVENTS, "all"):
            for past, setting in (("true pasts", subject.truth), ("tracklets", subject.end)):
                rows.append(_past_row(found, subject, subset, past, setting))
    return Table(
        "pasts",
        "True pasts against tracklets",
        "What the same predictor makes of true pasts and of the tracks of one hypothesis, on targets with an event. "
        "minADE and minFDE are over targets with a forecast; the plain error counts a missing forecast as the miss "
        "error. ids and reacquired weigh targets by how often a reference tracker has the event; IDS and FRAG are the "
        "targets where plain STP has it, the paper's condition.",
        rows,
    )


def _past_row(found: Findings, subject: Subject, subset: Subset, past: str, setting: Setting) -> PastRow:
    row, table = found.row(setting, subset), found.table(setting)
    plain = found.mean(table, table.capped, table.weight[subset])
    ade = found.covered_mean(table, table.min_ade, table.weight[subset])
    key = PAPER_SUBSETS.get(subset, "")
    who = "truth_past" if past == "true pasts" else "stp"
    papers = figures_of(found.bench.of_paper, who, "equal", 1).get(key, [None, None])
    return PastRow(
        agent=subject.name,
        targets_of=subset_name(subset),
        past=past,
        minADE=row.minADE,
        minADE_low=ade.low,
        minADE_high=ade.high,
        minFDE=row.minFDE,
        plain_error=plain.value,
        plain_low=plain.low,
        plain_high=plain.high,
        coverage=row.coverage,
        targets=row.targets,
        objects=row.objects,
        events=row.events,
        paper_minADE=papers[0],
        paper_minFDE=papers[1],
        paper_objects=paper_facts(found.bench.of_paper, "objects").get(key),
    )


def subset_name(subset: Subset) -> str:
    """What a subset is called on the page."""
    return {"all": "all", "paper_ids": "IDS", "paper_frag": "FRAG"}.get(subset, subset)


@dataclass(frozen=True)
class GainRow:
    """One setting on one subset."""

    targets_of: Text
    agent: Text
    H: Count
    k: Count
    sampling: Text
    minADE: Metres  # noqa: N815
    minFDE: Metres  # noqa: N815
    plain_error: Metres
    error: Metres
    error_low: Metres
    error_high: Metres
    to_single: Metres  # of what ranks, to one hypothesis at equal k
    to_single_low: Metres
    to_single_high: Metres
    p: Number
    coverage: Share
    targets: Count
    objects: Count
    paper_minADE: Metres  # noqa: N815
    paper_minFDE: Metres  # noqa: N815


def targeted_table(found: Findings) -> Table:
    """Table II of the paper: targets with events, over H and k."""
    rows = [row for subset in EVENTS for row in _gain_rows(found, subset)]
    return Table(
        "targeted",
        "Targeted evaluation: where identities err",
        "Targets with events, over the number of hypotheses H, with all samples of all hypotheses and with k of them. "
        "stp_same_budget draws as many samples as 20 hypotheses from one: only what is won beyond it is due to "
        "hypotheses. More samples lower minADE without any skill, so rows of different k do not compare.",
        rows,
    )


def everything_table(found: Findings) -> Table:
    """Table III of the paper: all targets, over H and k."""
    return Table(
        "global",
        "Global evaluation: all targets",
        "All targets, over the number of hypotheses H, with all samples and with k. The error is that which ranks: "
        "averaged over budgets of false forecasts.",
        _gain_rows(found, "all"),
    )


def _gain_rows(found: Findings, subset: Subset) -> list[GainRow]:
    return [_gain_row(found, subject, setting, subset) for subject, setting in settings_told(found)]


def settings_told(found: Findings) -> Iterator[tuple[Subject, Setting]]:
    """Settings of Tables II and III, each with the subject that it stands beside."""
    for subject in found.plan.subjects:
        controls = [s for s in found.plan.controls if s.label in (SAME_BUDGET, HEDGED)]
        equal = [setting for setting in subject.equal.values() if setting != subject.single]
        for setting in [subject.truth, subject.single, *controls, *equal, *subject.free.values()]:
            yield subject, setting


def _gain_row(found: Findings, subject: Subject, setting: Setting, subset: Subset) -> GainRow:
    row = found.row(setting, subset)
    paired = None
    if setting.budget == "equal" and setting is not subject.single:
        paired = found.difference(setting, subject.single, subset)
    low, high = row.interval or (None, None)
    pair_low, pair_high = (paired and paired.interval) or (None, None)
    papers = paper_numbers(found, subject, setting, subset)
    return GainRow(
        targets_of=subset_name(subset),
        agent=setting.label,
        H=row.hypotheses,
        k=row.samples,
        sampling="–" if row.hypotheses == 1 else "k of all" if setting.budget == "equal" else "none",
        minADE=row.minADE,
        minFDE=row.minFDE,
        plain_error=row.plain_error,
        error=row.error,
        error_low=low,
        error_high=high,
        to_single=paired.error if paired else None,
        to_single_low=pair_low,
        to_single_high=pair_high,
        p=paired.p if paired else None,
        coverage=row.coverage,
        targets=row.targets,
        objects=row.objects,
        paper_minADE=papers[0],
        paper_minFDE=papers[1],
    )


def paper_numbers(
    found: Findings, subject: Subject, setting: Setting, subset: Subset
) -> tuple[float | None, float | None]:
    """The paper's minADE and minFDE for what a setting stands for."""
    key = PAPER_SUBSETS.get(subset, "")
    role = "truth_past" if setting == subject.truth else "stp" if setting == subject.single else "mtp"
    if setting in found.plan.controls and role == "mtp":
        return None, None
    hypotheses = setting.hypotheses or 1
    figures = figures_of(found.bench.of_paper, role, setting.budget, hypotheses).get(key)
    return (None, None) if figures is None else (figures[0], figures[1])
