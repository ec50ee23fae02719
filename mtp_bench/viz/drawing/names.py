"""Names of what is bright in the picture of an event; none lies on another one, on the object or on a path."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...geometry import bev_corners
from ...types import Floats
from ..focus import ROLES
from ..palette import BLACK, Color
from .close_up import CloseUp
from .labels import MIDDLE, callout, scale_bar

if TYPE_CHECKING:
    from PIL import ImageDraw

BIG = 15  # pixels of letters
MISSING = {  # of a track and of a forecast
    (True, True): "no track, no forecast", (True, False): "no track", (False, True): "no forecast",
}  # fmt: skip


class Name(NamedTuple):
    """A text for a place."""

    place: Floats  # [2] m
    text: str
    color: Color
    reach: float = 6.0  # pixels from the place to the edge of the thing


def write_names(view: CloseUp, ink: ImageDraw.ImageDraw) -> None:
    """Write the names and the scale bar; the most important names first, the last ones where there is room."""
    canvas = view.canvas
    scale_bar(canvas, ink)
    held = view.radius + 3.0 if view.ringed else 0.8 * view.radius
    canvas.taken.append((*(view.center - held).tolist(), *(view.center + held).tolist()))
    for box in [*(track.box for track in view.shown.tracks), *view.shown.others]:
        corners = canvas.pixels(bev_corners(box))
        canvas.taken.append((*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()))
    for path in [view.shown.future, *(forecast.nearest_path for _, forecast in view.forecasts)]:
        _keep_clear(view, path)
    for name in (
        _of_boxes(view) if view.near else [*_of_gap(view), *_of_boxes(view), *_of_object(view), *_of_ends(view)]
    ):
        if canvas.inside(name.place):
            tip = canvas.pixels(name.place)
            callout(canvas, ink, tip, name.text, name.color, name.reach, MIDDLE if view.near else BIG)


def _keep_clear(view: CloseUp, path: Floats) -> None:
    """No name lies on ``path`` [n, 2]."""
    for a, b in pairwise(path):
        for xy in view.canvas.pixels(np.linspace(a, b, 4)):
            view.canvas.taken.append((*(xy - 4).tolist(), *(xy + 4).tolist()))


def _of_gap(view: CloseUp) -> Iterator[Name]:
    if view.gap is not None:
        yield Name(view.gap.mean(axis=0), f"{np.hypot(*(view.gap[1] - view.gap[0])):.1f} m off", BLACK, 2.0)


def _of_boxes(view: CloseUp) -> Iterator[Name]:
    """The tracks, and the true objects that they follow besides the object."""
    for track in view.shown.tracks:
        half = 0.5 * float(track.box[5]) * view.canvas.scale
        yield Name(track.box[:2], f"track {track.track_id}", ROLES[track.role], half)
    for box, text in zip(view.shown.others, view.shown.other_names, strict=True):
        yield Name(box[:2], text, ROLES["truth"], 0.5 * float(box[5]) * view.canvas.scale)


def _of_object(view: CloseUp) -> Iterator[Name]:
    """The object, and what it ought to have from the event on and has not."""
    focus, shown = view.focus, view.shown
    if not len(shown.object_box):
        return
    forecast = any(role == "now" for role, _ in view.forecasts)
    missing = MISSING.get((shown.follower < 0, not forecast)) if view.happened else None
    if missing is not None:
        yield Name(view.place, missing, ROLES["now"], view.radius)
    yield Name(view.place, f"{focus.case.noun} {focus.at.object_id}", ROLES["truth"], view.radius)


def _of_ends(view: CloseUp) -> Iterator[Name]:
    """Where the object goes, and where the forecasts end."""
    future, seconds = view.shown.future, view.focus.case.seconds
    if len(future) > 1:
        later = seconds(view.shown.frame + len(future) - 1) - seconds(view.shown.frame)
        yield Name(future[-1], f"true, {later:.1f} s later", ROLES["truth"], 7.0)
    for role, forecast in reversed(view.forecasts):
        if role == "now" or not view.happened:
            when = "now"
        else:
            when = "a frame before" if view.shown.frame == view.focus.at.frame else "before the event"
        yield Name(forecast.nearest_path[-1], f"forecast {when}", ROLES[role])
