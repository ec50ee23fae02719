"""Where the views of a recording look, and what all of them show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...types import Floats
from .sdk import rr, rrb

SHARED = ("world/map/**", "world/ego", "world/gt", "world/gt_future", "world/at")
FOLLOW = "world/follow"
FALSE = "world/false_forecast"  # forecasts of nothing
BACKGROUND = (18, 18, 24)
ABOVE, NORTH = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)  # where an eye is, in units of the reach; what is up there


@dataclass(frozen=True, eq=False)
class Eye:
    """Where the views look, and from where."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame they show: FOLLOW moves along with the sensors
    root: str = ""  # prefix of the paths of what all agents share
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(self, name: str, paths: Sequence[str], hypothesis: str | None = None) -> rrb.Spatial3DView:
        """What all agents share, the entities at ``paths``, and a hypothesis at its path, its tracks with labels.

        Forecasts of nothing among them are hidden until their eye icon is clicked.
        """
        contents = [*(f"/{self.root}{path}" for path in SHARED), *paths]
        contents += [] if hypothesis is None else [f"{hypothesis}/**"]
        false = [path.removesuffix("/**") for path in paths if path.endswith(f"{FALSE}/**")]
        overrides: dict[Any, Any] = {path: rrb.EntityBehavior(visible=False) for path in false}
        if hypothesis is not None:
            overrides[f"{hypothesis}/box"] = rr.Boxes3D.from_fields(show_labels=True)
        return self.seen(name, contents, overrides)

    def seen(self, name: str, contents: Sequence[str], overrides: dict[Any, Any]) -> rrb.Spatial3DView:
        """A view of the entities ``contents``, changed as ``overrides`` say."""
        position = self.center + self.reach * np.array(self.offset)
        return rrb.Spatial3DView(
            origin=self.origin,
            contents=contents,
            name=name,
            background=rrb.Background(kind="SolidColor", color=BACKGROUND),
            line_grid=rrb.LineGrid3D(visible=False),
            eye_controls=rrb.EyeControls3D(position=position, look_target=self.center, eye_up=self.up),
            overrides=overrides,
        )
