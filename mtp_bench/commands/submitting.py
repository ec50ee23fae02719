"""Commands of the leaderboard: from an empty folder to a place on it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .shared import (
    BackendOption,
    DataOption,
    EnvOption,
    JobsOption,
    JsonOption,
    SchedulerOption,
    prepare,
    require_backend_options,
    require_writable,
    workers,
    write_json,
)


def new(
    name: Annotated[str, typer.Argument(help="Name of the submission: lower case.")],
    folder: Annotated[Path, typer.Option("--folder", help="Where its folder is made.")] = Path(),
) -> None:
    """Begin a submission: a folder with an agent that works."""
    from ..viz.terminal.output import show
    from .beginning import begin

    show(begin(name, folder))


def check(
    path: Annotated[str, typer.Argument(help="Folder of a submission or name of a baseline.")],
    env: Annotated[
        str, typer.Option("--env", help="Environment to check on; `mtp-bench envs` lists them.")
    ] = "MTP-Intersection-v0",
    root: DataOption = None,
    json_file: JsonOption = None,
) -> None:
    """Check that a submission keeps the contract, and score three scenes beside STP. Status 1 for errors."""
    from ..viz.terminal.output import progress_bar, show, show_numbers
    from .checking import SCENES, check_submission, finding_table, score_table, verdict

    require_writable(json_file)
    prepare(env, root, SCENES, 0, {})
    with progress_bar("check") as (started, done):
        checked = check_submission(path, env, root, started, done)
    write_json(json_file, checked.to_json())
    show(finding_table(checked))
    if checked.scores:
        show_numbers(score_table(checked))
    show(verdict(checked, path))


def submit(
    path: Annotated[str, typer.Argument(help="Folder of a submission or name of a baseline.")],
    env: Annotated[list[str], typer.Option("--env", help="Environment id; repeatable.")],
    root: DataOption = None,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Runs with different random draws and frames.")] = 3,
    scenes: Annotated[
        int | None, typer.Option("--scenes", min=1, help="Only the first N scenes: a partial record, never ranked.")
    ] = None,
    split: Annotated[
        str | None, typer.Option("--split", help="Another split, such as train: a partial record, never ranked.")
    ] = None,
    jobs: JobsOption = 0,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder; leaderboard/records/<name> by default.")
    ] = None,
    division: Annotated[str, typer.Option("--division", help="closed or open.")] = "closed",
    training_data: Annotated[
        list[str] | None,
        typer.Option("--training-data", help="Data it was trained on beside what its manifest says."),
    ] = None,
    backend: BackendOption = "loky",
    scheduler: SchedulerOption = None,
) -> None:
    """Run a submission behind the gateway and write its records for the leaderboard."""
    from .records import DIVISIONS, submit_all

    if division not in DIVISIONS:
        raise typer.BadParameter(f"{division!r}, expected one of: {', '.join(DIVISIONS)}", param_hint="--division")
    require_backend_options(backend, scheduler)
    trained = training_data or ()
    submit_all(path, env, root, seeds, scenes, workers(jobs), output, division, trained, scheduler, split)


def verify(
    record: Annotated[Path, typer.Argument(help="A record, or a folder: all records in it.")],
    root: DataOption = None,
    rerun: Annotated[bool, typer.Option("--rerun", help="Run the submission again, also under a secret seed.")] = False,
    submission: Annotated[
        Path | None, typer.Option("--submission", help="Folder to run again; else the baseline of that name.")
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write the level reached, or new numbers where the scorer changed.")
    ] = False,
    hidden: Annotated[
        Path | None, typer.Option("--hidden", help="Secret of `mtp-bench seal`: with --rerun, run its scenes too.")
    ] = None,
    commitment: Annotated[
        Path | None, typer.Option("--commitment", help="What the secret was promised with; the file beside it.")
    ] = None,
    jobs: JobsOption = 0,
    env: Annotated[str | None, typer.Option("--env", help="Card of the record, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check records: digest, card, data, and stored rollouts scored again. Status 1 where one does not hold."""
    from .records import verify_all

    if submission is not None and not rerun:
        raise typer.BadParameter("is for running it again: add --rerun", param_hint="--submission")
    if hidden is not None and not rerun:
        raise typer.BadParameter("is for running the submission: add --rerun", param_hint="--hidden")
    if commitment is not None and hidden is None:
        raise typer.BadParameter("belongs to a secret: name it with --hidden", param_hint="--commitment")
    require_writable(json_file)
    verify_all(record, root, env, submission, rerun, write, workers(jobs), json_file, hidden, commitment)


def seal(
    env: EnvOption,
    scenes: Annotated[int, typer.Option("--count", min=1, max=1000, help="Number of hidden scenes.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File of the secret; its commitment goes beside it.")],
) -> None:
    """Draw secret scenes of a simulated environment and commit to them (maintainers)."""
    from .records import seal_env

    seal_env(env, scenes, output)


def board(
    further: Annotated[
        list[Path] | None, typer.Option("--with", help="A record to place among the others; repeatable.")
    ] = None,
    records: Annotated[
        Path | None, typer.Option("--records", help="Folder of records; those that ship by default.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Also write a page that needs no network: a .html file.")
    ] = None,
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Show the leaderboard: a table per environment, and a page to open in a browser."""
    from .standings import show_board

    for path in (json_file, output):
        require_writable(path)
    show_board(records, further or (), env, output, json_file)
