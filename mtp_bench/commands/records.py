"""What `mtp-bench submit`, `verify` and `seal` do: records made and checked, and what the user reads of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from ..errors import MtpBenchError, RecordError
from .shared import count, given, prepare, write_json

if TYPE_CHECKING:
    from rich.table import Table

    from ..records import Record
    from ..records.verifying import Verification

DIVISIONS = ("closed", "open")
MOST_DIFFERENCES = 20  # shown per record


def submit_all(
    path: str,
    env_ids: Sequence[str],
    data: str | None,
    seeds: int,
    scenes: int | None,
    workers: int,
    output: Path | None,
    division: str,
    training_data: Sequence[str],
    scheduler: str | None = None,
    split: str | None = None,
) -> None:
    """Make the record of a submission on each env and print what it says.

    Raises MtpBenchError, after all records are written, where one crashed or is rejected.
    """
    from ..cards import load_card
    from ..records import submit
    from ..records.submitting import record_path, require_writable
    from ..submission.loader import load_submission
    from ..viz.terminal.output import progress_bar, show, show_numbers

    submission = load_submission(path)
    place = cast('Literal["closed", "open"]', division)  # one of DIVISIONS
    env_ids = list(dict.fromkeys(env_ids))
    targets = [record_path(submission, load_card(env_id), output, split) for env_id in env_ids]
    for target in targets:
        require_writable(target)
    failed = []
    for env_id, target in zip(env_ids, targets, strict=True):
        prepare(env_id, data, scenes, workers, given(split=split))
        with progress_bar(f"{submission.name} on {env_id}") as (started, done):
            record = submit(
                path, env_id, data, seeds, scenes, workers, output, place, training_data, started, done, None,
                scheduler, split,
            )  # fmt: skip
        show_numbers(_record_table(record))
        show(f"{target}: {_sentence(record)}")
        if record.status in ("crashed", "rejected"):
            failed.append(f"{record.env.id}: {record.status}: {record.status_reason}")
    if failed:
        raise RecordError("; ".join(failed))


def verify_all(
    path: Path,
    data: str | None,
    env_id: str | None,
    submission: Path | None,
    rerun: bool,
    write: bool,
    workers: int,
    json_file: Path | None = None,
    hidden: Path | None = None,
    commitment: Path | None = None,
) -> None:
    """Check a record, or all records of a folder, and print what differs; ``write`` takes over what was found.

    Raises RecordError where a record does not hold; of a folder, after all were checked.
    """
    from ..records import open_seal, record_paths, verify
    from ..records.verifying import confirm
    from ..viz.terminal.output import progress_bar, show, show_numbers

    paths = record_paths(path) if path.is_dir() else [path]
    if not paths:
        raise RecordError(f"{path}: no record there, expected files <submission>/<env id>.json")
    sealed = None if hidden is None else open_seal(hidden, commitment)
    failed, verdicts = [], []
    for file in paths:
        try:
            with progress_bar(f"verify {file.name}") as (started, done):
                checked = verify(file, data, env_id, submission, rerun, workers, started, done, sealed)
        except MtpBenchError as error:
            if not path.is_dir():
                raise
            failed.append(str(error))
            verdicts.append({"record": str(file), "error": str(error)})
            continue
        verdicts.append(_as_json(checked))
        if checked.differences:
            show_numbers(_difference_table(checked))
        show(_verdict(checked))
        if write and (checked.holds or checked.updated is not None):
            show(f"{file}: written as {confirm(checked).verification}")
        elif not checked.holds:
            failed.append(f"{file}: {count(len(checked.differences), 'difference')} to what was found here")
    write_json(json_file, {"records": verdicts})
    if failed:
        raise RecordError("; ".join(failed))


def _record_table(record: Record) -> Table:
    """One line per subset."""
    from rich.table import Table

    table = Table(title=f"{record.submission.name} on {record.env.id}: missing-aware error (m, less is better)")
    for name in ("subset", "missing-aware", "interval", "minADE", "minFDE", "coverage", "targets", "objects", "scenes"):
        table.add_column(name, justify="left" if name == "subset" else "right")
    for row in record.rows:
        shown = "–" if row.interval is None else f"{row.interval[0]:.3f} to {row.interval[1]:.3f}"
        numbers = [_number(value) for value in (row.minADE, row.minFDE, row.coverage)]
        counts = [str(value) for value in (row.targets, row.objects, row.scenes)]
        table.add_row(row.subset, _number(row.missing_aware), shown, *numbers, *counts)
    return table


def _sentence(record: Record) -> str:
    """Status, cost and what went wrong, for people."""
    latency = record.latency
    parts = [f"{record.status}{f' ({record.status_reason})' if record.status_reason else ''}"]
    if latency.p50_ms is not None and latency.p95_ms is not None:
        parts.append(f"{latency.p50_ms:.1f} ms per frame, 95 % within {latency.p95_ms:.1f} ms")
    parts.append(f"{record.peak_memory_mib:.0f} MiB")
    lost = record.missed
    parts += [f"{count} {what}" for count, what in ((lost.late, "late frames"), (lost.malformed, "malformed answers"))
              if count]  # fmt: skip
    if lost.crashed_scenes:
        parts.append(f"{count(lost.crashed_scenes, 'scene')} cut short ({next(iter(lost.reasons.values()), '')})")
    return "; ".join(parts)


def _difference_table(checked: Verification) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{checked.path}: what differs"))
    for name in ("what", "recorded", "found"):
        table.add_column(name, overflow="fold")
    for difference in checked.differences[:MOST_DIFFERENCES]:
        table.add_row(*(escape(str(_shown(value))) for value in difference))
    hidden = len(checked.differences) - MOST_DIFFERENCES
    if hidden > 0:
        table.add_row(f"and {hidden} more", "", "")
    return table


def _as_json(checked: Verification) -> dict[str, Any]:
    differences = [difference._asdict() for difference in checked.differences]
    verdict = {"record": str(checked.path), "digest": checked.record.digest, "holds": checked.holds}
    return {**verdict, "level": checked.level, "differences": differences, "notes": list(checked.notes)}


def _verdict(checked: Verification) -> str:
    record = checked.record
    who = f"{checked.path}: {record.submission.name} on {record.env.id}"
    what = f"holds, {checked.level}" if checked.holds else "does not hold"
    hidden = []
    if checked.hidden is not None:
        error = _number(checked.hidden.missing_aware)
        hidden.append(f"missing-aware error {error} m on {count(checked.hidden.scenes, 'hidden scene')}")
    return ". ".join([f"{who}: {what}", *hidden, *checked.notes])


def seal_env(env_id: str, scenes: int, output: Path) -> None:
    """Draw secret scenes of an env and print their commitment."""
    from ..records import seal
    from ..records.sealing import commitment_path
    from ..viz.terminal.output import show

    promise = seal(env_id, scenes, output)
    show(
        f"{commitment_path(output)}: publish this commitment to {count(scenes, 'hidden scene')} of {promise.env}, "
        f"sha256 {promise.commitment}"
    )
    show(f"{output}: keep this secret; `mtp-bench verify RECORD --rerun --hidden {output}` runs them")


def _shown(value: Any) -> Any:
    """A value short enough for a table."""
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
