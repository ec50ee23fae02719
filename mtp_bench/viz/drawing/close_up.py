"""Picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from ...geometry import bev_corners
from ...types import Floats
from ..evidence import distance, gate
from ..focus import Focus, ObjectForecast
from ..framing import ROLES, FocusFrame, Window, frame_of
from ..palette import BLACK, Color
from ..replay import KINDS, ego_boxes
from .birds_eye import draw_lanes
from .canvas import GRAY, VEHICLE, Canvas, Outline
from .column import Mark
from .labels import MIDDLE, callout, pointer, scale_bar

OBJECT = Mark("{}, true box", Outline(ROLES["truth"], 2.5, heading=True))
WAY = Mark("where it really goes", line=ROLES["truth"], width=4.0)
OTHER_OBJECT = Mark("another true object", Outline(ROLES["truth"], 1.2, heading=True, dashed=True))
DETECTED = Mark("detection, with its score", Outline(ROLES["detection"], 1.0, dashed=True))
TAKEN = Mark("to the detection that a track took", line=BLACK)
EXPECTED = Mark("expected, by its own last forecast", sign="cross")
GATE = Mark("event gate: {}", line=GRAY, sign="circle")
REST = Mark("all other boxes", Outline((205, 205, 205), 1.0, fill=40))
DIM_TRACK = Outline((215, 215, 215), 0.8)
DIM_DETECTION = Outline((225, 225, 225), 0.8)
HOLDS = {"before": "which had it before", "now": "which has it now", "named": "named above"}  # role of a track
GAP = 1.0  # m, between the ends of forecast and future: smaller gaps need no line
BIG = 15  # pixels of letters
Forecasts = Sequence[tuple[str, ObjectForecast]]  # each with its role


class Name(NamedTuple):
    """A text for a place."""

    place: Floats  # [2] m
    text: str
    color: Color
    reach: float = 6.0  # pixels from the place to the edge of the thing
    far: bool = False  # an arrow at the edge points to the thing where it is outside of the picture


@dataclass(frozen=True, eq=False)
class KeyedCanvas:
    """A canvas, and the marks that have been drawn inside it, the last one first."""

    canvas: Canvas
    marks: list[Mark] = field(default_factory=list)

    @property
    def key(self) -> list[Mark]:
        """The marks, the object and what was drawn last first."""
        return sorted(self.marks, key=lambda mark: mark.box != OBJECT.box)

    def boxes(self, box: Floats, mark: Mark) -> None:
        """Draw boxes [n, 7] in the style of a mark."""
        if mark.box is not None:
            self.canvas.boxes(box, mark.box)
        self.note(box[:, :2], mark)

    def path(self, path: Floats, mark: Mark, dot: float) -> None:
        """Draw a path [n, 2] m in the style of a mark, with a ``dot`` of so many pixels at its end."""
        pixels, color = self.canvas.pixels(path), mark.line or BLACK
        self.canvas.stroke(pixels, color, mark.width, dashed=mark.dashed)
        self.canvas.dot(pixels[-1], dot, color)
        self.note(path, mark)

    def note(self, xy: Floats, mark: Mark) -> None:
        """Remember a mark that is drawn at places [n, 2] m."""
        if mark not in self.marks and self.canvas.inside(xy).any():
            self.marks.insert(0, mark)


def draw_focus(
    focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False
) -> tuple[Image.Image, list[Mark]]:
    """Frame ``t`` of an event in ``size`` pixels, and the marks in it; ``near``: the boxes alone, without forecasts."""
    canvas, shown = Canvas.blank(*size, window), frame_of(focus, t)
    sketch, forecasts, place = KeyedCanvas(canvas), [] if near else focus.forecasts(t), focus.place(t)
    box = shown.object_box[0, 4:6] if len(shown.object_box) else np.ones(2)
    radius = float(np.clip(0.6 * np.hypot(*box) * canvas.scale, 15.0, 110.0))  # pixels of the ring
    ringed, gap = near or focus.ringed(t), _gap(shown, forecasts)
    draw_lanes(canvas, focus.replay.scene.lanes)
    _draw_dim(sketch, shown)
    _draw_paths(sketch, focus, shown, forecasts, near)
    _draw_boxes(sketch, focus, shown, near)
    _draw_signs(sketch, focus, shown)
    if gap is not None:
        canvas.stroke(canvas.pixels(gap), BLACK, 1.2, dashed=True)
    if focus.replay.card.has_ego:
        canvas.boxes(ego_boxes(focus.replay.scene.ego[t][None]), VEHICLE)
    if ringed:
        canvas.ring(canvas.pixels(place), radius)
        sketch.note(place[None], Mark("the event" if focus.at.kind in KINDS else "the object looked at"))
    image = canvas.finished()
    ink = ImageDraw.Draw(image)
    scale_bar(canvas, ink)
    _keep_clear(canvas, shown, forecasts, place, radius + 3.0 if ringed else 0.8 * radius)
    names = list(_names_of_boxes(focus, shown, gap, canvas.scale, near))
    names += [] if near else _other_names(focus, shown, forecasts, radius)
    for name in names:  # the most important first, the last ones if there is room
        if name.far and not near and not canvas.inside(name.place):
            pointer(canvas, ink, place, name.place, name.text, name.color)
        else:
            callout(canvas, ink, name.place, name.text, name.color, name.reach, MIDDLE if near else BIG)
    return image, sketch.key


def _gap(shown: FocusFrame, forecasts: Forecasts) -> Floats | None:
    """From the end of the newest forecast to the object's place then [2, 2]; None if near or unknown."""
    future = shown.future
    newest = [forecast for role, forecast in forecasts if role == "now"]
    if not newest or len(future) < 2:
        return None
    ends = np.stack([newest[-1].nearest_path[: len(future)][-1], future[-1]])
    return ends if np.hypot(*(ends[1] - ends[0])) > GAP else None


def _draw_dim(sketch: KeyedCanvas, shown: FocusFrame) -> None:
    """Draw what does not belong to the event."""
    sketch.canvas.boxes(shown.dim_detection, DIM_DETECTION)
    sketch.canvas.boxes(shown.dim_track, DIM_TRACK)
    sketch.boxes(shown.dim_truth, REST)


def _draw_paths(sketch: KeyedCanvas, focus: Focus, shown: FocusFrame, forecasts: Forecasts, near: bool) -> None:
    """Draw the forecasts, the trails of tracks, and the way of the object."""
    canvas = sketch.canvas
    for role, forecast in forecasts:
        # the sample nearest to the truth bold, the others thin; an old one alone, dashed
        newest = role == "now"
        for path in forecast.path if newest else ():
            canvas.lines([np.concatenate([forecast.start[None], path])], ROLES[role], 1.0, 70)
        mark = Mark(_made(focus, forecast, shown), line=ROLES[role], width=3.0 if newest else 2.0, dashed=not newest)
        sketch.path(forecast.nearest_path, mark, 5.0 if newest else 3.5)
    for track in shown.tracks:
        canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
    canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
    if not near and len(shown.future) > 1:
        sketch.path(shown.future, WAY, 6.0)


def _made(focus: Focus, forecast: ObjectForecast, shown: FocusFrame) -> str:
    """A forecast, with the time at which it was made."""
    return "forecast now" if forecast.frame == shown.frame else f"forecast at {focus.seconds(forecast.frame):.1f} s"


def _draw_boxes(sketch: KeyedCanvas, focus: Focus, shown: FocusFrame, near: bool) -> None:
    """Draw the boxes that belong to the event."""
    sketch.boxes(shown.others, OTHER_OBJECT)
    for track in () if near else shown.absent:
        outline = Outline(ROLES[track.role], 1.2, dashed=True)
        sketch.boxes(track.box[None], Mark(f"track {track.track_id} at another time", outline))
    for track in shown.tracks[::-1]:
        outline = Outline(ROLES[track.role], 1.5, fill=90, dashed=track.role == "before")
        holds = "of the false forecast" if focus.at.object_id < 0 else HOLDS[track.role]
        sketch.boxes(track.box[None], Mark(f"track {track.track_id}, {holds}", outline))
    sketch.boxes(shown.object_box, replace(OBJECT, text=OBJECT.text.format(focus.named)))
    sketch.boxes(shown.detection_box, DETECTED)
    for xy in sketch.canvas.pixels(shown.detection_box[:, :2]):
        sketch.canvas.dot(xy, 2.0, BLACK)


def _draw_signs(sketch: KeyedCanvas, focus: Focus, shown: FocusFrame) -> None:
    """Draw the gate, the places where tracks were expected, and lines to the detections that they took."""
    canvas, rule = sketch.canvas, gate(focus)
    for track in shown.tracks:
        for xy in track.detection:
            if np.hypot(*(xy - track.box[:2])) > GAP / 2:
                sketch.path(np.stack([track.box[:2], xy]), TAKEN, 2.0)
        if track.expected is not None:
            canvas.cross(canvas.pixels(track.expected), 6.0, ROLES[track.role])
            sketch.note(track.expected[None], EXPECTED)
    if len(shown.object_box) and not rule.iou:
        center = shown.object_box[0, :2]
        canvas.circle(canvas.pixels(center), rule.threshold * canvas.scale, GRAY)
        sketch.note(center[None], replace(GATE, text=GATE.text.format(rule.text)))


def _keep_clear(canvas: Canvas, shown: FocusFrame, forecasts: Forecasts, place: Floats, radius: float) -> None:
    """Keep names off the object, its tracks and its paths."""
    center = canvas.pixels(place)
    parts = [np.stack([center - radius, center + radius])]
    parts += [canvas.pixels(bev_corners(box)) for box in [*shown.event_box, *shown.others, *shown.detection_box]]
    parts += [canvas.pixels(bev_corners(track.box)) for track in shown.absent]
    for path in [shown.future, *(forecast.nearest_path for _, forecast in forecasts)]:
        steps = np.linspace(path[:-1], path[1:], 4).reshape(-1, 2)
        parts += [np.stack([xy - 4.0, xy + 4.0]) for xy in canvas.pixels(steps)]
    for part in parts:
        (left, top), (right, bottom) = part.min(axis=0).tolist(), part.max(axis=0).tolist()
        canvas.taken.append((left, top, right, bottom))


def _names_of_boxes(focus: Focus, shown: FocusFrame, gap: Floats | None, scale: float, near: bool) -> Iterator[Name]:
    if gap is not None:
        yield Name(gap.mean(axis=0), f"{np.hypot(*(gap[1] - gap[0])):.1f} m off", BLACK, 2.0)
    for track in (*shown.tracks, *(() if near else shown.absent)):
        when = "" if track.frame == shown.frame else f" at {focus.seconds(track.frame):.1f} s"
        reach = 0.5 * float(track.box[5]) * scale
        yield Name(track.box[:2], f"track {track.track_id}{when}", ROLES[track.role], reach, True)
    for box, name in zip(shown.others, shown.other_names, strict=True):
        yield Name(box[:2], name, ROLES["truth"], 0.5 * float(box[5]) * scale, True)
    place = focus.place(shown.frame)
    for box, text in zip(shown.detection_box, shown.detection_text, strict=True):
        far = float(np.hypot(*(box[:2] - place)))
        short = text + (f", {far:.1f} m off" if far > GAP and len(shown.object_box) else "")
        yield Name(box[:2], short if near else f"detection: {short}", BLACK, 3.0, True)


def _other_names(focus: Focus, shown: FocusFrame, forecasts: Forecasts, radius: float) -> Iterator[Name]:
    """The object, what it lacks from the event on, and the ends of its future and of the forecasts."""
    t, future, place = shown.frame, shown.future, focus.place(shown.frame)
    if focus.at.object_id < 0 and not len(shown.others):
        yield Name(place, f"no true object within {focus.near:g} m", ROLES["truth"], radius)
    if len(shown.object_box):
        missing = [f"no track {gate(focus).text}"] if focus.follower(t) < 0 else []
        missing += [f"no detection within {focus.near:g} m"] if not len(focus.detections(t)) else []
        missing += ["no forecast"] if all(role != "now" for role, _ in forecasts) else []
        for text in missing if t >= focus.at.frame else ():
            yield Name(place, text, ROLES["now"], radius)
        yield Name(place, focus.named, ROLES["truth"], radius)
    if len(future) > 1:
        later = focus.seconds(t + len(future) - 1) - focus.seconds(t)
        yield Name(future[-1], f"true, {later:.1f} s later", ROLES["truth"], 7.0)
    if focus.replay.card.has_ego:
        yield Name(focus.replay.scene.ego[t, :2], f"ego, {distance(focus, t):.0f} m", BLACK, 8.0, True)
    for role, forecast in reversed(forecasts):
        yield Name(forecast.nearest_path[-1], _made(focus, forecast, shown), ROLES[role])
