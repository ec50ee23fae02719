"""A picture with coordinates in metres: lines, boxes and texts, drawn by Pillow.

Everything is drawn larger and reduced, so that no edge is jagged. No meaning depends on
colour alone: truth is a bold outline (dashed where it is not tracked), a detection
thin, a track filled, a false positive crossed. A text is put at a free place beside its
thing, or left out.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...core import Bools, Floats, bev_corners, rotate, unit_vectors
from ..framing import Window
from ..palette import BLACK, EVENT, Color

PAPER = (247, 247, 247)  # beside a picture
WHITE = (255, 255, 255)
GRAY = (90, 90, 90)
EDGE = (200, 200, 200)
FINER = 2  # everything is drawn this much larger
DASH_PX = 4.0
HEADING_PX = 20.0  # that the heading of a box may reach beyond its corners
SMALL, MIDDLE, LARGE = 11, 13, 16  # pixels of letters
BOARD_GAPS_PX = (8.0, 26.0, 48.0, 76.0, 110.0)  # from a thing to a board with its name
# degrees, directions from a thing to its text
TEXT_DIRECTIONS = (-60, 60, -120, 120, -30, 30, -90, 90, 180, 0)
Rectangle = tuple[float, float, float, float]  # left, top, right, bottom in pixels


@dataclass(frozen=True)
class Outline:
    """Style of a box."""

    color: Color
    width: float = 1.0  # pixels
    fill: int = 0  # opacity of the inside, 0 (none) to 255
    dashed: bool = False
    heading: bool = False  # a tick out of the front
    crossed: bool = False


class Canvas:
    """A picture of ``width`` x ``height`` pixels that shows at least ``window``.

    It is empty at first, with the background ``paper``.
    """

    def __init__(
        self, width: int, height: int, window: Window, paper: Color = WHITE
    ) -> None:
        self.width = width
        self.height = height
        self.window = window
        self.text_places: list[Rectangle] = []  # that hold text already
        self._image = Image.new("RGB", (width * FINER, height * FINER), paper)
        self.draw = ImageDraw.Draw(self._image, "RGBA")

    @property
    def scale(self) -> float:
        """Pixels per metre."""
        return min(self.width / self.window.wide, self.height / self.window.high)

    def pixels(self, xy: Floats) -> Floats:
        """Convert places [..., 2], m, to pixels [..., 2], y downwards."""
        offset_m = np.asarray(xy, dtype=np.float64) - [self.window.x, self.window.y]
        rotated = rotate(offset_m, -self.window.turn)
        return rotated * [self.scale, -self.scale] + [self.width / 2, self.height / 2]

    def inside(self, xy: Floats, margin_px: float | Floats = 0.0) -> Bools:
        """Mask places [..., 2] in the picture or its margin."""
        x, y = np.moveaxis(self.pixels(xy), -1, 0)
        in_x = (x >= -margin_px) & (x <= self.width + margin_px)
        return np.asarray(in_x & (y >= -margin_px) & (y <= self.height + margin_px))

    def meets(self, xy: Floats) -> bool:
        """Check if the rectangle around places [n, 2] is in sight."""
        pixels = self.pixels(xy)
        if not len(pixels):
            return False
        begins_before_end = (pixels.min(axis=0) <= (self.width, self.height)).all()
        return bool(begins_before_end and (pixels.max(axis=0) >= 0).all())

    # ---- lines and boxes

    def lines(
        self,
        paths: Iterable[Floats],
        color: Color,
        width: float = 1.0,
        alpha: int = 255,
    ) -> None:
        """Draw polylines [n, 2], m, where ``alpha`` 255 is opaque."""
        for path in paths:
            if len(path) > 1:
                self.stroke(self.pixels(path), color, width, alpha)

    def stroke(
        self,
        pixels: Floats,
        color: Color,
        width: float,
        alpha: int = 255,
        dashed: bool = False,
    ) -> None:
        """Draw a polyline through ``pixels`` [n, 2], ``width`` pixels wide."""
        thick = max(1, round(width * FINER))
        joint = "curve" if thick > 3 else None  # gaps in thin lines cannot be seen
        for part in _dashes(pixels) if dashed else [pixels]:
            self.draw.line(_points(part), (*color, alpha), thick, joint)

    def polygon(self, path: Floats, color: Color) -> None:
        """Fill the area inside places [n, 2] of the world, m."""
        self.draw.polygon(_points(self.pixels(path)), fill=color)

    def boxes(self, box: Floats, outline: Outline) -> None:
        """Draw boxes [n, 7].

        They are x y z yaw l w h, in m and rad. Those out of sight are skipped.
        """
        diagonal_px = np.hypot(box[:, 4], box[:, 5]) * self.scale
        box = box[self.inside(box[:, :2], diagonal_px + HEADING_PX)]
        for row in box:
            corners = self.pixels(bev_corners(row))
            if outline.fill:
                fill = (*outline.color, outline.fill)
                self.draw.polygon(_points(corners), fill=fill)
            lines = [corners[[0, 2]], corners[[1, 3]]] if outline.crossed else []
            if outline.heading:  # from the middle of the front, corners 0 and 3
                tick_m = row[4] / 2 + max(0.4, 0.25 * row[4])
                tip = self.pixels(row[:2] + unit_vectors(row[3]) * tick_m)
                lines.append(np.stack([corners[[0, 3]].mean(axis=0), tip]))
            edge = corners[[0, 1, 2, 3, 0]]
            self.stroke(edge, outline.color, outline.width, dashed=outline.dashed)
            for line in lines:
                self.stroke(line, outline.color, outline.width)

    # ---- signs

    def dot(
        self, pixel: Floats, radius_px: float, color: Color, alpha: int = 255
    ) -> None:
        """Draw a disc around a pixel."""
        self.draw.ellipse(_around(pixel, radius_px), fill=(*color, alpha))

    def ring(self, pixel: Floats, radius_px: float) -> None:
        """Draw a bright circle with a dark edge: an event."""
        for wider, color, width in ((1.0, BLACK, 5.0), (0.0, EVENT, 3.0)):
            square = _around(pixel, radius_px + wider)
            self.draw.ellipse(square, outline=color, width=round(width * FINER))

    def cross(self, pixel: Floats, radius_px: float, color: Color) -> None:
        """Draw two crossed lines on a white edge."""
        for line_color, width in ((WHITE, 5.0), (color, 2.5)):
            for side in (1.0, -1.0):
                ends = pixel + radius_px * np.array([[-1.0, -side], [1.0, side]])
                self.stroke(ends, line_color, width)

    def circle(self, pixel: Floats, radius_px: float, color: Color) -> None:
        """Draw a dashed circle."""
        angle = np.linspace(0.0, 2 * np.pi, 61)
        self.stroke(pixel + radius_px * unit_vectors(angle), color, 1.5, dashed=True)

    # ---- texts

    def text(
        self,
        x: float,
        y: float,
        text: str,
        size_px: int,
        color: Color,
        edge: bool = False,
    ) -> None:
        """Write a text with its top left at a pixel.

        ``edge``: letters have a white edge.
        """
        self.draw.text(
            (round(x * FINER), round(y * FINER)),
            text,
            fill=color,
            font=font(size_px * FINER),
            stroke_width=FINER if edge else 0,
            stroke_fill=WHITE,
        )

    def label(self, xy: Floats, text: str, color: Color, reach_px: float) -> None:
        """Write a small text beside a thing at ``xy`` [2], if there is room.

        ``reach_px``: pixels from the middle of the thing to its edge.
        """
        place = self._free_place(xy, text_size(text, SMALL), (reach_px + 1.0,))
        if place is not None:
            self.text(place[0], place[1], text, SMALL, color, edge=True)

    def callout(
        self,
        xy: Floats,
        text: str,
        color: Color,
        reach_px: float,
        size_px: int = MIDDLE,
    ) -> None:
        """Write a text on a board beside a thing at ``xy`` [2].

        A line from ``reach_px`` pixels off the thing joins both. The text is left out
        where there is no room.
        """
        wide, high = text_size(text, size_px)
        gaps = [reach_px + gap for gap in BOARD_GAPS_PX]
        place = self._free_place(xy, (wide + 8.0, high + 4.0), gaps)
        if place is None:
            return
        start = self.pixels(xy)
        end = np.clip(start, place[:2], place[2:])  # the nearest point of the board
        start = start + reach_px * (end - start) / max(np.hypot(*(end - start)), 1e-9)
        self.stroke(np.stack([start, end]), color, 1.0)
        square = [round(edge * FINER) for edge in place]
        self.draw.rectangle(square, fill=WHITE, outline=color, width=FINER)
        self.text(place[0] + 4, place[1] + 1, text, size_px, color)

    def _free_place(
        self, xy: Floats, size_px: tuple[float, float], gaps: Iterable[float]
    ) -> Rectangle | None:
        """Take a free rectangle of ``size_px`` pixels beside a place.

        ``gaps``: distances from it in pixels, tried in this order. None without room.
        """
        if not self.inside(xy):
            return None
        half = np.array(size_px) / 2
        for gap, angle in product(gaps, np.deg2rad(TEXT_DIRECTIONS)):
            way = unit_vectors(angle)
            center = self.pixels(xy) + way * (gap + half)
            place = (*(center - half).tolist(), *(center + half).tolist())
            if self._is_free(place):
                self.text_places.append(place)
                return place
        return None

    def _is_free(self, place: Rectangle) -> bool:
        """Check that a rectangle is in the picture and off all texts."""
        left_px, top, right, bottom = place
        if min(left_px, top) < 2 or right > self.width - 2 or bottom > self.height - 2:
            return False
        return not any(
            left_px < used[2] and used[0] < right and top < used[3] and used[1] < bottom
            for used in self.text_places
        )

    def scale_bar(self) -> None:
        """Draw a bar of a round number of metres."""
        max_m = self.width / self.scale / 5  # a fifth of the picture
        power = 10.0 ** np.floor(np.log10(max_m))
        steps = [step * power for step in (0.5, 1.0, 2.0, 5.0) if step * power <= max_m]
        text = f"{steps[-1]:g} m"
        wide, high = text_size(text, MIDDLE)
        left_px = 16.0
        bottom = self.height - 16.0
        right = left_px + steps[-1] * self.scale
        top = bottom - high - 7
        board = (left_px - 8, top - 5, max(right, left_px + wide) + 8, bottom + 8)
        self.text_places.append(board)
        self.draw.rectangle([edge * FINER for edge in board], fill=WHITE)
        ends = [
            (left_px, bottom - 5),
            (left_px, bottom),
            (right, bottom),
            (right, bottom - 5),
        ]
        self.stroke(np.array(ends), BLACK, 2.0)
        self.text((left_px + right - wide) / 2, top, text, MIDDLE, BLACK)

    def finished(self) -> Image.Image:
        """Return the picture, reduced to its size."""
        return self._image.reduce(FINER)


@cache
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Load the font that Pillow ships, the same on every machine."""
    return ImageFont.load_default(size_px)


@cache
def text_size(text: str, size_px: int) -> tuple[float, float]:
    """Return width and height of a text in pixels."""
    left_px, _, right, _ = font(size_px).getbbox(text)
    return right - left_px, size_px * 1.2


def _points(pixels: Floats) -> list[tuple[float, ...]]:
    """Return ``pixels`` [n, 2] as points of the enlarged image."""
    return [tuple(point) for point in (pixels * FINER).tolist()]


def _around(pixel: Floats, radius_px: float) -> list[tuple[float, ...]]:
    """Return corners of a square around a circle, enlarged."""
    return _points(np.stack([pixel - radius_px, pixel + radius_px]))


def _dashes(path: Floats) -> Iterable[Floats]:
    """Cut a polyline [n, 2] of pixels into dashes [2, 2]."""
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(path, axis=0).T)))
    count = max(2, round(float(along[-1]) / (2 * DASH_PX)))
    cuts = np.linspace(0.0, along[-1], 2 * count)
    points = np.column_stack([np.interp(cuts, along, axis) for axis in path.T])
    return points.reshape(count, 2, 2)
