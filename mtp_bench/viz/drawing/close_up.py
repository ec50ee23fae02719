"""Picture of an event alone, seen from above.

The object, its tracks and its forecasts are bright, all else is dim.
"""

from dataclasses import dataclass, field

import numpy as np
from PIL import Image

from ...core import Floats, bev_corners
from ..evidence import gate
from ..focus import Focus, ObjectForecast
from ..framing import FocusFrame, ShownTrack, Window, frame_of
from ..incident import INCIDENT_KINDS
from ..palette import BLACK, DIM, ROLES
from .birds_eye import VEHICLE, draw_lanes, draw_plan
from .canvas import GRAY, Canvas, Outline
from .column import Mark

OBJECT = Outline(ROLES["truth"], 2.5, heading=True)
WAY = Mark("where it really goes", line=ROLES["truth"], width=4.0)
OTHER_OBJECT = Mark(
    "another true object", Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
)
DETECTED = Mark(
    "detection, with its score", Outline(ROLES["detection"], 1.0, dashed=True)
)
TO_DETECTION = Mark("to the detection that a track took", line=BLACK)
EXPECTED = Mark("expected at constant velocity", sign="cross")
DIM_DETECTION = Mark("other detections", Outline((215, 215, 215), 0.8, dashed=True))
DIM_TRACK = Mark("other tracks", Outline(DIM, 0.8))
DIM_TRUTH = Mark("other true objects", Outline(DIM, 0.8, fill=50))
SHORT_GAP_M = 1.0  # shorter gaps need no distance, and half as long ones no line
Named = tuple[Floats, str, str, float]  # place [2], text, role, reach in pixels


def draw_focus(
    focus: Focus, t: int, size_px: tuple[int, int], window: Window
) -> tuple[Image.Image, list[Mark]]:
    """Draw frame ``t`` of an event in ``size_px`` pixels.

    Returns the picture and its key.
    """
    close_up = _CloseUp(focus, frame_of(focus, t), Canvas(*size_px, window))
    close_up.draw_scene()
    close_up.draw_paths()
    close_up.draw_boxes()
    close_up.draw_evidence()
    close_up.write_names()
    return close_up.canvas.finished(), close_up.marks


@dataclass(frozen=True, eq=False)
class _CloseUp:
    """A picture of one frame of an event."""

    focus: Focus
    shown: FocusFrame
    canvas: Canvas
    marks: list[Mark] = field(default_factory=list)  # in the picture, the last first

    @property
    def place(self) -> Floats:
        """Place [2] of the object, m."""
        return self.focus.place(self.shown.frame)

    @property
    def radius_px(self) -> float:
        """Radius of the ring around the object."""
        diagonal_m = 1.4  # of a false forecast, where no true box is
        if len(self.shown.object_box):
            diagonal_m = np.hypot(*self.shown.object_box[0, 4:6])
        return float(np.clip(0.6 * diagonal_m * self.canvas.scale, 15.0, 110.0))

    @property
    def forecasts(self) -> list[tuple[str, ObjectForecast]]:
        """The forecasts in this frame, each with its role."""
        return self.focus.forecasts(self.shown.frame)

    # ---- boxes and lines

    def draw_scene(self) -> None:
        """Draw what does not belong to the event."""
        draw_lanes(self.canvas, self.focus.replay)
        self._boxes(self.shown.dim_detection, DIM_DETECTION)
        self._boxes(self.shown.dim_track, DIM_TRACK)
        self._boxes(self.shown.dim_truth, DIM_TRUTH)
        if self.focus.replay.card.has_ego:
            ego_box = self.focus.replay.ego_boxes[self.shown.frame]
            self.canvas.boxes(ego_box[None], VEHICLE)
            plan_marks = draw_plan(self.canvas, self.focus.replay, self.shown.frame)
            for mark, places in plan_marks:
                self._note(mark, places)

    def draw_paths(self) -> None:
        """Draw trails, the way of the object, and forecasts.

        The sample nearest to the truth is bold; old forecasts are dashed.
        """
        shown = self.shown
        for role, forecast in self.forecasts:
            is_new = role == "now"
            width = 2.0
            color = ROLES[self._role(role, forecast)]
            if is_new:
                width = 3.0
                starts = np.broadcast_to(forecast.start, (len(forecast.samples), 1, 2))
                paths = np.concatenate([starts, forecast.samples], axis=1)
                self.canvas.lines(paths, color, 1.0, 70)
            text = self._forecast_name(forecast)
            mark = Mark(text, line=color, width=width, dashed=not is_new)
            self._path(forecast.nearest_path, mark)
        for track in shown.tracks:
            self.canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
        self.canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
        if len(shown.future) > 1:
            self._path(shown.future, WAY)

    def draw_boxes(self) -> None:
        """Draw the boxes that belong to the event."""
        self._boxes(self.shown.other_boxes, OTHER_OBJECT)
        for track in self.shown.tracks[::-1]:
            is_old = track.role == "before"
            outline = Outline(ROLES[track.role], 1.5, fill=90, dashed=is_old)
            text = f"track {track.track_id}{self._followed(track)}"
            self._boxes(track.box[None], Mark(text, outline))
        self._boxes(self.shown.detection_box, DETECTED)
        for pixel in self.canvas.pixels(self.shown.detection_box[:, :2]):
            self.canvas.dot(pixel, 2.0, BLACK)
        name = f"{self.focus.named}, true box"
        self._boxes(self.shown.object_box, Mark(name, OBJECT))

    def draw_evidence(self) -> None:
        """Draw expected places, taken detections, the gate, the ring."""
        canvas = self.canvas
        detections = self.focus.replay.scene.detections
        for track in self.shown.tracks:
            if track.detection >= 0:
                places = np.stack([track.box[:2], detections.box[track.detection, :2]])
                if np.hypot(*(places[1] - places[0])) > SHORT_GAP_M / 2:
                    self._path(places, TO_DETECTION)
            if track.expected is not None:
                color = ROLES[track.role]
                line = np.stack([track.box[:2], track.expected])
                canvas.lines([line], color, 1.0, 150)
                canvas.cross(canvas.pixels(track.expected), 6.0, color)
                self._note(EXPECTED, track.expected)
        rule = gate(self.focus)
        pixel = canvas.pixels(self.place)
        if len(self.shown.object_box):
            sign = ""
            if not rule.by_iou:  # only a distance can be drawn
                sign = "circle"
                canvas.circle(pixel, rule.threshold * canvas.scale, GRAY)
            text = f"event gate: {rule.text}"
            self._note(Mark(text, line=GRAY, sign=sign), self.place)
        if self._shows_event:
            canvas.ring(pixel, self.radius_px)
            is_event = self.focus.at.kind in INCIDENT_KINDS
            text = "the event" if is_event else "the object looked at"
            self._note(Mark(text, sign="ring"), self.place)

    @property
    def _shows_event(self) -> bool:
        """True from the frame before the event on, until a false forecast ends."""
        at = self.focus.at
        if self.shown.frame < at.frame - 1:
            return False
        return at.kind != "spurious" or self.shown.frame <= at.until

    def _note(self, mark: Mark, places: Floats) -> None:
        """Remember a mark at ``places`` [..., 2], m, if in sight."""
        if mark not in self.marks and self.canvas.inside(places).any():
            self.marks.insert(0, mark)

    def _boxes(self, box: Floats, mark: Mark) -> None:
        """Draw boxes [n, 7] in the style of ``mark``."""
        if mark.box is not None:
            self.canvas.boxes(box, mark.box)
        self._note(mark, box[:, :2])

    def _path(self, path: Floats, mark: Mark) -> None:
        """Draw a path [n, 2], m, with a dot at its end."""
        pixels = self.canvas.pixels(path)
        color = mark.line or BLACK
        self.canvas.stroke(pixels, color, mark.width, dashed=mark.dashed)
        self.canvas.dot(pixels[-1], 1.5 + mark.width, color)
        self._note(mark, path)

    def _role(self, role: str, forecast: ObjectForecast) -> str:
        """Return the role of a forecast's track, else its own."""
        for track in self.shown.tracks:
            if role == "now" and track.track_id == forecast.track_id:
                return track.role
        return role

    def _forecast_name(self, forecast: ObjectForecast) -> str:
        """Name a forecast by its time, and by its track if that is unexpected."""
        focus = self.focus
        follower = focus.at.new_id
        if focus.at.object_id >= 0:
            follower = focus.follower(forecast.frame)
        text = "forecast"
        if forecast.track_id < 0:
            text += " without a track"
        elif forecast.track_id != follower:
            text += f" of track {forecast.track_id}"
        if forecast.frame == self.shown.frame:
            return f"{text} now"
        return f"{text} at {focus.seconds(forecast.frame):.1f} s"

    def _followed(self, track: ShownTrack) -> str:
        """Return the object that a track follows in words, or an empty text."""
        focus = self.focus
        other_row = focus.other_object(track.track_id, self.shown.frame)
        if other_row >= 0:
            return f", which follows {focus.name_of(other_row)}"
        is_follower = track.track_id == focus.follower(self.shown.frame)
        return ", which follows it" if is_follower else ""

    # ---- texts

    def write_names(self) -> None:
        """Write names, the most important first, while there is room."""
        self.canvas.scale_bar()
        self._keep_clear()
        for place, text, role, reach_px in self._names():
            self.canvas.callout(place, text, ROLES[role], reach_px)

    def _keep_clear(self) -> None:
        """Keep names off the object, its tracks and its paths."""
        shown = self.shown
        canvas = self.canvas
        center = canvas.pixels(self.place)
        reach_px = self.radius_px + 3.0
        shapes = [np.stack([center - reach_px, center + reach_px])]
        boxes = [track.box for track in shown.tracks]
        boxes += [*shown.other_boxes, *shown.detection_box]
        for box in boxes:
            shapes.append(canvas.pixels(bev_corners(box)))
        paths = [forecast.nearest_path for _, forecast in self.forecasts]
        for path in (shown.future, *paths):
            steps = np.linspace(path[:-1], path[1:], 4).reshape(-1, 2)
            pixels = canvas.pixels(steps)
            shapes += [np.stack([pixel - 4.0, pixel + 4.0]) for pixel in pixels]
        for shape in shapes:
            left_px, top = shape.min(axis=0).tolist()
            right, bottom = shape.max(axis=0).tolist()
            canvas.text_places.append((left_px, top, right, bottom))

    def _names(self) -> list[Named]:
        """List the names of boxes and of ends of paths."""
        shown = self.shown
        focus = self.focus
        names: list[Named] = []
        for track in shown.tracks:
            names.append(self._name(track.box, f"track {track.track_id}", track.role))
        for box, text in zip(shown.other_boxes, shown.other_names, strict=True):
            names.append(self._name(box, text, "truth"))
        for box, score in zip(shown.detection_box, shown.detection_text, strict=True):
            distance_m = float(np.hypot(*(box[:2] - self.place)))
            is_off = distance_m > SHORT_GAP_M and len(shown.object_box) > 0
            text = f"{score}, {distance_m:.1f} m off" if is_off else score
            names.append((box[:2], text, "detection", 3.0))
        if len(shown.object_box):
            names.append((self.place, focus.named, "truth", self.radius_px))
        return names + self._path_names()

    def _path_names(self) -> list[Named]:
        """List the names of ends of future and forecasts."""
        names: list[Named] = []
        future = self.shown.future
        if len(future) > 1:
            time_s = (len(future) - 1) / self.focus.replay.card.task.rate
            text = f"true, {time_s:.1f} s later"
            names.append((future[-1], text, "truth", 7.0))
        for role, forecast in self.forecasts[::-1]:
            path = forecast.nearest_path
            text = self._forecast_name(forecast)
            if role == "now" and len(future) > 1:
                offset_m = path[: len(future)][-1] - future[-1]
                text += f", {np.hypot(*offset_m):.1f} m off"
            names.append((path[-1], text, self._role(role, forecast), 6.0))
        return names

    def _name(self, box: Floats, text: str, role: str) -> Named:
        """Return a name for the place of a box, off half its width."""
        return box[:2], text, role, 0.5 * float(box[5]) * self.canvas.scale
