"""One frame of an event on a canvas: what is drawn there, and where its ring and its gap are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...types import Floats
from ..case import Forecast
from ..focus import Focus, FocusFrame, Window
from .canvas import Canvas, Viewport

GAP = 1.0  # m, that the forecast is off at its end: less needs no line


@dataclass(frozen=True, eq=False)
class CloseUp:
    """Frame ``t`` of an event; ``near``: in a small picture, of the boxes alone."""

    focus: Focus
    shown: FocusFrame
    forecasts: list[tuple[str, Forecast]]  # each with its role
    near: bool
    canvas: Canvas

    @classmethod
    def of(cls, focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool) -> CloseUp:
        """Nothing drawn yet, on a canvas of ``size`` pixels that shows ``window``."""
        canvas = Canvas.blank(*size, Viewport(window.x, window.y, window.wide, window.high, window.turn))
        return cls(focus, focus.frame(t), [] if near else focus.forecasts(t), near, canvas)

    @property
    def happened(self) -> bool:
        """Whether the frame is that of the event or a later one."""
        return self.shown.frame >= self.focus.at.frame

    @property
    def place(self) -> Floats:
        """Where the object is [2]."""
        return self.focus.case.place(self.shown.frame)

    @property
    def ringed(self) -> bool:
        """Whether the ring is drawn."""
        return self.near or self.focus.lasts(self.shown.frame)

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
        """From where the newest forecast ends to where the object then is [2, 2]; None if near or unknown."""
        future = self.shown.future
        newest = [forecast for role, forecast in self.forecasts if role == "now"]
        if not newest or len(future) < 2:
            return None
        ends = np.stack([newest[-1].nearest_path[: len(future)][-1], future[-1]])
        return ends if np.hypot(*(ends[1] - ends[0])) > GAP else None
