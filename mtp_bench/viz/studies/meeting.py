"""Page of scored runs: their table, and the causes and worst moments of each."""

from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path

from ...core import NO_PROGRESS
from ...running import OpenedRun
from ...scoring import Report, main_table
from ..causes import sentence
from ..drawing.report import report as drawn_report
from ..focus import Focus
from ..pages import data_uri
from ..played import replays
from ..run_moments import worst_moments
from ..terminal.notes import warnings
from ..terminal.tables import paired_table
from ..terminal.verdict import verdict
from ..terminal.worst_table import UNSPLIT, WORST_CAPTION, run_line, worst_table
from .figures import DrawnFigure
from .study import Study, study_page

_MOMENTS = 5  # of a run
_PICTURES = 2


def meeting_page(report: Report, runs: Sequence[OpenedRun]) -> str:
    """Return the HTML of a page for a meeting.

    ``report``: of the ``runs``. It has no script and loads no other file.
    """
    tables = {"main": main_table(report)}
    if report.paired:
        tables["differences"] = paired_table(report)
    findings = [verdict(report, [opened.run.info.agent for opened in runs])]
    figures = []
    for opened in runs:
        agent = opened.run.info.agent
        worst = worst_moments(opened, no_doctor=True)
        findings.append(f"{agent}: {run_line(worst.parts, len(opened.run.rollouts))}")
        if worst.unsplit:
            findings.append(f"{agent}: {UNSPLIT.format(worst.unsplit)}")
        moments = worst_table(worst.rows[:_MOMENTS], worst.cost)
        title = f"Worst moments of {agent}"
        tables[title] = replace(moments, title=title, sentence=WORST_CAPTION)
        for row in worst.rows[:_PICTURES]:
            (played,) = replays(opened, row.scene.name, NO_PROGRESS, no_doctor=True)
            focus = Focus(played, row.incident)
            png = BytesIO()
            drawn_report(focus).quantize(128).save(png, format="PNG", optimize=True)
            picture = data_uri(png.getvalue(), "image/png")
            figures.append(DrawnFigure("", agent, sentence(focus), picture))
    shown = Study(Path(), report, tables, figures, findings, [*warnings(report)])
    return study_page(shown, "")
