"""Notes below the tables of a report: warnings, and what the columns mean."""

from collections.abc import Iterator

from ...scoring import Report
from ...scoring.main_table import shipped_env
from ...scoring.parts import PARTS
from ...scoring.rank import ASSOCIATED, NOT_CAUSAL, SAW_TRUTH
from ...scoring.report import rejected_line
from ...scoring.rows import Row
from ...tables import BLANK, Column, short
from .output import counted
from .paper import paper_figures

REFERENCES = (SAW_TRUTH, ASSOCIATED)  # reasons of `why_unranked`
_LEAST = 0.005  # m: smaller parts are left out of a line
_METRES = Column(format=".2f")


def notes(report: Report) -> list[str]:
    """Meaning of the columns of the tables, and of a star in them."""
    guessed = "* {} states no parents: lineage of own events guessed in {:.0%} of frames"
    shares = [(each.agent, each.guessed_parents) for each in report.details if each.guessed_parents]
    return [_about(report), *(guessed.format(*share) for share in shares)]


def label_of(row: Row) -> str:
    """The agent of a row, with its number of hypotheses."""
    return f"{row.agent} (H = {row.hypotheses})" if row.hypotheses > 1 else row.agent


def parts_text(row: Row) -> str:
    """The parts of bADE of a row in one line, without those below half a centimetre."""
    parts = ((name, getattr(row, f"cost_{key}")) for key, name in PARTS.items())
    return ", ".join(f"{name} {_METRES.text(part)}" for name, part in parts if abs(part or 0.0) >= _LEAST)


def _about(report: Report) -> str:
    known = report.condition.get("truth", "complete") == "complete"
    budgets = "" if known else " Budgets are of all forecasts per live frame, as it is not known which are false."
    empty = next((details.silence for details in report.details), None)
    nothing = "" if empty is None else f" c, if nothing is predicted: {short(empty)}."
    env = shipped_env(report)
    paper = " (paper): the paper's numbers." if any(paper_figures(env, row) for row in report.rows) else ""
    return (
        "minADE/FDE: of the targets with a forecast (cov.); IDS, FRAG: where plain STP has that event, as in the paper."
        f"{paper}{budgets}{nothing} {BLANK} as a rank: shown only. Definitions {report.definitions}."
    )


def warnings(report: Report) -> Iterator[str]:
    """Lines that no reader may miss: agents that failed, no targets, no forecasts near them, rejected rows."""
    for agent, why in report.failures.items():
        yield f"! {agent} {why}"
    honest = [row for row in report.rows if row.subset == "all" and row.unranked_because not in REFERENCES]
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
        if rejected := sum(each.invalid.values()):
            yield rejected_line(each.agent, rejected)
