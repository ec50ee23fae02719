"""How far a record was checked, and what it scored on hidden scenes."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from ..scoring.rows import Count, Interval
from ..strict import Section

Level = Literal["scored", "re-scored", "re-run", "hidden"]
LEVELS: tuple[Level, ...] = get_args(Level)  # from the weakest on, each includes those before it
_Hex = Annotated[str, Field(pattern=r"^[0-9a-f]*$")]


class HiddenPart(Section):
    """Error on scenes of secret seeds, over all of them: the name of a scene tells its seed."""

    commitment: _Hex  # sha256 of the secret
    weights: _Hex  # hash of their event weights, which are made once per seal
    scenes: Count
    targets: Count
    error: float | None
    interval: Interval | None
