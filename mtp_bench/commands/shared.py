"""Options that several commands share, and what they do before and after their work."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..scoring import Report

DataOption = Annotated[
    str | None, typer.Option("--data", help="Data root; else MTP_BENCH_DATA, else the user data folder.")
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the table's content to this file.")]
EnvOption = Annotated[str, typer.Option("--env", help="Environment id; `mtp-bench envs` lists them.")]
JobsOption = Annotated[int, typer.Option("--jobs", min=0, help="Processes; 0 takes one per core.")]
ScenesOption = Annotated[int | None, typer.Option("--scenes", min=1, help="Only the first N scenes.")]
SplitOption = Annotated[
    str | None, typer.Option("--split", help="Another split of the environment, such as train or val.")
]
DetectorOption = Annotated[
    str | None,
    typer.Option(
        "--detector",
        help="Another detector. Simulated: a profile, iid, hard or a .toml file of a profile. "
        "Stored (nuScenes): the first part of its files' names.",
    ),
]
DetectionsOption = Annotated[
    Path | None, typer.Option("--detections", help="File of stored detections (nuScenes submission form).")
]
BackendOption = Annotated[
    str, typer.Option("--backend", help="loky: processes of this machine. dask: workers of a Dask cluster.")
]
SchedulerOption = Annotated[
    str | None, typer.Option("--scheduler", help="Address of the Dask scheduler, such as tcp://10.0.0.1:8786.")
]
FolderArgument = Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")]
RunCardOption = Annotated[str | None, typer.Option("--env", help="Card of the run, where it does not ship.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the run.")]


def given(**options: str | Path | None) -> dict[str, str]:
    """The options that were given; paths as absolute ones, for a stored run is scored from anywhere."""
    return {
        name: str(value.expanduser().absolute()) if isinstance(value, Path) else value
        for name, value in options.items()
        if value is not None
    }


def prepare(env: str, root: str | None, scenes: int | None, jobs: int, changes: dict[str, str]) -> None:
    """Make simulated scenes, or the compact copy of tables, that are not in the cache yet."""
    from ..running.reading import prepare_scenes
    from ..viz.terminal.output import progress_bar

    with progress_bar("prepare") as (started, done):
        prepare_scenes(env, changes, root, scenes, workers(jobs), started, done)


def require_backend_options(backend: str, scheduler: str | None) -> None:
    """Refuse a backend that cannot work before anything is prepared."""
    from ..parallel import BACKENDS, Workers

    if backend not in BACKENDS:
        raise typer.BadParameter(f"{backend!r}, expected one of: {', '.join(BACKENDS)}", param_hint="--backend")
    if (backend == "dask") != (scheduler is not None):
        raise typer.BadParameter("--backend dask and --scheduler ADDRESS go together", param_hint="--scheduler")
    Workers(1, backend, scheduler)


def fail(text: str) -> None:
    """Print one line on the error stream and leave with status 1."""
    from rich.console import Console

    Console(stderr=True, soft_wrap=True).print("error:", style="bold red", end=" ")
    line = " ".join(part.strip() for part in text.splitlines())
    Console(stderr=True, soft_wrap=True, markup=False, highlight=False).print(line)
    raise SystemExit(1)


def condition(report: Report) -> str:
    """The env of a report, its split and its detector."""
    return f"{report.env} ({report.condition['split']}, {report.condition['detector']})"


def show_report(report: Report, title: str) -> None:
    """Print the tables of a report."""
    from ..viz.terminal.output import show, show_numbers
    from ..viz.terminal.tables import displacement_table, error_table, parts_table

    for table in (error_table(report, title), displacement_table(report), parts_table(report)):
        show_numbers(table)
    show(f"detections: {report.condition['detections']}; truth: {report.condition['truth']}")


def show_skipped(skipped: Mapping[str, int]) -> None:
    """Print what could not be read, if anything."""
    from ..running.reading import skipped_line
    from ..viz.terminal.output import show

    line = skipped_line(skipped)
    if line is not None:
        show(line)


def require_writable(path: Path | None) -> None:
    """Refuse a file that cannot be written before the work, not after it."""
    from ..files import require_file

    if path is not None:
        require_file(path)


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """Write what a table shows, where a file is named."""
    from ..files import write_text

    if path is not None:
        write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def workers(jobs: int) -> int:
    """Number of processes; 0 stands for the cores that this process may use."""
    import os

    return jobs or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else jobs or os.cpu_count() or 1


def count(number: int, noun: str) -> str:
    """``1 scene``, ``2 scenes``."""
    return f"{number} {noun}" + ("" if number == 1 else "s")
