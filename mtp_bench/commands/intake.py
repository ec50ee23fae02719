"""``mtp-bench maintain intake``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import RecordError
from ..records import trusted
from ..records.intake import take_in
from ..viz.terminal.output import show
from .options import JsonOption
from .output import require_writable, some_of, write_json


def intake(
    leaderboard: Annotated[Path, typer.Argument(help="Folder leaderboard that a pull request proposes.")],
    owner: Annotated[str, typer.Option(help="Login of its author.")],
    base: Annotated[Path | None, typer.Option(help="Leaderboard that it changes. Default: the one that ships.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check the records and names of a pull request; no code of a submission is run."""
    require_writable(json_file)
    trust = trusted(base)
    outcome = take_in(leaderboard, trust, owner)
    write_json(json_file, {"accepted": list(map(str, outcome.accepted)), "refused": list(outcome.refused)})
    for text in (*(f"{path}: can be taken in" for path in outcome.accepted), *outcome.notes):
        show(text)
    if outcome.refused:
        raise RecordError(some_of(outcome.refused))
    if not outcome.accepted:
        show(f"no record to take in: all are as in {trust.folder}")
