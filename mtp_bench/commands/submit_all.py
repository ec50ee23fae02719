"""``mtp-bench submit --all``: makes or continues the records of every baseline on every environment."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ..errors import DataError, MtpBenchError
from .output import said_of, say

if TYPE_CHECKING:
    from rich.table import Table

    from ..records import Record
    from ..records.inventory import Piece
    from ..running.options import RunOptions

Outcome = Literal["made", "kept", "not here", "failed", "left"]
MIB = 2**20


@dataclass(frozen=True)
class Line:
    """What became of one record."""

    piece: Piece
    outcome: Outcome
    seconds: float = 0.0
    note: str = ""


def make_all(
    listed: Sequence[Piece], options: RunOptions, make: Callable[[Piece], Record], minutes: float | None
) -> list[Line]:
    """Make the records that are not there; what happens to one stops no other.

    ``minutes``: none is begun later. Interrupted, the same command goes on from the scene where it was.
    """
    begun, lines = time.monotonic(), []
    for place, piece in enumerate(listed):
        late = minutes is not None and time.monotonic() - begun > 60 * minutes
        lines.append(Line(piece, "left") if late else _one(piece, options, make))
        if lines[-1].outcome != "left":
            say(f"{place + 1} of {len(listed)}: {_sentence(lines[-1])}")
    return lines


def _one(piece: Piece, options: RunOptions, make: Callable[[Piece], Record]) -> Line:
    from ..records.inventory import standing_record, why_impossible

    try:
        standing = standing_record(piece, options)
        if standing is not None:
            return _of(standing, piece, "kept")
        reason = why_impossible(piece, options.data)
        if reason is not None:
            return Line(piece, "not here", note=reason)
        begun = time.monotonic()
        record = make(piece)
    except DataError as error:
        return Line(piece, "not here", note=f"no data: {error}")
    except (MtpBenchError, OSError) as error:
        return Line(piece, "failed", note=said_of(error))
    return _of(record, piece, "made", time.monotonic() - begun)


def _of(record: Record, piece: Piece, outcome: Outcome, seconds: float = 0.0) -> Line:
    """What became of a piece by its record: now or before, one that an agent did not live to the end of is a failure.

    Some of the scenes (--scenes) are what was asked for.
    """
    asked_for = record.status == "partial" and not record.missed.crashed_scenes
    if asked_for or not record.unfinished:
        return Line(piece, outcome, seconds)
    reasons = {} if record.status in ("crashed", "rejected") else record.missed.reasons  # these statuses have one
    return Line(piece, "failed", note=": ".join([record.unfinished, *list(reasons.values())[:1]]))


def _sentence(line: Line) -> str:
    what = f"{line.piece.submission.name} on {line.piece.env}: {line.outcome}"
    if line.outcome == "made":
        return f"{what}, {line.seconds:.0f} s"
    return f"{what}: {line.note}" if line.note else what


def summary_table(lines: Sequence[Line]) -> Table:
    """One line per environment: how many records were made, and how long that took."""
    from ..viz.terminal.output import new_table

    headings = ("environment", "made", "kept", "not here", "failed", "left", "minutes", "MiB")
    table = new_table("Records with their rollouts", headings, left=("environment",))
    for env_id in dict.fromkeys(line.piece.env for line in lines):
        own = [line for line in lines if line.piece.env == env_id]
        outcomes = [line.outcome for line in own]
        counts = [str(outcomes.count(name)) for name in ("made", "kept", "not here", "failed", "left")]
        minutes, size = sum(line.seconds for line in own) / 60, sum(line.piece.size for line in own) / MIB
        table.add_row(env_id, *counts, f"{minutes:.1f}", f"{size:.1f}")
    return table


def last_line(lines: Sequence[Line]) -> str:
    """All of it in one sentence."""
    from ..viz.terminal.output import counted

    outcomes = [line.outcome for line in lines]
    minutes, size = sum(line.seconds for line in lines) / 60, sum(line.piece.size for line in lines) / MIB
    made = f"{counted(outcomes.count('made'), 'record')} made in {minutes:.1f} minutes, {outcomes.count('kept')} kept"
    left = outcomes.count("left")
    return f"{made}, {size:.0f} MiB with rollouts" + (f"; {left} left: the same command goes on" if left else "")
