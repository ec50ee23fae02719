"""``mtp-bench study``."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Exit, Option

from ..agent import controls
from ..viz import (
    command_line,
    require_study_folder,
    show,
    show_lines,
    study as run_study,
)
from .options import SEEDS, AgentScenes, WorkerChoice
from .output import prepare

QUICK_SCENES = 6


def study(
    on: AgentScenes,
    workers: WorkerChoice,
    agent: Annotated[
        list[str] | None,
        Option(
            help="Name of a baseline or folder of a submission; repeatable. "
            f"Default: {controls()['several']}.",
        ),
    ] = None,
    output: Annotated[
        Path, Option("-o", "--output", help="Folder of the page, tables and figures.")
    ] = Path("study"),
    quick: Annotated[
        bool,
        Option(
            "--quick",
            help=f"A first look: {QUICK_SCENES} scenes and one seed, "
            "unless --scenes and --seeds say otherwise.",
        ),
    ] = False,
    seeds: Annotated[
        int | None,
        Option(
            min=1, max=1000, help=f"Runs with different random draws. Default: {SEEDS}."
        ),
    ] = None,
) -> None:
    """Compare agents, and write a page, tables, figures and a notebook."""
    require_study_folder(output.absolute())
    default_seeds = 1 if quick else SEEDS
    options = on.options(workers, range(seeds or default_seeds))
    if quick and options.scenes is None:
        options = replace(options, scenes=QUICK_SCENES)
    agents = agent or [controls()["several"]]
    doubts = prepare(on.card, options, agents, on.no_doctor)
    command = command_line(*sys.argv[1:])
    result = run_study(agents, on.card, output, options, command, doubts)
    show_lines(result.findings, "- ")
    show_lines(result.warnings)
    page = output / result.page.name
    show(f"{len(result.tables)} tables, {len(result.figures)} figures: {page}")
    if result.report.failures:
        raise Exit(1)
