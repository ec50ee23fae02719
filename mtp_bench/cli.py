"""The command line: ``mtp-bench``. Exit status 0, 1 for a failure that the message explains, 2 for wrong usage."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .errors import MtpBenchError

if TYPE_CHECKING:
    from collections.abc import Callable

app = typer.Typer(
    help="Tracking and prediction together: your agent sees detections, not the truth.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

DataOption = Annotated[
    str | None, typer.Option("--data", help="Data root; else MTP_BENCH_DATA, else the user data folder.")
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the table's content to this file.")]
EnvOption = Annotated[str, typer.Option("--env", help="Environment id; `mtp-bench envs` lists them.")]
JobsOption = Annotated[int, typer.Option("--jobs", min=0, help="Processes; 0 takes one per core.")]
ScenesOption = Annotated[int | None, typer.Option("--scenes", min=1, help="Only the first N scenes.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the run.")]


@app.command()
def envs(json_file: JsonOption = None) -> None:
    """List the environments."""
    from ._bundle import card_ids
    from .cards import load_card
    from .viz.listings import env_table

    cards = [load_card(env_id) for env_id in card_ids()]
    _print(env_table(cards))
    _write_json(json_file, {card.id: {**card.model_dump(mode="json"), "digest": card.digest} for card in cards})


@app.command()
def data(
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None, root: DataOption = None
) -> None:
    """Show which data is found, what is missing and how to get it."""
    from ._bundle import card_ids
    from .cards import load_card
    from .sources import describe
    from .viz.listings import data_report

    cards = [load_card(env_id) for env_id in ([env] if env else card_ids())]
    statuses = {card.id: describe(card, root) for card in cards}
    _print(data_report(statuses))
    if not all(status.usable for status in statuses.values()):
        raise typer.Exit(1)


@app.command()
def run(
    agent: Annotated[str, typer.Argument(help="Name of a baseline or folder of a submission.")],
    env: EnvOption,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the rollouts.")],
    root: DataOption = None,
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    seed: SeedOption = 0,
) -> None:
    """Run an agent and store what it said."""
    from .submission.stored import run_and_store

    with _progress(agent) as (started, done):
        count = run_and_store(agent, env, output, root, scenes, _workers(jobs), seed, started, done)
    _print(f"{count} scenes of {env} by {agent} are in {output}; score them with `mtp-bench score {output}`")


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")],
    root: DataOption = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    from .submission.stored import score_stored
    from .viz.tables import displacement_table, error_table, parts_table

    with _progress("score") as (started, done):
        report, origin, dataset = score_stored(folder, root, started, done)
    _print(error_table(report, f"{report.env}: {folder.name}"))
    _print(displacement_table(report, dataset))
    _print(parts_table(report))
    _print(origin)
    _write_json(json_file, {**report.to_json(), "details": report.details})


@app.command()
def compare(
    agents: Annotated[list[str], typer.Argument(help="Names of baselines or folders of submissions.")],
    env: EnvOption,
    root: DataOption = None,
    scenes: ScenesOption = None,
    jobs: JobsOption = 0,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="Runs with different random draws.")] = 3,
    reference: Annotated[
        str | None, typer.Option("--reference", help="Take the subsets from this agent's events, not the frozen ones.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Run agents side by side, with true pasts and the controls beside them, and print the comparison."""
    from .submission.compare import compare as run_comparison
    from .viz.findings import findings
    from .viz.tables import displacement_table, error_table, parts_table

    keywords = {} if root is None else {"data": root}
    with _progress("compare") as (started, done):
        result = run_comparison(agents, env, keywords, scenes, range(seeds), _workers(jobs), started, done, reference)
    report = result.report
    _print(error_table(report, f"{report.env}: missing-aware error (m), {_count(seeds, 'seed')} of sampling"))
    _print(displacement_table(report, result.dataset))
    _print(parts_table(report))
    _print(result.reference.origin)
    for sentence in findings(report):
        _print(f"• {sentence}")
    _write_json(
        json_file, {**report.to_json(), "ranks": report.ranks, "paired": report.paired, "details": report.details}
    )


@app.command()
def train(
    what: Annotated[str, typer.Argument(help="What to fit: motion-noise.")],
    env: EnvOption,
    root: DataOption = None,
    observe: Annotated[
        str, typer.Option("--observe", help="detections or truth: what the pasts are made of.")
    ] = "detections",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")] = None,
) -> None:
    """Fit the parameters of a baseline on the training split of an environment."""
    from .submission.training import KINDS, fit_motion_noise

    if what not in KINDS:
        raise typer.BadParameter(f"{what!r} cannot be fitted, expected one of: {', '.join(KINDS)}", param_hint="WHAT")
    with _progress("read") as (started, done):
        text = fit_motion_noise(env, root, observe, started, done)
    if output is None:
        sys.stdout.write(text)
    else:
        output.write_text(text, encoding="utf-8")


@app.command(hidden=True)
def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen subsets of a shipped environment (maintainers)."""
    from .submission.reference import freeze as write

    with _progress("freeze") as (started, done):
        path, counts = write(env, root, _workers(jobs), started, done)
    _print(f"{path}: {counts}")


def main() -> None:
    """Entry point: errors of the library become one line and exit status 1."""
    try:
        app()
    except MtpBenchError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        _fail("interrupted; nothing was written")


def _fail(text: str) -> None:
    from rich.console import Console

    Console(stderr=True, soft_wrap=True).print("error:", style="bold red", end=" ")
    Console(stderr=True, soft_wrap=True, markup=False, highlight=False).print(text)
    raise SystemExit(1)


def _print(content: Any) -> None:
    """Tables as wide as they need to be where the output is a file or a pipe."""
    from rich.console import Console

    console = Console() if sys.stdout.isatty() else Console(width=180)
    console.print(content, highlight=False)


def _write_json(path: Path | None, content: dict[str, Any]) -> None:
    """The file appears complete or not at all."""
    if path is None:
        return
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise MtpBenchError(f"cannot write {path}: {error.strerror}") from None


def _workers(jobs: int) -> int:
    import os

    return jobs or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else jobs or os.cpu_count() or 1


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


@contextmanager
def _progress(label: str) -> Iterator[tuple[Callable[[int], None], Callable[[str], None]]]:
    """A progress bar: ``started(total)`` and ``done(scene)`` drive it; it shows on the error stream."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=None)
        yield (
            lambda total: progress.update(task, total=total),
            lambda scene: progress.update(task, advance=1, description=f"{label} {scene}"),
        )


if __name__ == "__main__":
    main()
