"""``mtp-bench run``, ``score`` and ``export``: stored runs."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from ..core import Table, long_work, to_text, write_text
from ..running import (
    ForecastForm,
    RunOptions,
    export_forecasts,
    export_tracks,
    measured_delay,
    official_scores,
    open_run,
    open_runs,
    require_free,
    run as run_agent,
    score_opened,
    skipped_line,
)
from ..scoring import rejected_line
from ..viz import command_line, counted, meeting_page, show
from .options import (
    AgentScenes,
    DataOption,
    FolderArgument,
    JsonOption,
    SubmissionArgument,
    WorkerChoice,
    choice,
    file_option,
)
from .output import prepare, write_json
from .shown import Shown, show_differences, show_report

_OFFICIAL = (
    "MFEval and UniAD choose and match targets in their own ways; MR counts matched "
    "targets alone. The page docs/definitions/official.md defines each number."
)


def run(
    agent: SubmissionArgument,
    on: AgentScenes,
    workers: WorkerChoice,
    output: Annotated[Path, Option("-o", "--output", help="Folder for the rollouts.")],
    seed: Annotated[int, Option(min=0, help="Seed of the run.")] = 0,
    force: Annotated[
        bool, Option("--force", help="Replace an earlier run in that folder.")
    ] = False,
    delay: Annotated[
        str | None,
        choice(
            ["measured"],
            "--delay",
            text="measured: detections come late by the agent's own time, in whole "
            "frames.",
        ),
    ] = None,
) -> None:
    """Run an agent and store its rollouts."""
    options = on.options(workers, [seed])
    require_free(output, force)
    prepare(on.card, options, [agent], on.no_doctor)
    if delay is not None:
        frames = measured_delay(agent, on.card, options)
        options = replace(options, perturb={**(options.perturb or {}), "delay": frames})
        show(
            f"{agent} takes the time of {frames} whole frames: --perturb delay={frames}"
        )
    stored = run_agent(agent, on.card, output, options, replace=force)
    line = skipped_line(stored.skipped)
    if line is not None:
        show(line)
    if stored.rejected:
        show(rejected_line(agent, stored.rejected))
    scenes = counted(stored.scenes, "scene")
    score = command_line("score", str(output), data=on.data)
    show(f"{scenes} of {on.env} by {agent} in {output}; score with `{score}`")


def score(
    folders: Annotated[
        list[Path], Argument(help="Folders of stored runs, compared with each other.")
    ],
    shown: Shown,
    root: DataOption = None,
    samples: Annotated[
        int | None,
        Option(min=1, help="Count only so many of each object's heaviest samples."),
    ] = None,
    page: Annotated[
        Path | None,
        file_option(
            "--page",
            text="Write a page for a meeting: table, causes, worst moments, pictures.",
            suffixes=(".html",),
        ),
    ] = None,
    json_file: JsonOption = None,
    official: Annotated[
        bool,
        Option(
            "--official",
            help="Numbers of MFEval and UniAD, too. nuScenes, forecasts of 6 s.",
        ),
    ] = False,
) -> None:
    """Score stored rollouts; several runs are tested against each other."""
    title = ", ".join(folder.name for folder in folders)
    rows = []
    with long_work(f"scoring {title}") as progress:
        runs = open_runs(folders, root, samples=samples)
        if official:
            rows = [row for opened in runs for row in official_scores(opened)]
        scored = score_opened(runs, RunOptions(root, progress=progress))
    report = scored.report
    content = report.to_json("condition", "paired", "details")
    if rows:
        content["official"] = [row.model_dump() for row in rows]
    write_json(json_file, {**content, "skipped": scored.skipped})
    names = [row.agent for row in report.rows]
    show_report(report, title, scored.skipped, shown, names)
    show_differences(report, shown)
    if rows:
        show("\n" + to_text(Table("official", "Official numbers", _OFFICIAL, rows)))
    if page is not None:
        with long_work("drawing the page"):
            write_text(page, meeting_page(report, runs))
        show(f"{page}: table, causes, worst moments and pictures")


def export(
    folder: FolderArgument,
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            help="Tracks of nuScenes: a .json file; of Argoverse 2: a .feather file; "
            "else a folder.",
        ),
    ],
    root: DataOption = None,
    forecasts: Annotated[
        bool, Option("--forecasts", help="The forecasts in place of the tracks.")
    ] = False,
    form: Annotated[
        ForecastForm | None,
        Option(
            help="table: a folder with a table for each scene. mfeval and uniad: "
            "forecasts in a .json file. Default: as the name of the output."
        ),
    ] = None,
) -> None:
    """Write the tracks or forecasts of a stored run in the formats of other benchmarks.

    Tracks are result files of KITTI, nuScenes or Argoverse 2, or tables.
    """
    if forecasts or form not in (None, "table"):
        opened = open_run(folder, root)
        written, left_out = export_forecasts(opened, output, form)
        show(
            f"{output}: {counted(written, 'object')}; left out: {left_out} of other classes"
        )
        return
    boxes = export_tracks(open_run(folder, root), output, form == "table")
    show(f"{output}: {counted(boxes, 'tracked position')}")
