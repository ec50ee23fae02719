"""``mtp-bench run``, ``score`` and ``export``: stored runs."""

from pathlib import Path
from typing import Annotated

from typer import Option

from ..running import (
    RunOptions,
    export_tracks,
    open_run,
    require_free,
    run as run_agent,
    score as score_run,
    skipped_line,
)
from ..scoring import rejected_line
from ..viz import command_line, counted, show
from .options import (
    AgentScenes,
    DataOption,
    FolderArgument,
    JsonOption,
    RunCardOption,
    SubmissionArgument,
    WorkerChoice,
)
from .output import prepare, write_json
from .shown import Shown, show_report


def run(
    agent: SubmissionArgument,
    on: AgentScenes,
    workers: WorkerChoice,
    output: Annotated[Path, Option("-o", "--output", help="Folder for the rollouts.")],
    seed: Annotated[int, Option(min=0, help="Seed of the run.")] = 0,
    force: Annotated[
        bool, Option("--force", help="Replace an earlier run in that folder.")
    ] = False,
) -> None:
    """Run an agent and store its rollouts."""
    options = on.options(workers, [seed])
    require_free(output, force)
    prepare(on.card, options, [agent], on.no_doctor)
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
    folder: FolderArgument,
    shown: Shown,
    root: DataOption = None,
    env: RunCardOption = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    scored = score_run(folder, RunOptions(root), env)
    report = scored.report
    content = report.to_json("condition", "details")
    write_json(json_file, {**content, "skipped": scored.skipped})
    show_report(report, folder.name, scored.skipped, shown)


def export(
    folder: FolderArgument,
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            help="nuScenes: a file (.json); Argoverse 2: a .feather file; "
            "else a folder.",
        ),
    ],
    table: Annotated[
        bool, Option("--table", help="Tables: a folder with a .csv for each scene.")
    ] = False,
    root: DataOption = None,
    env: RunCardOption = None,
) -> None:
    """Write the tracks of a stored run in the formats of other benchmarks.

    These are result files of KITTI, nuScenes or Argoverse 2, or tables.
    """
    boxes = export_tracks(open_run(folder, root, env), output, table)
    show(f"{output}: {counted(boxes, 'tracked position')}")
