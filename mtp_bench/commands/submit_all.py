"""``mtp-bench submit --all``: make or continue the records of every baseline on every environment."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from rich.table import Table

from ..errors import DataError, MtpBenchError
from ..records import Record
from ..records.inventory import Piece, standing_record, why_impossible
from ..running.options import RunOptions
from ..viz.terminal.output import counted, new_table
from .output import said_of, say

Outcome = Literal["made", "kept", "not here", "failed", "left"]
_OUTCOMES: tuple[Outcome, ...] = ("made", "kept", "not here", "failed", "left")
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


def make_all(
    pieces: Sequence[Piece], options: RunOptions, make: Callable[[Piece], Record], minutes: float | None
) -> list[Line]:
    """Make the missing records; the failure of one does not stop the others.

    ``minutes``: no record is begun later. After an interruption the same command continues with the next scene.
    """
    begun, lines = time.monotonic(), []
    for place, piece in enumerate(pieces):
        late = minutes is not None and time.monotonic() - begun > 60 * minutes
        lines.append(Line(piece, "left") if late else _make_one(piece, options, make))
        if not late:
            say(f"{place + 1} of {len(pieces)}: {lines[-1]}")
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
    """One line per environment: numbers of records by outcome, and the time they took."""
    headings = ("environment", *_OUTCOMES, "minutes", "MiB")
    table = new_table("Records with their rollouts", headings, left=("environment",))
    for env_id in dict.fromkeys(line.piece.env for line in lines):
        own = [line for line in lines if line.piece.env == env_id]
        outcomes = [line.outcome for line in own]
        counts = [str(outcomes.count(name)) for name in _OUTCOMES]
        minutes, size = _minutes_and_size(own)
        table.add_row(env_id, *counts, f"{minutes:.1f}", f"{size:.1f}")
    return table


def last_line(lines: Sequence[Line]) -> str:
    """All outcomes in one sentence."""
    outcomes = [line.outcome for line in lines]
    minutes, size = _minutes_and_size(lines)
    made = f"{counted(outcomes.count('made'), 'record')} made in {minutes:.1f} minutes, {outcomes.count('kept')} kept"
    left = outcomes.count("left")
    return f"{made}, {size:.0f} MiB with rollouts" + (f"; {left} left: the same command continues" if left else "")


def _minutes_and_size(lines: Sequence[Line]) -> tuple[float, float]:
    return sum(line.seconds for line in lines) / 60, sum(line.piece.size for line in lines) / MIB
