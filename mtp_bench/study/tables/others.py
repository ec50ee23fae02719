"""The paper's tables of speed and of people, each with the paper's own numbers beside ours."""

from __future__ import annotations

from dataclasses import dataclass

from ...viz.terminal.paper import paper_facts
from ..findings import Findings
from ..retracking import AGAIN, PLAIN, is_of_people
from ..table import Count, Metres, Milliseconds, Number, PerSecond, Share, Table, Text


@dataclass(frozen=True)
class SpeedRow:
    """What a frame takes with H hypotheses."""

    H: Count
    tracking: Milliseconds
    prediction: Milliseconds
    whole: Milliseconds
    tracking_rate: PerSecond
    prediction_rate: PerSecond
    frames: Count
    paper_tracking_rate: PerSecond
    paper_prediction_rate: PerSecond


def speed_table(found: Findings) -> Table:
    """Table IV of the paper: speed by stage over H."""
    papers = paper_facts(found.bench.of_paper, "speed")
    rows = []
    for speed in found.speed:
        stages = speed.tracking, speed.prediction
        tracked, predicted = (1e3 / milliseconds if milliseconds else None for milliseconds in stages)
        theirs = [papers.get(stage, {}).get(str(speed.hypotheses)) for stage in ("tracking", "prediction")]
        rows.append(SpeedRow(speed.hypotheses, *stages, speed.whole, tracked, predicted, speed.frames, *theirs))
    return Table(
        "speed",
        "Speed by stage",
        f"What a frame takes {found.subject.name}, one core, timed apart from other runs. Prediction includes "
        "sampling, presence and the answer. The paper's predictor is another one, and ran on a GPU.",
        rows,
    )


@dataclass(frozen=True)
class PeopleRow:
    """One row of the paper's table of people."""

    agent: Text
    retracking: Text
    H: Count
    minADE: Metres  # noqa: N815
    minFDE: Metres  # noqa: N815
    error: Metres
    error_low: Metres
    error_high: Metres
    to_plain: Metres
    to_plain_low: Metres
    to_plain_high: Metres
    p: Number
    coverage: Share
    targets: Count
    paper_minADE: Metres  # noqa: N815
    paper_minFDE: Metres  # noqa: N815


def people_table(found: Findings) -> Table:
    """Table V of the paper: re-tracking and hypotheses, alone and together."""
    rows = []
    papers = paper_facts(found.bench.of_paper, "people")
    names = ("plain", "retracking", "hypotheses", "both")
    for name, setting in zip(names, found.plan.retracking, strict=False):
        row = found.row(setting, "all")
        paired = None if name == "plain" else found.difference(setting, found.plan.retracking[0], "all")
        low, high = row.interval or (None, None)
        pair_low, pair_high = (paired and paired.interval) or (None, None)
        figures = papers.get(name, [None, None])
        rows.append(
            PeopleRow(
                agent=setting.submission.name if name in ("plain", "both") else setting.label,
                retracking="yes" if name in ("retracking", "both") else "no",
                H=row.hypotheses,
                minADE=row.minADE,
                minFDE=row.minFDE,
                error=row.error,
                error_low=low,
                error_high=high,
                to_plain=paired.error if paired else None,
                to_plain_low=pair_low,
                to_plain_high=pair_high,
                p=paired.p if paired else None,
                coverage=row.coverage,
                targets=row.targets,
                paper_minADE=figures[0],
                paper_minFDE=figures[1],
            )
        )
    return Table(
        "people",
        "Re-tracking and hypotheses",
        "SORT and Social-LSTM, with re-tracking, with 20 hypotheses, and with both: the paper's table on WILDTRACK.",
        rows,
    )


def people_missing(found: Findings) -> str:
    """Why the table of people is not there, and how to get it; empty where it is there, or nobody expects it."""
    if not is_of_people(found.bench.card) or found.plan.retracking:
        return ""
    return (
        f"The table of re-tracking ({PLAIN}, {AGAIN} and both with hypotheses) needs a network that was not trained on "
        f"this machine: mtp-bench train predictor social_lstm --env {found.bench.card.id}, then the same study again."
    )
