"""``mtp-bench run``."""

from pathlib import Path
from typing import Annotated

from typer import Option

from ..running import require_free, run as run_agent, skipped_line
from ..scoring import rejected_line
from ..viz import command_line, counted, show
from .options import AgentScenes, SubmissionArgument, WorkerChoice
from .output import prepare


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
    prepare(on.card, options, [agent])
    stored = run_agent(agent, on.card, output, options, replace=force)
    line = skipped_line(stored.skipped)
    if line is not None:
        show(line)
    if stored.rejected:
        show(rejected_line(agent, stored.rejected))
    scenes = counted(stored.scenes, "scene")
    score = command_line("score", str(output), data=on.data)
    show(f"{scenes} of {on.env} by {agent} in {output}; score with `{score}`")
