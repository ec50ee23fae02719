"""``mtp-bench submit``."""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from typer import Argument, BadParameter, Option

from ..agent import Submission, load_submission
from ..cards import load_card
from ..core import Column, DataError, MtpBenchError, RecordError, Table, columns_of
from ..judge import (
    Piece,
    Record,
    inventory,
    record_path,
    require_target,
    standing_record,
    submit as make_record,
    why_impossible,
)
from ..running import RunOptions
from ..viz import counted, show, show_table
from .options import SEEDS, DataOption, SeedsOption, WorkerChoice, env_ids, submissions
from .output import prepare, said_of, say, some_of, working

SHOWN = (
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
MIB = 2**20


@dataclass(frozen=True)
class EntryOptions:
    """Options of the entry on the leaderboard, and of an earlier submit of it."""

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
        """Arguments of `records.submit`; BadParameter for what is not a commit."""
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
            autocompletion=submissions,
        ),
    ] = None,
    env: Annotated[
        list[str] | None,
        Option(help="Environment id; repeatable.", autocompletion=env_ids),
    ] = None,
    everything: Annotated[
        bool,
        Option(
            "--all",
            help="Every baseline on every environment, or those of --env; keeps finished ones.",
        ),
    ] = False,
    root: DataOption = None,
    output: Annotated[
        Path | None,
        Option("-o", "--output", help="Folder; leaderboard/records/<name> by default."),
    ] = None,
) -> None:
    """Run a submission behind the gateway and write its records for the leaderboard; with --all every baseline."""
    arguments = entry.arguments()
    options = RunOptions(
        root, entry.scenes, range(entry.seeds), workers=workers.workers()
    )
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
    pieces: Sequence[Piece], options: RunOptions, arguments: Mapping[str, Any]
) -> None:
    def make(piece: Piece) -> Record:
        return _one(
            piece.submission, piece.env, options, piece.target.parent, arguments
        )

    lines = make_all(pieces, options, make)
    show_table(summary_table(lines))
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
    targets = {
        env_id: record_path(submission, load_card(env_id), output) for env_id in env_ids
    }
    for target in targets.values():
        require_target(
            target, submission, options, arguments["resume"], arguments["replace"]
        )
    failed = []
    for env_id, target in targets.items():
        try:
            record = _one(submission, env_id, options, output, arguments)
        except (MtpBenchError, OSError) as error:  # the others are worth their time
            if len(targets) == 1:
                raise
            failed.append(f"{env_id}: {said_of(error)}")
            say(failed[-1])
            continue
        what = "bADE (m, less is better)"
        columns = [each for each in columns_of(type(record.row)) if each.key in SHOWN]
        rows: list[Any] = list(record.rows)
        if record.driving is not None:
            what, rows, columns = "drive score, more is better", [record.driving], []
        show_table(
            Table(
                "record",
                f"{submission.name} on {record.env.id}: {what}",
                "",
                rows,
                columns,
            )
        )
        then = "" if record.unfinished else f"; next: `mtp-bench board --with {target}`"
        show(f"{target}: {_sentence(record)}{then}")
        if record.status in ("crashed", "rejected"):
            failed.append(f"{record.env.id}: {record.status}: {record.status_reason}")
    if failed:
        raise RecordError(some_of(failed))


def _one(
    submission: Submission,
    env_id: str,
    options: RunOptions,
    output: Path | None,
    arguments: Mapping[str, Any],
) -> Record:
    """Make the record of one env with a progress bar."""
    card = load_card(env_id)
    if card.lanes is not None and not card.simulated:
        say(
            f"{card.id} shows lanes, which tell the place of a recorded scene: no random motion of the scene hides it."
        )
    prepare(env_id, options)
    with working(f"running {submission.name} on {env_id}", options) as watched:
        return make_record(submission.path, env_id, watched, output, **arguments)


def _sentence(record: Record) -> str:
    """Status, times and failures in one line."""
    latency, missed = record.measured.latency, record.missed
    parts = [
        f"{record.status}{f' ({record.status_reason})' if record.status_reason else ''}"
    ]
    if latency.p50_ms is not None and latency.p95_ms is not None:
        parts.append(
            f"{latency.p50_ms:.1f} ms per frame, 95 % within {latency.p95_ms:.1f} ms"
        )
    parts += [f"{record.measured.peak_memory_mib:.0f} MiB", record.reference.origin]
    if missed.malformed:
        parts.append(f"{missed.malformed} malformed answers")
    if missed.crashed_scenes:
        reason = next(iter(missed.reasons.values()), "")
        parts.append(
            f"{counted(missed.crashed_scenes, 'scene')} not finished ({reason})"
        )
    return "; ".join(parts)


@dataclass(frozen=True)
class Line:
    """Outcome of one record."""

    piece: Piece
    outcome: Outcome
    seconds: float = 0.0
    note: str = ""

    def __str__(self) -> str:
        line = f"{self.piece.submission.name} on {self.piece.env}: {self.outcome}"
        if self.outcome == "made":
            return f"{line}, {self.seconds:.0f} s"
        return f"{line}: {self.note}" if self.note else line


def make_all(
    pieces: Sequence[Piece], options: RunOptions, make: Callable[[Piece], Record]
) -> list[Line]:
    """Make the missing records; the failure of one does not stop the others.

    After an interruption the same command continues with the next scene.
    """
    lines: list[Line] = []
    for piece in pieces:
        lines.append(_make_one(piece, options, make))
        say(f"{len(lines)} of {len(pieces)}: {lines[-1]}")
    return lines


def _make_one(
    piece: Piece, options: RunOptions, make: Callable[[Piece], Record]
) -> Line:
    try:
        standing = standing_record(piece, options)
        if standing is not None:
            return _line(standing, piece, "kept")
        reason = why_impossible(piece, options.data)
        if reason is not None:
            return Line(piece, "not here", note=reason)
        begun = time.monotonic()
        record = make(piece)
    except DataError as error:
        return Line(piece, "not here", note=f"no data: {error}")
    except (MtpBenchError, OSError) as error:
        return Line(piece, "failed", note=said_of(error))
    return _line(record, piece, "made", time.monotonic() - begun)


def _line(record: Record, piece: Piece, outcome: Outcome, seconds: float = 0.0) -> Line:
    """The outcome by the record, made now or before: a failure unless its agent finished every scene that was run."""
    asked_for = (
        record.status == "partial" and not record.missed.crashed_scenes
    )  # by --scenes
    if asked_for or not record.unfinished:
        return Line(piece, outcome, seconds)
    reasons = (
        {} if record.status in ("crashed", "rejected") else record.missed.reasons
    )  # these statuses state one
    return Line(
        piece,
        "failed",
        note=": ".join([record.unfinished, *list(reasons.values())[:1]]),
    )


def summary_table(lines: Sequence[Line]) -> Table:
    """One line per environment and one of all: numbers of records by outcome, and the time they took."""
    envs = dict.fromkeys(line.piece.env for line in lines)
    rows = [
        _summary(env_id, [line for line in lines if line.piece.env == env_id])
        for env_id in envs
    ]
    outcomes = (Column(key=name) for name in get_args(Outcome))
    sizes = Column(key="minutes", format=".1f"), Column("MiB", key="size", format=".1f")
    columns = [Column("environment", key="env"), *outcomes, *sizes]
    return Table(
        "records",
        "Records with their rollouts",
        "",
        [*rows, _summary("all", lines)],
        columns,
    )


def _summary(name: str, lines: Sequence[Line]) -> dict[str, str | float]:
    outcomes = [line.outcome for line in lines]
    return {
        "env": name,
        **{outcome: outcomes.count(outcome) for outcome in get_args(Outcome)},
        "minutes": sum(line.seconds for line in lines) / 60,
        "size": sum(line.piece.size for line in lines) / MIB,
    }
