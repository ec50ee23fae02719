"""``mtp-bench submit``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import RecordError
from .options import DataOption, SubmissionArgument, WorkerChoice, one_of
from .output import count, number, prepare, working

if TYPE_CHECKING:
    from rich.table import Table

    from ..records import Record

DIVISIONS = ("closed", "open")


def submit(
    path: SubmissionArgument,
    workers: WorkerChoice,
    env: Annotated[list[str], typer.Option(help="Environment id; repeatable.")],
    root: DataOption = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs with different random draws and frames.")] = 3,
    scenes: Annotated[
        int | None, typer.Option(min=1, help="Only the first N scenes: a partial record, never ranked.")
    ] = None,
    split: Annotated[
        str | None, typer.Option(help="Another split, such as train: a partial record, never ranked.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder; leaderboard/records/<name> by default.")
    ] = None,
    division: Annotated[str, typer.Option(help="closed or open.")] = "closed",
    training_data: Annotated[
        list[str] | None, typer.Option(help="Data it was trained on beside what its manifest says.")
    ] = None,
) -> None:
    """Run a submission behind the gateway and write its records for the leaderboard."""
    from ..cards import load_card
    from ..records import submit as make_record
    from ..records.submitting import record_path, require_writable
    from ..running.options import RunOptions
    from ..submission.loader import load_submission
    from ..viz.terminal.output import show, show_numbers

    one_of(division, DIVISIONS, "--division")
    options = RunOptions(root, scenes, range(seeds), split, workers=workers.workers())
    submission = load_submission(path)
    targets = {env_id: record_path(submission, load_card(env_id), output, split) for env_id in env}
    for target in targets.values():
        require_writable(target)
    place: Any = division
    failed = []
    for env_id, target in targets.items():
        prepare(env_id, options)
        with working(f"{submission.name} on {env_id}", options) as watched:
            record = make_record(path, env_id, watched, output, place, training_data or ())
        show_numbers(_record_table(record))
        show(f"{target}: {_sentence(record)}")
        if record.status in ("crashed", "rejected"):
            failed.append(f"{record.env.id}: {record.status}: {record.status_reason}")
    if failed:
        raise RecordError("; ".join(failed))


def _record_table(record: Record) -> Table:
    """One line per subset."""
    from ..viz.terminal.output import new_table

    title = f"{record.submission.name} on {record.env.id}: error at the false-forecast budgets (m, less is better)"
    names = ("subset", "error", "interval", "plain", "minADE", "minFDE", "coverage", "targets", "objects", "scenes")
    table = new_table(title, names, left=("subset",))
    for row in record.rows:
        shown = "–" if row.interval is None else f"{row.interval[0]:.3f} to {row.interval[1]:.3f}"
        numbers = [number(value) for value in (row.plain_error, row.minADE, row.minFDE, row.coverage)]
        counts = [str(value) for value in (row.targets, row.objects, row.scenes)]
        table.add_row(row.subset, number(row.error), shown, *numbers, *counts)
    return table


def _sentence(record: Record) -> str:
    """Status, cost and what went wrong, for people."""
    latency, lost = record.measured.latency, record.missed
    parts = [f"{record.status}{f' ({record.status_reason})' if record.status_reason else ''}"]
    if latency.p50_ms is not None and latency.p95_ms is not None:
        parts.append(f"{latency.p50_ms:.1f} ms per frame, 95 % within {latency.p95_ms:.1f} ms")
    parts += [f"{record.measured.peak_memory_mib:.0f} MiB", record.reference.origin]
    for frames, what in ((lost.late, "late frames"), (lost.malformed, "malformed answers")):
        if frames:
            parts.append(f"{frames} {what}")
    if lost.crashed_scenes:
        parts.append(f"{count(lost.crashed_scenes, 'scene')} cut short ({next(iter(lost.reasons.values()), '')})")
    return "; ".join(parts)
