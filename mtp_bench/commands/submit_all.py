"""``mtp-bench submit --all``: make or continue the records of every baseline on every environment."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from ..errors import DataError, MtpBenchError
from ..records import Record
from ..records.inventory import Piece, standing_record, why_impossible
from ..running.options import RunOptions
from ..tables import Column, Table
from .output import said_of, say

Outcome = Literal["made", "kept", "not here", "failed"]
MIB = 2**20


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


def make_all(pieces: Sequence[Piece], options: RunOptions, make: Callable[[Piece], Record]) -> list[Line]:
    """Make the missing records; the failure of one does not stop the others.

    After an interruption the same command continues with the next scene.
    """
    lines: list[Line] = []
    for piece in pieces:
        lines.append(_make_one(piece, options, make))
        say(f"{len(lines)} of {len(pieces)}: {lines[-1]}")
    return lines


def _make_one(piece: Piece, options: RunOptions, make: Callable[[Piece], Record]) -> Line:
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
    asked_for = record.status == "partial" and not record.missed.crashed_scenes  # by --scenes
    if asked_for or not record.unfinished:
        return Line(piece, outcome, seconds)
    reasons = {} if record.status in ("crashed", "rejected") else record.missed.reasons  # these statuses state one
    return Line(piece, "failed", note=": ".join([record.unfinished, *list(reasons.values())[:1]]))


def summary_table(lines: Sequence[Line]) -> Table:
    """One line per environment and one of all: numbers of records by outcome, and the time they took."""
    envs = dict.fromkeys(line.piece.env for line in lines)
    rows = [_summary(env_id, [line for line in lines if line.piece.env == env_id]) for env_id in envs]
    outcomes = (Column(key=name) for name in get_args(Outcome))
    sizes = Column(key="minutes", format=".1f"), Column("MiB", key="size", format=".1f")
    columns = [Column("environment", key="env"), *outcomes, *sizes]
    return Table("records", "Records with their rollouts", "", [*rows, _summary("all", lines)], columns)


def _summary(name: str, lines: Sequence[Line]) -> dict[str, str | float]:
    outcomes = [line.outcome for line in lines]
    return {
        "env": name,
        **{outcome: outcomes.count(outcome) for outcome in get_args(Outcome)},
        "minutes": sum(line.seconds for line in lines) / 60,
        "size": sum(line.piece.size for line in lines) / MIB,
    }
