"""Picture of an event alone: the object, its tracks and forecasts bright, all else dim, seen from above."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from PIL import Image, ImageDraw

from ...core import Floats, bev_corners
from ..evidence import distance, gate, near_detections
from ..focus import Focus, ObjectForecast
from ..framing import ROLES, FocusFrame, Follower, Window, frame_of
from ..incident import INCIDENT_KINDS
from ..palette import BLACK, DIM
from ..run_replay import ego_boxes
from .birds_eye import VEHICLE, draw_lanes, draw_plan
from .canvas import GRAY, MIDDLE, Canvas, Outline, callout, pointer, scale_bar
from .column import Mark

OBJECT = Mark("{}, true box", Outline(ROLES["truth"], 2.5, heading=True))
WAY = Mark("where it really goes", line=ROLES["truth"], width=4.0)
OTHER_OBJECT = Mark(
    "another true object", Outline(ROLES["truth"], 1.2, heading=True, dashed=True)
)
DETECTED = Mark(
    "detection, with its score", Outline(ROLES["detection"], 1.0, dashed=True)
)
TAKEN = Mark("to the detection that a track took", line=BLACK)
EXPECTED = Mark("expected, by its own last forecast", sign="cross")
GATE = Mark("event gate: {}", line=GRAY, sign="circle")
REST = {  # field of `FocusFrame` -> its mark
    "dim_detection": Mark(
        "other detections", Outline((215, 215, 215), 0.8, dashed=True)
    ),
    "dim_track": Mark("other tracks", Outline(DIM, 0.8)),
    "dim_truth": Mark("other true objects", Outline(DIM, 0.8, fill=50)),
}
GAP = 1.0  # m, between the ends of forecast and future: smaller gaps need no line
BIG = 15  # pixels of letters


def draw_focus(
    focus: Focus, t: int, size: tuple[int, int], window: Window, near: bool = False
) -> tuple[Image.Image, list[Mark]]:
    """Frame ``t`` of an event in ``size`` pixels, and its key; ``near``: a small picture, without forecasts."""
    canvas, shown = Canvas.blank(*size, window), frame_of(focus, t)
    shown = replace(shown, named=shown.tracks) if near else shown
    box = shown.object_box[0, 4:6] if len(shown.object_box) else np.ones(2)
    radius = float(np.clip(0.6 * np.hypot(box[0], box[1]) * canvas.scale, 15.0, 110.0))
    close_up = CloseUp(
        focus,
        shown,
        canvas,
        near,
        [] if near else focus.forecasts(t),
        focus.place(t),
        radius,
    )
    close_up.draw()
    image = canvas.finished()
    close_up.write(image)
    return image, sorted(close_up.marks, key=lambda mark: mark.box != OBJECT.box)


@dataclass(frozen=True, eq=False)
class CloseUp:
    """A picture of one frame of an event."""

    focus: Focus
    shown: FocusFrame
    canvas: Canvas
    near: bool
    forecasts: list[tuple[str, ObjectForecast]]  # each with its role
    place: Floats  # [2] m, of the object
    radius: float  # pixels of the ring around it
    marks: list[Mark] = field(
        default_factory=list
    )  # those that lie in the picture, the last one first

    @cached_property
    def gap(self) -> Floats | None:
        """From the end of the newest forecast to the object's place then [2, 2]; None if near or unknown."""
        future = self.shown.future
        newest = (
            forecast.nearest_path
            for role, forecast in self.forecasts
            if role == "now" and len(future) > 1
        )
        ends = (np.stack([path[: len(future)][-1], future[-1]]) for path in newest)
        return next(
            (each for each in ends if np.hypot(*(each[1] - each[0])) > GAP), None
        )

    # ---- boxes and lines

    def draw(self) -> None:
        """Draw everything but texts, the dim things first."""
        canvas, shown, focus = self.canvas, self.shown, self.focus
        draw_lanes(canvas, focus.replay)
        for name, mark in REST.items():
            self._boxes(getattr(shown, name), mark)
        if focus.replay.card.has_ego:
            canvas.boxes(ego_boxes(focus.replay.scene.ego[shown.frame][None]), VEHICLE)
            for places, mark in draw_plan(canvas, focus.replay, shown.frame):
                self._note(places, mark)
        self._draw_paths()
        self._draw_boxes()
        self._draw_evidence()
        if self.gap is not None:
            canvas.stroke(canvas.pixels(self.gap), BLACK, 1.2, dashed=True)
        lasts = (
            shown.frame <= focus.at.until or focus.at.kind != "spurious"
        )  # only a false forecast has an end
        if self.near or (shown.frame >= focus.at.frame and lasts):
            canvas.ring(canvas.pixels(self.place), self.radius)
            self._note(
                self.place,
                Mark(
                    "the event"
                    if focus.at.kind in INCIDENT_KINDS
                    else "the object looked at"
                ),
            )

    def _note(self, xy: Floats, mark: Mark) -> None:
        """Remember a mark that is drawn at places [..., 2] m."""
        if mark not in self.marks and self.canvas.inside(xy).any():
            self.marks.insert(0, mark)

    def _boxes(self, box: Floats, mark: Mark) -> None:
        if mark.box is not None:
            self.canvas.boxes(box, mark.box)
        self._note(box[:, :2], mark)

    def _path(self, path: Floats, mark: Mark, dot: float) -> None:
        """Draw a path [n, 2] m in the style of a mark, with a ``dot`` of so many pixels at its end."""
        pixels, color = self.canvas.pixels(path), mark.line or BLACK
        self.canvas.stroke(pixels, color, mark.width, dashed=mark.dashed)
        self.canvas.dot(pixels[-1], dot, color)
        self._note(path, mark)

    def _draw_paths(self) -> None:
        """Draw trails, the way of the object, and forecasts: the sample nearest to the truth bold; old ones dashed."""
        canvas, shown = self.canvas, self.shown
        for role, forecast in self.forecasts:
            newest, color = role == "now", ROLES[self._role(role, forecast)]
            for path in forecast.path if newest else ():
                canvas.lines(
                    [np.concatenate([forecast.start[None], path])], color, 1.0, 70
                )
            mark = Mark(
                self._made(forecast),
                line=color,
                width=3.0 if newest else 2.0,
                dashed=not newest,
            )
            self._path(forecast.nearest_path, mark, 5.0 if newest else 3.5)
        for track in shown.tracks:
            canvas.lines([track.trail], ROLES[track.role], 2.0, 130)
        canvas.lines([shown.past], ROLES["truth"], 1.5, 150)
        if not self.near and len(shown.future) > 1:
            self._path(shown.future, WAY, 6.0)

    def _role(self, role: str, forecast: ObjectForecast) -> str:
        """Role of a forecast, or of its track where that is not of the event or does not follow the object then."""
        track, roles = (
            forecast.track_id,
            {self.focus.at.old_id: "before", self.focus.at.new_id: "now"},
        )
        own = track < 0 or (
            track in roles and track == self.focus.follower(forecast.frame)
        )
        return role if own else roles.get(track, "named")

    def _made(self, forecast: ObjectForecast) -> str:
        """A forecast, with the time at which it was made, and with its track where that does not follow the object."""
        focus, t, track = self.focus, forecast.frame, forecast.track_id
        own = track == (
            focus.follower(t) if focus.at.object_id >= 0 else focus.at.new_id
        )
        of = " without a track" if track < 0 else "" if own else f" of track {track}"
        return f"forecast{of} {'now' if t == self.shown.frame else f'at {focus.seconds(t):.1f} s'}"

    def _draw_boxes(self) -> None:
        """Draw the boxes that belong to the event; a track at another time is hollow."""
        shown = self.shown
        self._boxes(shown.others, OTHER_OBJECT)
        for track in shown.named[::-1]:
            now = track.frame == shown.frame
            outline = Outline(
                ROLES[track.role],
                1.5,
                90 if now else 0,
                dashed=track.role == "before" or not now,
            )
            self._boxes(
                track.box[None],
                Mark(f"track {track.track_id}{self._holds(track)}", outline),
            )
        self._boxes(
            shown.object_box, replace(OBJECT, text=OBJECT.text.format(self.focus.named))
        )
        self._boxes(shown.detection_box, DETECTED)
        for xy in self.canvas.pixels(shown.detection_box[:, :2]):
            self.canvas.dot(xy, 2.0, BLACK)

    def _holds(self, track: Follower) -> str:
        """The object that a track follows, or when it had this one, in words."""
        focus, t, rows = (
            self.focus,
            self.shown.frame,
            self.focus.track_rows(track.track_id),
        )
        if track.frame != t:
            return ", not output now"
        if (row := int(focus.truth_of_track[rows[t]])) >= 0:
            return f", which follows {'it' if row == focus.rows[t] else focus.name_of(row)}"
        had = np.flatnonzero(
            (focus.truth_of_track[rows] == focus.rows) & (focus.rows >= 0)
        )
        return (
            ", which had it before"
            if (had < t).any()
            else ", which has it later"
            if len(had)
            else ""
        )

    def _draw_evidence(self) -> None:
        """Draw the gate, the places where tracks were expected, and lines to the detections that they took."""
        canvas, rule, detected = (
            self.canvas,
            gate(self.focus),
            self.focus.replay.scene.detections.box,
        )
        for track in self.shown.tracks:
            place = (
                detected[track.detection, :2] if track.detection >= 0 else track.box[:2]
            )
            if np.hypot(*(place - track.box[:2])) > GAP / 2:
                self._path(np.stack([track.box[:2], place]), TAKEN, 2.0)
            if track.expected is not None:
                canvas.lines(
                    [np.stack([track.box[:2], track.expected])],
                    ROLES[track.role],
                    1.0,
                    150,
                )
                canvas.cross(canvas.pixels(track.expected), 6.0, ROLES[track.role])
                self._note(track.expected, EXPECTED)
        for center in self.shown.object_box[:, :2]:
            if not rule.iou:
                canvas.circle(
                    canvas.pixels(center), rule.threshold * canvas.scale, GRAY
                )
            self._note(
                center,
                replace(
                    GATE,
                    text=GATE.text.format(rule.text),
                    sign="none" if rule.iou else "circle",
                ),
            )

    # ---- texts

    def write(self, image: Image.Image) -> None:
        """Write names onto the finished picture, the most important first, the last ones if there is room."""
        ink = ImageDraw.Draw(image)
        scale_bar(self.canvas, ink)
        self._keep_clear()
        self._name_boxes(ink)
        if not self.near:
            if len(self.shown.object_box):
                self._name(ink, self.place, self.focus.named, "truth", self.radius)
            self._name_lacks(ink)
            self._name_rest(ink)

    def _name(
        self,
        ink: ImageDraw.ImageDraw,
        place: Floats,
        text: str,
        role: str,
        reach: float = 6.0,
        far: bool = False,
    ) -> None:
        """Write a text ``reach`` pixels beside a place [2]; ``far``: outside the picture, an arrow points to it."""
        if far and not self.near and not self.canvas.inside(place):
            away = (
                ""
                if text.endswith((" m", " m off"))
                else f", {np.hypot(*(place - self.place)):.0f} m"
            )
            pointer(self.canvas, ink, self.place, place, text + away, ROLES[role])
        else:
            callout(
                self.canvas,
                ink,
                place,
                text,
                ROLES[role],
                reach,
                MIDDLE if self.near else BIG,
            )

    def _keep_clear(self) -> None:
        """Keep names off the object, its tracks and its paths."""
        shown, canvas = self.shown, self.canvas
        center, radius = canvas.pixels(self.place), self.radius + 3.0
        boxes = [
            *(track.box for track in shown.named),
            *shown.others,
            *shown.detection_box,
        ]
        parts = [
            np.stack([center - radius, center + radius]),
            *(canvas.pixels(bev_corners(box)) for box in boxes),
        ]
        for path in [
            shown.future,
            *(forecast.nearest_path for _, forecast in self.forecasts),
        ]:
            steps = np.linspace(path[:-1], path[1:], 4).reshape(-1, 2)
            parts += [np.stack([xy - 4.0, xy + 4.0]) for xy in canvas.pixels(steps)]
        canvas.taken.extend(
            (*part.min(axis=0).tolist(), *part.max(axis=0).tolist()) for part in parts
        )

    def _name_boxes(self, ink: ImageDraw.ImageDraw) -> None:
        shown, scale = self.shown, self.canvas.scale
        if self.gap is not None:
            text = f"{np.hypot(*(self.gap[1] - self.gap[0])):.1f} m off"
            self._name(ink, self.gap.mean(axis=0), text, "detection", 2.0)
        for track in shown.named:
            when = (
                ""
                if track.frame == shown.frame
                else f" at {self.focus.seconds(track.frame):.1f} s"
            )
            reach = 0.5 * float(track.box[5]) * scale
            self._name(
                ink,
                track.box[:2],
                f"track {track.track_id}{when}",
                track.role,
                reach,
                True,
            )
        for box, name in zip(shown.others, shown.other_names, strict=True):
            self._name(ink, box[:2], name, "truth", 0.5 * float(box[5]) * scale, True)
        for box, text in zip(shown.detection_box, shown.detection_text, strict=True):
            far = float(np.hypot(*(box[:2] - self.place)))
            short = text + (
                f", {far:.1f} m off" if far > GAP and len(shown.object_box) else ""
            )
            self._name(
                ink,
                box[:2],
                short if self.near else f"detection: {short}",
                "detection",
                3.0,
                True,
            )

    def _name_lacks(self, ink: ImageDraw.ImageDraw) -> None:
        """Say what is missing from the event on."""
        focus, t, rule, own = (
            self.focus,
            self.shown.frame,
            gate(self.focus),
            len(self.shown.object_box) > 0,
        )
        rival = focus.rival(t)
        other = (
            f"track {rival} follows {focus.name_of(focus.other(rival, t))}"
            if rival >= 0
            else ""
        )
        lacks = {
            f"no true object within {focus.near:g} m": focus.at.object_id < 0
            and not len(self.shown.others),
            other
            or f"no {focus.noun} track {'with ' if rule.iou else ''}{rule.text}": own
            and focus.follower(t) < 0,
            f"no detection within {focus.near:g} m": own
            and not len(near_detections(focus, t)),
            "no forecast": own and all(role != "now" for role, _ in self.forecasts),
        }
        for text in [
            text for text, true in lacks.items() if true and t >= focus.at.frame
        ]:
            self._name(ink, self.place, text, "now", self.radius)

    def _name_rest(self, ink: ImageDraw.ImageDraw) -> None:
        """Name the ends of the future and of the forecasts, and the ego."""
        focus, t, future = self.focus, self.shown.frame, self.shown.future
        if len(future) > 1:
            later = focus.seconds(t + len(future) - 1) - focus.seconds(t)
            self._name(ink, future[-1], f"true, {later:.1f} s later", "truth", 7.0)
        if focus.replay.card.has_ego:
            self._name(
                ink,
                focus.replay.scene.ego[t, :2],
                f"ego, {distance(focus, t):.0f} m",
                "detection",
                8.0,
                True,
            )
        for role, forecast in self.forecasts[::-1]:
            self._name(
                ink,
                forecast.nearest_path[-1],
                self._made(forecast),
                self._role(role, forecast),
            )
