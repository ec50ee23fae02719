"""``mtp-bench submit``."""

import re
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from typer import Argument, BadParameter, Option

from ..agent import load_submission
from ..cards import load_card
from ..core import (
    DataError,
    MtpBenchError,
    RecordError,
    Table,
    columns_of,
    long_work,
)
from ..judge import (
    Record,
    RecordPiece,
    inventory,
    record_path,
    require_target,
    standing_record,
    submit as make_record,
    why_impossible,
)
from ..running import RunOptions
from ..viz import counted, show, show_table
from .options import SEEDS, DataOption, SeedsOption, WorkerChoice
from .output import error_text, prepare, say, some_of

_SHOWN_COLUMNS = (
    "subset",
    "error",
    "interval",
    "plain_error",
    "minADE",
    "minFDE",
    "coverage",
    "targets",
    "objects",
    "scenes",
)
Outcome = Literal["made", "kept", "not here", "failed"]


@dataclass(frozen=True)
class EntryOptions:
    """Options of an entry on the leaderboard, and of an earlier submit of it."""

    seeds: SeedsOption = SEEDS
    scenes: Annotated[
        int | None,
        Option(min=1, help="Only the first N scenes: a record without a rank."),
    ] = None
    commit: Annotated[
        str, Option(help="Commit that holds the folder: 7 to 64 hex digits.")
    ] = ""
    resume: Annotated[
        bool, Option("--resume", help="Continue with scenes that were finished before.")
    ] = False
    force: Annotated[
        bool,
        Option("--force", help="Replace a finished record by one that cannot rank."),
    ] = False

    def arguments(self) -> dict[str, Any]:
        """Return arguments of `judge.submit`.

        Raises BadParameter for a text that is not a commit.
        """
        if not re.fullmatch("([0-9a-f]{7,64})?", self.commit):
            raise BadParameter(
                f"got {self.commit!r}, expected 7 to 64 hex digits",
                param_hint="--commit",
            )
        return {"commit": self.commit, "resume": self.resume, "replace": self.force}


def submit(
    workers: WorkerChoice,
    entry: EntryOptions,
    path: Annotated[
        str | None,
        Argument(
            help="Folder of a submission or name of a baseline.",
        ),
    ] = None,
    env: Annotated[
        list[str] | None,
        Option(help="Environment id; repeatable."),
    ] = None,
    everything: Annotated[
        bool,
        Option(
            "--all",
            help="Every baseline on every environment, or those of --env; "
            "keeps finished ones.",
        ),
    ] = False,
    root: DataOption = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", help="Folder; leaderboard/records/<name> by default."),
    ] = None,
) -> None:
    """Run a submission behind the gateway and write its records.

    With ``--all`` it runs every baseline.
    """
    arguments = entry.arguments()
    seeds = range(entry.seeds)
    options = RunOptions(root, entry.scenes, seeds, workers=workers.workers())
    if everything:
        if entry.commit:
            raise BadParameter("not with --all", param_hint="--commit")
        listed = inventory(env or (), () if path is None else (path,), output)
        _submit_all(listed, options, {"resume": True, "replace": entry.force})
        return
    if path is None:
        raise BadParameter("name a submission, or --all", param_hint="PATH")
    if not env:
        raise BadParameter("name an environment, or --all", param_hint="--env")
    _submit_one(path, env, options, output, arguments)


def _submit_all(
    pieces: Sequence[RecordPiece], options: RunOptions, arguments: Mapping[str, Any]
) -> None:
    lines = make_all(pieces, options, arguments)
    counts = Counter(line.outcome for line in lines)
    show(", ".join(f"{counts[outcome]} {outcome}" for outcome in get_args(Outcome)))
    if all(line.outcome == "not here" for line in lines):
        raise RecordError(f"no record can be made here, the first: {lines[0].note}")
    failed = [
        f"{line.piece.submission.name} on {line.piece.env}: {line.note}"
        for line in lines
        if line.outcome == "failed"
    ]
    if failed:
        raise RecordError(some_of(failed))


def _submit_one(
    path: str,
    env_ids: Sequence[str],
    options: RunOptions,
    output: Path | None,
    arguments: Mapping[str, Any],
) -> None:
    """Make the records of one submission on the named environments, and show them."""
    submission = load_submission(path)
    pieces = []
    for env_id in dict.fromkeys(env_ids):
        target = record_path(submission, load_card(env_id), output)
        require_target(
            target, submission, options, arguments["resume"], arguments["replace"]
        )
        pieces.append(RecordPiece(submission, env_id, target))
    failures = []
    for piece in pieces:
        try:
            record = _make_record(piece, options, arguments)
        except (MtpBenchError, OSError) as error:  # the others are worth their time
            if len(pieces) == 1:
                raise
            failures.append(f"{piece.env}: {error_text(error)}")
            say(failures[-1])
            continue
        _show_record(record, piece.target)
        if record.status in ("crashed", "rejected"):
            failures.append(f"{record.env.id}: {record.status}: {record.status_reason}")
    if failures:
        raise RecordError(some_of(failures))


def _show_record(record: Record, target: Path) -> None:
    """Print the table of a record, and its status in one line."""
    title = f"{record.submission.name} on {record.env.id}"
    if record.driving is not None:
        title += ": drive score, more is better"
        table = Table("record", title, "", [record.driving], [])
    else:
        title += ": bADE (m, less is better)"
        columns = columns_of(type(record.row))
        shown = [column for column in columns if column.key in _SHOWN_COLUMNS]
        table = Table("record", title, "", list(record.rows), shown)
    show_table(table)
    next_step = ""
    if not record.unfinished:
        next_step = f"; next: `mtp-bench board --with {target}`"
    show(f"{target}: {_status_line(record)}{next_step}")


def _make_record(
    piece: RecordPiece, options: RunOptions, arguments: Mapping[str, Any]
) -> Record:
    card = load_card(piece.env)
    if card.lanes is not None and not card.simulated:
        say(
            f"{card.id} shows lanes, by which an agent can recognise a recorded scene "
            "even after a random motion of it."
        )
    prepare(piece.env, options)
    submission = piece.submission
    with long_work(f"running {submission.name} on {piece.env}") as progress:
        options = replace(options, progress=progress)
        output = piece.target.parent
        return make_record(submission.path, piece.env, options, output, **arguments)


def _status_line(record: Record) -> str:
    """Return status, times and failures in one line."""
    latency = record.measured.latency
    missed = record.missed
    parts: list[str] = [record.status]
    if record.status_reason:
        parts[0] += f" ({record.status_reason})"
    if latency.p50_ms is not None and latency.p95_ms is not None:
        parts.append(
            f"{latency.p50_ms:.1f} ms per frame, 95 % within {latency.p95_ms:.1f} ms"
        )
    parts += [f"{record.measured.peak_memory_mib:.0f} MiB", record.reference.origin]
    if missed.malformed:
        parts.append(f"{missed.malformed} malformed answers")
    if missed.crashed_scenes:
        reason = next(iter(missed.reasons.values()), "")
        crashed = counted(missed.crashed_scenes, "scene")
        parts.append(f"{crashed} not finished ({reason})")
    return "; ".join(parts)


@dataclass(frozen=True)
class Line:
    """Outcome of one record."""

    piece: RecordPiece
    outcome: Outcome
    seconds: float = 0.0
    note: str = ""

    def __str__(self) -> str:
        line = f"{self.piece.submission.name} on {self.piece.env}: {self.outcome}"
        if self.outcome == "made":
            return f"{line}, {self.seconds:.0f} s"
        return f"{line}: {self.note}" if self.note else line


def make_all(
    pieces: Sequence[RecordPiece], options: RunOptions, arguments: Mapping[str, Any]
) -> list[Line]:
    """Make the missing records.

    The failure of one does not stop the others. After an interruption the same command
    continues with the next scene.
    """
    lines: list[Line] = []
    for piece in pieces:
        lines.append(_make_one(piece, options, arguments))
        say(f"{len(lines)} of {len(pieces)}: {lines[-1]}")
    return lines


def _make_one(
    piece: RecordPiece, options: RunOptions, arguments: Mapping[str, Any]
) -> Line:
    try:
        standing = standing_record(piece, options)
        if standing is not None:
            return _line(standing, piece, "kept")
        reason = why_impossible(piece, options.data)
        if reason is not None:
            return Line(piece, "not here", note=reason)
        begin = time.monotonic()
        record = _make_record(piece, options, arguments)
    except DataError as error:
        return Line(piece, "not here", note=f"no data: {error}")
    except (MtpBenchError, OSError) as error:
        return Line(piece, "failed", note=error_text(error))
    return _line(record, piece, "made", time.monotonic() - begin)


def _line(
    record: Record, piece: RecordPiece, outcome: Outcome, seconds: float = 0.0
) -> Line:
    """Return ``outcome`` for a record, made now or before.

    It is a failure instead unless the agent finished every scene that was run.
    """
    # "partial" by --scenes, not by a failure
    is_part = record.status == "partial" and not record.missed.crashed_scenes
    if is_part or not record.unfinished:
        return Line(piece, outcome, seconds)
    reasons = [record.unfinished]
    if record.status not in ("crashed", "rejected"):  # these state their reason
        reasons += list(record.missed.reasons.values())[:1]  # the first, if any
    return Line(piece, "failed", note=": ".join(reasons))
