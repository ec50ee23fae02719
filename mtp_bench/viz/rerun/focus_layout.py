"""The part of the layout that shows an event alone: views, small pictures, sentences with keys, a camera image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import MtpBenchError
from ..focus import Focus
from ..palette import Color
from ..photo import photo_of
from ..replay import NO_EVENT
from .arrays import Contents, ShownAgent
from .eye import FALSE, Eye
from .sdk import rr, rrb

DARK: Color = (66, 66, 76)  # true boxes that are not of the event
DARKER: Color = (46, 46, 54)  # detections and tracks
DARKEST: Color = (34, 34, 42)  # forecasts
ASPECT = 1.9  # width of the view in units of its height


def focus_columns(contents: Contents, others: Sequence[Sequence[Any]]) -> list[Any]:
    """Columns of an event: of each run the event alone above its small pictures; after the first one, what is told.

    ``others``: of each run the views of everything, in tabs behind.
    """
    if not contents.focuses:
        raise MtpBenchError("a view of an event needs an event")
    columns = [_alone(agent, focus, behind) for (agent, focus), behind in zip(contents.focuses, others, strict=True)]
    return [columns[0], _told(contents.focuses), *columns[1:]]


def _alone(agent: ShownAgent, focus: Focus, others: Sequence[Any]) -> Any:
    name = f"{focus.at.name} alone" if focus.at.kind != NO_EVENT else "the same object: no event"
    view = _eye(focus).seen(agent.titled(name), _contents(agent), _dimmed(agent))
    root = f"/{agent.focus_root}focus/pictures"
    pictures = rrb.Spatial2DView(origin=root, name=agent.titled("the frames t - 1, t and t + 1"))
    return rrb.Vertical(rrb.Tabs(view, *others, active_tab=0), pictures, row_shares=[2.3, 1])


def _told(focuses: Sequence[tuple[ShownAgent, Focus]]) -> Any:
    """The sentence and the key of each run, and the camera image of the event, where there is one."""
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


def _eye(focus: Focus) -> Eye:
    """From above, turned like the picture: the way of the object points to the right."""
    window = focus.window()
    reach = 0.85 * max(window.high, window.wide / ASPECT) / 2
    up = (-float(np.sin(focus.turn)), float(np.cos(focus.turn)), 0.0)
    return Eye(np.array([window.x, window.y, focus.height]), reach, up=up)


def _contents(agent: ShownAgent) -> list[str]:
    paths = [f"/world/{name}" for name in ("map/**", "ego", "gt", "det", "at")]
    paths += [f"/{agent.focus_root}world/focus/**", f"/{agent.root}world/forecast", f"/{agent.root}{FALSE}/**"]
    return paths if agent.best is None else [*paths, f"/{agent.root}world/hyp/{agent.best:02d}/box"]


def _dimmed(agent: ShownAgent) -> dict[Any, Any]:
    """How everything else is drawn; forecasts are hidden until their eye icon is clicked."""
    dim: dict[Any, Any] = {
        "/world/gt": rr.Boxes3D.from_fields(colors=DARK, radii=-0.8),
        "/world/det": rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5),
        "/world/ego": rr.Boxes3D.from_fields(colors=DARKER),
        f"/{agent.root}world/forecast": [
            rr.LineStrips3D.from_fields(colors=DARKEST), rrb.EntityBehavior(visible=False)
        ],
        f"/{agent.root}{FALSE}": rrb.EntityBehavior(visible=False),
    }  # fmt: skip
    if agent.best is not None:
        box = f"/{agent.root}world/hyp/{agent.best:02d}/box"
        dim[box] = rr.Boxes3D.from_fields(colors=DARKER, radii=-0.5, show_labels=False, fill_mode="majorwireframe")
    return dim
