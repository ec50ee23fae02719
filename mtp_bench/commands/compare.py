"""``mtp-bench compare``."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from ..running.compare import compare as run_comparison
from ..running.compare import control_names, sensitivity
from ..viz.terminal.output import counted, report_table, show, show_lines, show_numbers
from ..viz.terminal.tables import sensitivity_table
from ..viz.terminal.verdict import verdict
from .completion import submissions
from .options import SEEDS, EnvScenes, FullOption, JsonOption, TableOption, WorkerChoice
from .output import prepare, require_writable, show_report, working, write_json


def compare(
    agents: Annotated[
        list[str], typer.Argument(help="Names of baselines or folders of submissions.", autocompletion=submissions)
    ],
    on: EnvScenes,
    workers: WorkerChoice,
    seeds: Annotated[int, typer.Option(min=1, help="Runs with different random draws.")] = SEEDS,
    full: FullOption = False,
    cuts: Annotated[
        str | None,
        typer.Option(
            help="Also stp, mtp and their control with detections above these scores (.1,.3); alone: .1,.2,.3."
        ),
    ] = None,
    table_file: TableOption = None,
    json_file: JsonOption = None,
) -> None:
    """Run agents side by side, with ground-truth tracks and the controls: the verdict, and one table."""
    at = None if cuts is None else scores_of(cuts)
    require_writable(json_file, table_file)
    options = on.options(workers, range(seeds))
    prepare(on.env, options, agents)
    with working("compare", options) as watched:
        result = run_comparison(agents, on.env, watched)
    content = result.report.to_json("condition", "paired", "details") | {"skipped": result.skipped}
    rows = None
    if at is not None:
        with working("cuts", options) as watched:
            rows = sensitivity(on.env, result.reference, watched, at)
        content["sensitivity"] = [row.model_dump(mode="json") for row in rows]
    write_json(json_file, content)
    ran = dict.fromkeys(setting.submission.name for setting in result.settings)
    show_lines(verdict(result.report, [name for name in ran if name in agents or name not in control_names()]), "- ")
    show("")
    show_report(result.report, counted(seeds, "seed"), result.skipped, full, table_file)
    if rows is not None:
        show("")
        show_numbers(report_table(sensitivity_table(rows)))


def scores_of(text: str) -> list[float]:
    """Scores of a comma-separated text; wrong usage for others."""
    try:
        scores = [float(part) for part in text.split(",")]
    except ValueError:
        scores = []
    if not scores or not all(map(math.isfinite, scores)):
        expected = "numbers such as .1,.2,.3, or nothing after it; agents stand before"
        raise typer.BadParameter(f"{text!r}, expected {expected}", param_hint="--cuts")
    return scores
