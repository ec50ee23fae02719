"""``mtp-bench study``."""

import sys
from pathlib import Path
from typing import Annotated

from typer import BadParameter, Option

from ..agent import controls
from ..viz import (
    QUICK_SCENES,
    command_line,
    quick_options,
    require_study_folder,
    show,
    show_lines,
    study as run_study,
    summary,
)
from .options import SEEDS, AgentScenes, WorkerChoice, submissions
from .output import prepare


def study(
    on: AgentScenes,
    workers: WorkerChoice,
    agent: Annotated[
        list[str] | None,
        Option(
            help="Name of a baseline or folder of a submission; repeatable, the story is about the first. "
            f"Default: {controls()['several']}.",
            autocompletion=submissions,
        ),
    ] = None,
    output: Annotated[
        Path, Option("-o", "--output", help="Folder of the page, tables and figures.")
    ] = Path("study"),
    quick: Annotated[
        bool,
        Option(
            "--quick", help="A first look in a minute or two: few scenes, one seed."
        ),
    ] = False,
    seeds: Annotated[
        int | None,
        Option(
            min=1, max=1000, help=f"Random draws of ranked agents. Default: {SEEDS}."
        ),
    ] = None,
) -> None:
    """Write a page on the cost of detection and tracking on an environment: the paper's tables, figures and more."""
    require_study_folder(output.absolute())
    options = on.options(workers, range(1 if quick else seeds or SEEDS))
    if quick and ((seeds or 1) > 1 or (options.scenes or 1) > QUICK_SCENES):
        raise BadParameter(
            f"means one seed and at most {QUICK_SCENES} scenes; leave it out",
            param_hint="--quick",
        )
    options = quick_options(options) if quick else options
    prepare(on.card, options, agent or ())
    made = run_study(
        agent or [controls()["several"]],
        on.card,
        output,
        options,
        quick,
        command_line(*sys.argv[1:]),
    )
    show_lines(summary(made.findings), "- ")
    show("")
    show(f"{len(made.tables)} tables and {made.figures} figures: {made.page}")
