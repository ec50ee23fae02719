"""``mtp-bench seal``, for maintainers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import EnvOption
from .output import count


def seal(
    env: EnvOption,
    scenes: Annotated[int, typer.Option("--count", min=1, max=1000, help="Number of hidden scenes.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File of the secret; its commitment goes beside it.")],
) -> None:
    """Draw secret scenes of a simulated environment and commit to them (maintainers)."""
    from ..records import seal as draw
    from ..records.sealing import commitment_path
    from ..viz.terminal.output import show

    promise = draw(env, scenes, output)
    show(
        f"{commitment_path(output)}: publish this commitment to {count(scenes, 'hidden scene')} of {promise.env}, "
        f"sha256 {promise.commitment}"
    )
    show(f"{output}: keep this secret; `mtp-bench verify RECORD --rerun --hidden {output}` runs them")
