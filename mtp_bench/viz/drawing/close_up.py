"""Picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from ...geometry import bev_corners
from ...types import Floats
from ..case import ObjectForecast
from ..focus import ROLES, Focus, FocusFrame, Window
from ..palette import BLACK, Color
from .birds_eye import draw_lanes
from .canvas import Canvas, Outline
from .labels import MIDDLE, callout, scale_bar

OBJECT = Outline(ROLES["truth"], 2.5, heading=True)
OTHER_OBJECT = Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
DETECTION_NEAR = Outline(ROLES["detection"], 1.0, dashed=True)
DIM_TRUTH = Outline((205, 205, 205), 1.0, fill=40)
DIM_TRACK = Outline((215, 215, 215), 0.8)
DIM_DETECTION = Outline((225, 225, 225), 0.8)
GAP = 1.0  # m, between the ends of forecast and future: smaller gaps need no line
BIG = 15  # pixels of letters
MISSING = {  # (no track, no forecast) -> text
    (True, True): "no track, no forecast", (True, False): "no track", (False, True): "no forecast",
}  # fmt: skip


class Name(NamedTuple):
    """A text for a place."""

    place: Floats  # [2] m
    text: str
    color: Color
    reach: float = 6.0  # pixels from the place to the edge of the thing


def draw_focus(focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False) -> Image.Image:
    """Frame ``t`` of an event in ``size`` pixels; ``near``: a small picture of the boxes, without forecasts."""
    canvas = Canvas.blank(*size, window)
    close_up = CloseUp(focus, focus.frame(t), [] if near else focus.forecasts(t), near, canvas)
    close_up.draw()
    image = canvas.finished()
    close_up.write_names(ImageDraw.Draw(image))
    return image


@dataclass(frozen=True, eq=False)
class CloseUp:
    """One frame of an event on a canvas."""

    focus: Focus
    shown: FocusFrame
    forecasts: list[tuple[str, ObjectForecast]]  # each with its role
    near: bool  # a small picture of the boxes alone
    canvas: Canvas

    @property
    def place(self) -> Floats:
        """Place [2] of the object."""
        return self.focus.case.place(self.shown.frame)

    @property
    def ringed(self) -> bool:
        """True if the ring is drawn."""
        return self.near or self.focus.ringed(self.shown.frame)

    @cached_property
    def center(self) -> NDArray[np.float64]:
        """Pixel [2] of the middle of the ring."""
        return self.canvas.pixels(self.place)

    @cached_property
    def radius(self) -> float:
        """Pixels of the ring, which is around the box of the object."""
        size = self.shown.object_box[0, 4:6] if len(self.shown.object_box) else np.ones(2)
        return float(np.clip(0.6 * np.hypot(size[0], size[1]) * self.canvas.scale, 15.0, 110.0))

    @cached_property
    def gap(self) -> Floats | None:
        """From the end of the newest forecast to the object's place then [2, 2]; None if near or unknown."""
        future = self.shown.future
        newest = [forecast for role, forecast in self.forecasts if role == "now"]
        if not newest or len(future) < 2:
            return None
        ends = np.stack([newest[-1].nearest_path[: len(future)][-1], future[-1]])
        return ends if np.hypot(*(ends[1] - ends[0])) > GAP else None

    def draw(self) -> None:
        """Draw everything but the names, the dim things first."""
        canvas, shown = self.canvas, self.shown
        draw_lanes(canvas, self.focus.replay.scene.lanes)
        canvas.boxes(shown.dim_detection, DIM_DETECTION)
        canvas.boxes(shown.dim_track, DIM_TRACK)
        canvas.boxes(shown.dim_truth, DIM_TRUTH)
        for role, forecast in self.forecasts:
            self._draw_forecast(forecast, ROLES[role], role == "now")
        for track in shown.tracks:
            canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
        canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
        if not self.near and len(shown.future) > 1:
            canvas.lines([shown.future], ROLES["truth"], 4.0)
            canvas.dot(canvas.pixels(shown.future[-1]), 6.0, ROLES["truth"])
        canvas.boxes(shown.others, OTHER_OBJECT)
        for track in shown.tracks:
            canvas.boxes(track.box[None], Outline(ROLES[track.role], 1.5, fill=90))
        canvas.boxes(shown.object_box, OBJECT)
        canvas.boxes(shown.detection_box, DETECTION_NEAR)
        for xy in canvas.pixels(shown.detection_box[:, :2]):
            canvas.dot(xy, 2.0, BLACK)
        if self.gap is not None:
            canvas.stroke(canvas.pixels(self.gap), BLACK, 1.2, dashed=True)
        if self.ringed:
            canvas.ring(self.center, self.radius)

    def _draw_forecast(self, forecast: ObjectForecast, color: Color, newest: bool) -> None:
        """The sample nearest to the truth bold, with a dot at its end, the others thin; an old one alone, dashed."""
        for path in forecast.path if newest else ():
            self.canvas.lines([np.concatenate([forecast.start[None], path])], color, 1.0, 70)
        nearest = self.canvas.pixels(forecast.nearest_path)
        self.canvas.stroke(nearest, color, 3.0 if newest else 2.0, dashed=not newest)
        self.canvas.dot(nearest[-1], 5.0 if newest else 3.5, color)

    def write_names(self, ink: ImageDraw.ImageDraw) -> None:
        """Write the scale bar and the names, the most important first, the last ones if there is room.

        A name lies neither on another one, nor on the object, nor on a path.
        """
        canvas = self.canvas
        scale_bar(canvas, ink)
        around = self.radius + 3.0 if self.ringed else 0.8 * self.radius
        self._take(self.center[None], around)
        for box in [*(track.box for track in self.shown.tracks), *self.shown.others]:
            self._take(canvas.pixels(bev_corners(box)), 0.0)
        for path in [self.shown.future, *(forecast.nearest_path for _, forecast in self.forecasts)]:
            for a, b in pairwise(path):
                for xy in canvas.pixels(np.linspace(a, b, 4)):
                    self._take(xy[None], 4.0)
        for name in self._names():
            if canvas.inside(name.place):
                size = MIDDLE if self.near else BIG
                callout(canvas, ink, canvas.pixels(name.place), name.text, name.color, name.reach, size)

    def _take(self, pixels: NDArray[np.float64], margin: float) -> None:
        """Keep names off the rectangle around ``pixels`` [n, 2]."""
        left, top = (pixels.min(axis=0) - margin).tolist()
        right, bottom = (pixels.max(axis=0) + margin).tolist()
        self.canvas.taken.append((left, top, right, bottom))

    def _names(self) -> Iterator[Name]:
        gap, scale = self.gap, self.canvas.scale
        if gap is not None:
            yield Name(gap.mean(axis=0), f"{np.hypot(*(gap[1] - gap[0])):.1f} m off", BLACK, 2.0)
        for track in self.shown.tracks:
            half = 0.5 * float(track.box[5]) * scale
            yield Name(track.box[:2], f"track {track.track_id}", ROLES[track.role], half)
        for box, text in zip(self.shown.others, self.shown.other_names, strict=True):
            yield Name(box[:2], text, ROLES["truth"], 0.5 * float(box[5]) * scale)
        if not self.near:
            yield from self._names_of_object()
            yield from self._names_of_ends()

    def _names_of_object(self) -> Iterator[Name]:
        """The object, and its missing track or forecast from the event on."""
        if not len(self.shown.object_box):
            return
        no_forecast = all(role != "now" for role, _ in self.forecasts)
        missing = MISSING.get((self.shown.follower < 0, no_forecast))
        if missing is not None and self.shown.frame >= self.focus.at.frame:
            yield Name(self.place, missing, ROLES["now"], self.radius)
        yield Name(self.place, self.focus.named, ROLES["truth"], self.radius)

    def _names_of_ends(self) -> Iterator[Name]:
        """The ends of the object's future and of the forecasts."""
        t, future, seconds = self.shown.frame, self.shown.future, self.focus.case.seconds
        if len(future) > 1:
            later = seconds(t + len(future) - 1) - seconds(t)
            yield Name(future[-1], f"true, {later:.1f} s later", ROLES["truth"], 7.0)
        for role, forecast in reversed(self.forecasts):
            when = "now"
            if role == "before" and t >= self.focus.at.frame:
                when = "a frame before" if t == self.focus.at.frame else "before the event"
            yield Name(forecast.nearest_path[-1], f"forecast {when}", ROLES[role])
