"""Lines below the tables of a report: meanings and warnings."""

from collections.abc import Iterator

from ...core import BLANK, short
from ...scoring import ASSOCIATED, FROM_FILE, NOT_CAUSAL, SAW_TRUTH, Report, Row
from .output import counted

REFERENCES = (SAW_TRUTH, ASSOCIATED)  # reasons of `why_unranked`


def label_of(row: Row) -> str:
    """Return the agent of a row, with several hypotheses counted."""
    if row.hypotheses == 1:
        return row.agent
    return f"{row.agent} (H = {row.hypotheses})"


def notes(report: Report) -> list[str]:
    """Return the meaning of the columns, and of a star."""
    lines = [_column_note(report)]
    for details in report.details:
        if details.guessed_parents:
            lines.append(
                f"* {details.agent} states no parents: lineage of own events guessed "
                f"in {details.guessed_parents:.0%} of frames"
            )
    return lines


def _column_note(report: Report) -> str:
    """Return the meaning of the columns that a report has."""
    meaning = (
        "minADE/FDE: of the targets with a forecast (cov.); IDS, FRAG: where plain "
        "STP has that event, as in the paper."
    )
    sentences = [meaning]
    if report.details:
        error = report.details[0].nothing_predicted  # the same for all agents
        if error is not None:
            sentences.append(f"c, if nothing is predicted: {short(error)}.")
    sentences += [
        f"{BLANK} as a rank: shown only.",
        f"Definitions {report.definitions}.",
    ]
    return " ".join(sentences)


def warnings(report: Report) -> Iterator[str]:
    """Yield lines that no reader may miss, such as failures."""
    for agent, reason in report.failures.items():
        yield f"! {agent} {reason}"
    yield from _coverage_warnings(report)
    never_ranked = [
        f"{row.agent}: never ranked, {row.unranked_because}"
        for row in report.rows
        if row.unranked_because in (NOT_CAUSAL, FROM_FILE)
    ]
    yield from dict.fromkeys(never_ranked)  # once, not per subset
    dropped = max((details.dropped_detections for details in report.details), default=0)
    if dropped:
        yield (
            f"! {counted(dropped, 'detection')} not shown to agents: beyond the range "
            "or the number of the task"
        )
    yield from report.notes()


def _coverage_warnings(report: Report) -> Iterator[str]:
    """Yield a warning if targets are missing, or all forecasts are off them."""
    if report.rows and not report.rows[0].targets:
        yield (
            "! there is no target: no object that may be one is present in all past "
            "and future frames"
        )
        return
    rows = _rankable_rows(report)
    agents = {row.agent for row in rows}
    forecasts = sum(
        details.forecasts_per_frame
        for details in report.details
        if details.agent in agents
    )
    if forecasts and not any(row.coverage for row in rows):
        yield (
            "! no forecast is near a target: are detections and truth in one frame of "
            "reference, in metres?"
        )


def _rankable_rows(report: Report) -> list[Row]:
    """Return the rows of agents that did not see the truth."""
    return [
        row
        for row in report.rows
        if row.subset == "all" and row.unranked_because not in REFERENCES
    ]
