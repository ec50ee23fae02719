"""``mtp-bench maintain``: commands of the maintainers."""

from __future__ import annotations

from typing import ClassVar

import typer

from .lazy import LazyGroup


class MaintainerCommands(LazyGroup):
    """Commands that only maintainers of the leaderboard and of the environments need."""

    summaries: ClassVar[dict[str, str]] = {
        "seal": "Draw secret scenes of a simulated environment, or publish a secret.",
        "freeze": "Write the frozen event weights of a shipped environment.",
        "intake": "Check the records and names of a pull request.",
    }


maintain = typer.Typer(cls=MaintainerCommands, no_args_is_help=True, add_completion=False, rich_markup_mode=None)


@maintain.callback()
def about() -> None:
    """Commands of the maintainers."""
