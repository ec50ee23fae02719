"""The part of the layout that shows an event alone: the view, the small pictures, the sentence with the key."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import MtpBenchError
from ..focus import Focus
from ..palette import Color
from .arrays import Contents, ShownAgent
from .eye import FALSE, Eye
from .sdk import rr, rrb

DARK: Color = (66, 66, 76)  # true boxes that are not of the event
DARKER: Color = (46, 46, 54)  # detections and tracks
DARKEST: Color = (34, 34, 42)  # forecasts
ASPECT = 1.9  # width of the view in units of its height


def focus_columns(contents: Contents, others: Sequence[Any]) -> list[Any]:
    """Two columns: the event alone above its small pictures, and the sentence with the key.

    ``others``: the views of everything, in tabs behind.
    """
    if contents.at is None:
        raise MtpBenchError("a view of an event needs an event")
    focus, agent = Focus.of(contents.agents[0].replay, contents.at), contents.agents[0]
    view = _eye(focus).seen(agent.titled(f"{contents.at.name} alone"), _contents(agent), _dimmed(agent))
    pictures = rrb.Spatial2DView(origin="/focus/pictures", name="the frames t - 1, t and t + 1")
    text = rrb.TextDocumentView(origin="/focus/text", name="what happened")
    return [rrb.Vertical(rrb.Tabs(view, *others, active_tab=0), pictures, row_shares=[2.3, 1]), text]


def _eye(focus: Focus) -> Eye:
    """From above, turned like the picture: the way of the object points to the right."""
    window = focus.window()
    reach = 0.85 * max(window.high, window.wide / ASPECT) / 2
    up = (-float(np.sin(focus.turn)), float(np.cos(focus.turn)), 0.0)
    return Eye(np.array([window.x, window.y, focus.height]), reach, up=up)


def _contents(agent: ShownAgent) -> list[str]:
    paths = ["/world/map/**", "/world/ego", "/world/gt", "/world/det", "/world/at", "/world/focus/**"]
    paths += [f"/{agent.root}world/forecast", f"/{agent.root}{FALSE}/**"]
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
