"""The command line: ``mtp-bench``. Exit status 0, 1 for a failure that the message explains, 2 for wrong usage."""

from __future__ import annotations

import json
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .errors import MtpBenchError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .scoring import Report

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
    from .viz.terminal import show

    cards = [load_card(env_id) for env_id in card_ids()]
    _write_json(json_file, {card.id: {**card.model_dump(mode="json"), "digest": card.digest} for card in cards})
    show(env_table(cards))


@app.command()
def data(
    env: Annotated[str | None, typer.Option("--env", help="Only this environment.")] = None,
    root: DataOption = None,
    json_file: JsonOption = None,
) -> None:
    """Show which data is found, what is missing and how to get it."""
    from ._bundle import card_ids
    from .cards import load_card
    from .submission.reading import read_status
    from .viz.listings import data_report, status_json
    from .viz.terminal import show

    cards = [load_card(env_id) for env_id in ([env] if env else card_ids())]
    statuses = {card.id: read_status(card, root) for card in cards}
    _write_json(json_file, {env_id: status_json(status) for env_id, status in statuses.items()})
    show(data_report(statuses))
    lacking = [env_id for env_id, status in statuses.items() if not status.usable]
    if lacking:
        raise MtpBenchError(f"data is missing or broken for {', '.join(lacking)}: the listing says what and why")


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
    from .viz.terminal import progress_bar, show

    with progress_bar(agent) as (started, done):
        stored = run_and_store(agent, env, output, root, scenes, _workers(jobs), seed, started, done)
    _show_skipped(stored.skipped)
    count = _count(stored.scenes, "scene")
    show(f"{count} of {env} by {agent} in {output}; score with `mtp-bench score {output}`")


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")],
    root: DataOption = None,
    env: Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Score stored rollouts."""
    from .submission.stored import score_stored
    from .viz.terminal import progress_bar, show

    _require_file(json_file)
    with progress_bar("score") as (started, done):
        scored = score_stored(folder, root, started, done, env)
    report = scored.report
    _write_json(json_file, {**report.to_json(), "details": report.details, "skipped": scored.skipped})
    _show_report(report, f"{report.env}: {folder.name}")
    show(scored.origin)
    _show_skipped(scored.skipped)


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
    from .viz.terminal import progress_bar, show

    _require_file(json_file)
    keywords = {} if root is None else {"data": root}
    with progress_bar("compare") as (started, done):
        result = run_comparison(agents, env, keywords, scenes, range(seeds), _workers(jobs), started, done, reference)
    report = result.report
    further = {"ranks": report.ranks, "paired": report.paired, "details": report.details, "skipped": result.skipped}
    _write_json(json_file, {**report.to_json(), **further})
    _show_report(report, f"{report.env}: missing-aware error (m), {_count(seeds, 'seed')} of sampling")
    show(result.reference.origin)
    _show_skipped(result.skipped)
    for sentence in findings(report):
        show(f"• {sentence}")


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
    from .submission.files import write_text
    from .submission.training import KINDS, fit_motion_noise
    from .viz.terminal import progress_bar

    _require_file(output)
    if what not in KINDS:
        raise typer.BadParameter(f"{what!r} cannot be fitted, expected one of: {', '.join(KINDS)}", param_hint="WHAT")
    with progress_bar("read") as (started, done):
        text = fit_motion_noise(env, root, observe, started, done)
    if output is None:
        sys.stdout.write(text)
    else:
        write_text(output, text)


@app.command(hidden=True)
def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen subsets of a shipped environment (maintainers)."""
    from .submission.reference import freeze as write
    from .viz.terminal import progress_bar, show

    with progress_bar("freeze") as (started, done):
        path, counts = write(env, root, _workers(jobs), started, done)
    show(f"{path}: {counts}")


def main() -> None:
    """Entry point: errors of the library become one line and exit status 1."""
    # joblib renews workers that hold much memory, and says so; nothing is lost by it.
    warnings.filterwarnings("ignore", message="A worker stopped while some jobs were given")
    try:
        app(prog_name="mtp-bench")
    except MtpBenchError as error:
        _fail(str(error))
    except OSError as error:  # a full disk, a file without permission
        _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))


def _fail(text: str) -> None:
    from rich.console import Console

    Console(stderr=True, soft_wrap=True).print("error:", style="bold red", end=" ")
    line = " ".join(part.strip() for part in text.splitlines())
    Console(stderr=True, soft_wrap=True, markup=False, highlight=False).print(line)
    raise SystemExit(1)


def _show_report(report: Report, title: str) -> None:
    from .viz.tables import displacement_table, error_table, parts_table
    from .viz.terminal import show_numbers

    for table in (error_table(report, title), displacement_table(report), parts_table(report)):
        show_numbers(table)


def _show_skipped(skipped: Mapping[str, int]) -> None:
    from .submission.reading import skipped_line
    from .viz.terminal import show

    line = skipped_line(skipped)
    if line is not None:
        show(line)


def _require_file(path: Path | None) -> None:
    """Refuse a file that cannot be written before the work, not after it."""
    from .submission.files import require_file

    if path is not None:
        require_file(path)


def _write_json(path: Path | None, content: dict[str, Any]) -> None:
    from .submission.files import write_text

    if path is not None:
        write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def _workers(jobs: int) -> int:
    import os

    return jobs or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else jobs or os.cpu_count() or 1


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


if __name__ == "__main__":
    main()
