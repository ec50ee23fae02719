"""Page of scored runs: their table, and the causes and worst moments of each."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from ...core import NO_PROGRESS, Table, to_html
from ...running import OpenedRun
from ...scoring import Report, main_table, place_of
from ..causes import sentence
from ..drawing.report import report as drawn_report
from ..focus import Focus
from ..pages import data_uri, page_of
from ..played import replays
from ..terminal.notes import warnings
from ..terminal.tables import paired_table
from ..terminal.verdict import verdict
from ..terminal.worst_table import UNSPLIT, WORST_CAPTION, run_line, worst_table
from ..worst_moments import worst_moments

_TEMPLATES = Path(__file__).parent
_MOMENTS = 5  # of a run
_PICTURES = 2


@dataclass(frozen=True)
class _RunPart:
    """What the page shows of a run."""

    agent: str
    causes: str
    moments: Table
    pictures: list[tuple[str, str]]  # sentence and address of each


def meeting_page(report: Report, runs: Sequence[OpenedRun]) -> str:
    """Return the HTML of a page for a meeting.

    ``report``: of the ``runs``. It has no script and loads no other file.
    """
    names = [opened.run.info.agent for opened in runs]
    tables = [main_table(report)]
    if report.paired:
        tables.append(paired_table(report))
    return page_of(
        _TEMPLATES,
        "meeting.html",
        place=place_of(report),
        lines=[verdict(report, names), *warnings(report)],
        tables=tables,
        to_html=to_html,
        caption=WORST_CAPTION,
        runs=[_run_part(opened) for opened in runs],
    )


def _run_part(opened: OpenedRun) -> _RunPart:
    worst = worst_moments(opened, no_doctor=True)
    causes = run_line(worst.parts, len(opened.run.rollouts))
    if worst.unsplit:
        causes = f"{causes} {UNSPLIT.format(worst.unsplit)}"
    pictures = []
    for row in worst.rows[:_PICTURES]:
        (played,) = replays(opened, row.scene.name, NO_PROGRESS, no_doctor=True)
        focus = Focus(played, row.incident)
        png = BytesIO()
        drawn_report(focus).quantize(128).save(png, format="PNG", optimize=True)
        pictures.append((sentence(focus), data_uri(png.getvalue(), "image/png")))
    moments = worst_table(worst.rows[:_MOMENTS], worst.cost)
    return _RunPart(opened.run.info.agent, causes, moments, pictures)
