"""Views of a recording: the eye of 3D views, and the columns that show an event alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...types import Floats
from ..focus import Focus
from ..palette import Color
from ..photo import photo_of
from ..replay import NO_EVENT
from .contents import Contents, ShownAgent
from .sdk import rr, rrb

SHARED = ("world/map/**", "world/ego", "world/gt", "world/gt_future", "world/at")
FOLLOW = "world/follow"
FALSE = "world/false_forecast"
BACKGROUND = (18, 18, 24)
ABOVE, NORTH = (0.0, 0.0, 2.2), (0.0, 1.0, 0.0)  # place of an eye in units of the reach; direction that is up there
DARK: Color = (66, 66, 76)  # true boxes that are not of the event
DARKER: Color = (46, 46, 54)  # detections and tracks
DARKEST: Color = (34, 34, 42)  # forecasts
ASPECT = 1.9  # width of the view in units of its height


@dataclass(frozen=True, eq=False)
class Eye:
    """Place and target of the views."""

    center: Floats  # [3]
    reach: float  # m, half the side of what they show
    origin: str = "/world"  # entity whose frame of reference they show: FOLLOW moves along with the sensors
    root: str = ""  # prefix of the paths that all agents share
    offset: tuple[float, float, float] = ABOVE
    up: tuple[float, float, float] = NORTH

    def view(self, name: str, paths: Sequence[str], hypothesis: str | None = None) -> rrb.Spatial3DView:
        """The entities that all agents share, those at ``paths``, and a hypothesis at its path, with labels.

        False forecasts among them are hidden until their eye icon is clicked.
        """
        contents = [*(f"/{self.root}{path}" for path in SHARED), *paths]
        false = [path.removesuffix("/**") for path in paths if path.endswith(f"{FALSE}/**")]
        overrides: dict[Any, Any] = {path: rrb.EntityBehavior(visible=False) for path in false}
        if hypothesis is not None:
            contents += [f"{hypothesis}/**"]
            overrides[f"{hypothesis}/box"] = rr.Boxes3D.from_fields(show_labels=True)
        return self.view_of(name, contents, overrides)

    def view_of(self, name: str, contents: Sequence[str], overrides: dict[Any, Any]) -> rrb.Spatial3DView:
        """A view of the entities ``contents``, changed by ``overrides``."""
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


def focus_columns(contents: Contents, others: Sequence[Sequence[Any]]) -> list[Any]:
    """Columns of an event: of each run the event alone above its small pictures; texts after the first one.

    ``others``: of each run the views of everything, in tabs behind.
    """
    columns = [_alone(agent, focus, behind) for (agent, focus), behind in zip(contents.focuses, others, strict=True)]
    return [columns[0], _texts(contents.focuses), *columns[1:]]


def _alone(agent: ShownAgent, focus: Focus, others: Sequence[Any]) -> Any:
    """The event from above, turned like its picture, above the small pictures."""
    window, root = focus.window(), agent.focus_root
    reach = 0.85 * max(window.high, window.wide / ASPECT) / 2
    up = (-float(np.sin(focus.turn)), float(np.cos(focus.turn)), 0.0)
    eye = Eye(np.array([window.x, window.y, focus.height]), reach, up=up)
    paths = [f"/world/{name}" for name in ("map/**", "ego", "gt", "det", "at")]
    paths += [f"/{root}world/focus/**", f"/{agent.root}world/forecast", f"/{agent.root}{FALSE}/**"]
    dim: dict[Any, Any] = {
        "/world/gt": rr.Boxes3D.from_fields(colors=DARK, radii=-0.8),
        "/world/det": rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5),
        "/world/ego": rr.Boxes3D.from_fields(colors=DARKER),
        # forecasts are hidden until their eye icon is clicked
        f"/{agent.root}world/forecast": [
            rr.LineStrips3D.from_fields(colors=DARKEST), rrb.EntityBehavior(visible=False)
        ],
        f"/{agent.root}{FALSE}": rrb.EntityBehavior(visible=False),
    }  # fmt: skip
    if agent.best is not None:
        box = f"/{agent.root}world/hyp/{agent.best:02d}/box"
        paths.append(box)
        dim[box] = rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5, show_labels=False, fill_mode="majorwireframe")
    name = f"{focus.at.name} alone" if focus.at.kind != NO_EVENT else "the same object: no event"
    view = eye.view_of(agent.titled(name), paths, dim)
    name = agent.titled("the frames t - 1, t and t + 1")
    pictures = rrb.Spatial2DView(origin=f"/{root}focus/pictures", name=name)
    return rrb.Vertical(rrb.Tabs(view, *others, active_tab=0), pictures, row_shares=[2.3, 1])


def _texts(focuses: Sequence[tuple[ShownAgent, Focus]]) -> Any:
    """The sentence and the key of each run, and the camera image of the event, if there is one."""
    texts: list[Any] = [
        rrb.TextDocumentView(origin=f"/{agent.focus_root}focus/text", name=agent.titled("what happened"))
        for agent, _ in focuses
    ]
    photo = photo_of(focuses[0][1], focuses[0][1].at.frame)
    if photo is not None and photo.picture is not None:
        texts.append(rrb.Spatial2DView(origin="/focus/camera", name=f"camera image: {photo.image.camera}"))
    if len(texts) == 1:
        return texts[0]
    return rrb.Vertical(*texts, row_shares=[1.2 if len(focuses) == 1 else 1.0, *[1.0] * (len(texts) - 1)])
