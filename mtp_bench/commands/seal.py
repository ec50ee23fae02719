"""``mtp-bench maintain seal``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer

from ..records import retire
from ..records import seal as draw
from ..records.eligibility import LEAST_HIDDEN
from ..records.seal import COMMITMENT, SEALS, beside
from ..viz.terminal.output import counted, show


def seal(
    env: Annotated[str | None, typer.Option(help="Environment id, or path of a card.")] = None,
    scenes: Annotated[
        int | None, typer.Option("--count", min=1, max=1000, help="Number of hidden scenes; ranks need 50.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="File of the secret, beside its commitment. With --retire: folder."),
    ] = None,
    retire: Annotated[
        Path | None, typer.Option(help="Publish this secret in the folder of seals: it ranks no further submission.")
    ] = None,
) -> None:
    """Draw secret scenes of a simulated environment and commit to them, or publish a secret (maintainers)."""
    if retire is not None:
        if env is not None or scenes is not None:
            raise typer.BadParameter("publishes a secret: leave --env and --count out", param_hint="--retire")
        _retire(retire, output)
        return
    if env is None or scenes is None or output is None:
        raise typer.BadParameter("--env, --count and --output are needed, or --retire")
    _draw(env, scenes, output)


def _draw(env: str, scenes: int, output: Path) -> None:
    promise, public = draw(env, scenes, output), beside(output, COMMITMENT)
    show(
        f"{public}: publish this commitment to {counted(scenes, 'hidden scene')} of {promise.env} in "
        f"leaderboard/seals, sha256 {promise.commitment}"
    )
    if scenes < LEAST_HIDDEN:
        show(f"for trials alone: {counted(scenes, 'scene')} are too few to rank, ranks need {LEAST_HIDDEN}")
    show(f"{output}: keep this secret; `mtp-bench verify RECORD --rerun --hidden {shlex.quote(str(output))}` runs them")


def _retire(secret: Path, folder: Path | None) -> None:
    show(f"{retire(secret, folder or SEALS)}: the secret is public from now on; draw another seal for the next round")
