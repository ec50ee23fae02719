"""An event alone in a recording: its things, bright; small pictures, sentence and key beside them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...types import Floats, Ints, starts_of
from ..drawing.report import small_pictures
from ..evidence import distance, gate
from ..focus import Focus
from ..framing import FocusFrame, frame_of, length_of, turn_of, window_of
from .colors import ROLES, SWITCH, Colors, packed
from .entities import EDGE as RING
from .entities import EVENT, TRACK_FILL, Log
from .names import drawable
from .sdk import rr
from .texts import event_text

SIDES = {"truth": np.pi / 2, "now": -np.pi / 2, "before": np.pi, "named": 0.0}  # rad from the way to the name
BOLD, THIN, EDGE = -2.5, -0.6, -1.2  # half the width of lines: negative numbers are points of the screen
LIFT = 0.3  # m, that lines lie above the ground of dim things
MOST_SCORES = 3  # detections whose score is shown: the nearest
CROSS = 0.3  # m, half of the sign for an expected place
CIRCLE = np.column_stack([np.cos(ANGLES := np.linspace(0.0, 2 * np.pi, 49)), np.sin(ANGLES)])  # [49, 2]
GAP = 0.5  # m, from a track to the detection that it took: a smaller one needs no line

Things = Sequence[tuple[str, Floats]]  # a role, and a box [7] or a path [n, 2]
Labelled = tuple[str, Floats, str]  # role, place [2] and text


def log_focus(recording: rr.RecordingStream, focuses: Sequence[Focus], number: int, root: str, window: range) -> None:
    """Log the bright things of the frames in the ``window``, and the text and the pictures beside them.

    ``number``: of the focus among those of all runs; ``root``: prefix of its paths.
    """
    focus = focuses[number]
    scene, end = focus.replay.scene, window.stop
    log = Log(recording, scene, window, root, ("time", EVENT), window.start)
    shown = [frame_of(focus, t) for t in window]
    height = focus.at.position[2] + LIFT

    def boxes(path: str, things: Callable[[FocusFrame], Things], radius: float, **style: Any) -> None:
        rows = [things(frame) for frame in shown]
        box = np.array([box for row in rows for _, box in row]).reshape(-1, 7)
        log.boxes(f"world/focus/{path}", _starts(rows), box, _colors(rows), radius=radius, **style)

    def strips(path: str, things: Callable[[FocusFrame], Things], radius: float) -> None:
        rows = [things(frame) for frame in shown]
        paths = [path for row in rows for _, path in row]
        point = np.full((len(paths), max(map(len, paths), default=2), 3), height)
        for i, each in enumerate(paths):  # a shorter path repeats its last point
            point[i, :, :2] = np.pad(each, ((0, point.shape[1] - len(each)), (0, 0)), mode="edge")
        log.strips(f"world/focus/{path}", _starts(rows), point, _colors(rows), radius)

    boxes("truth", lambda frame: [("truth", box) for box in (*frame.object_box, *frame.others)], BOLD)
    boxes("detection", lambda frame: [("detection", box) for box in frame.detection_box], THIN)
    boxes("track", lambda frame: [(track.role, track.box) for track in frame.tracks], EDGE, fill=TRACK_FILL)
    strips("way", lambda frame: [("truth", frame.future)] if len(frame.future) > 1 else [], BOLD)
    strips("samples", lambda frame: _samples(focus, frame), THIN)
    strips("forecast", lambda frame: _nearest(focus, frame), BOLD)
    strips("signs", lambda frame: _signs(focus, frame), EDGE)
    beside = window_of(focus, focus.at.frame, focuses)
    _log_names(log, [_names(focus, frame, max(beside.high, beside.wide / 2)) for frame in shown], height)
    texts = [drawable(event_text(focus, frame, large=len(focuses) == 1)) for frame in shown]
    log.columns("focus/text", None, rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts)))
    if end < scene.frames:
        recording.set_time("frame", sequence=end)
        recording.set_time("time", duration=float(scene.time[end] - scene.time[0]))
        recording.log(f"{root}world/focus", rr.Clear(recursive=True))
        recording.reset_time()
    pictures = rr.Image(np.asarray(small_pictures(focus, focuses)))
    recording.log(f"{root}focus/pictures", pictures, static=True)


def log_ring(recording: rr.RecordingStream, focus: Focus) -> None:
    """A ring around the place of the event, in all frames."""
    x, y, z = focus.at.position
    circle = np.array([x, y]) + (0.4 + 0.65 * length_of(focus)) * CIRCLE
    ring = np.column_stack([circle, np.full(len(circle), z)])
    recording.log("world/at", rr.LineStrips3D([ring], radii=RING, colors=SWITCH), static=True)


def _nearest(focus: Focus, frame: FocusFrame) -> Things:
    return [(role, forecast.nearest_path) for role, forecast in focus.forecasts(frame.frame)]


def _samples(focus: Focus, frame: FocusFrame) -> Things:
    """All samples of the newest forecast, and the trails of the tracks."""
    trails = [(track.role, track.trail) for track in frame.tracks if len(track.trail) > 1]
    newest = focus.forecasts(frame.frame)[-1:]
    return trails + [(role, np.vstack([forecast.start, path])) for role, forecast in newest for path in forecast.path]


def _signs(focus: Focus, frame: FocusFrame) -> Things:
    """The event gate, crosses at expected places, lines to detections that tracks took, and the line to the ego."""
    signs: list[tuple[str, Floats]] = []
    rule, place = gate(focus), focus.place(frame.frame)
    if len(frame.object_box) and not rule.iou:
        signs.append(("detection", place + rule.threshold * CIRCLE))
    for track in frame.tracks:
        if track.expected is not None:
            signs += [(track.role, track.expected + CROSS * np.array([[-1, -side], [1, side]])) for side in (1, -1)]
        if track.detection >= 0:
            line = np.stack([track.box[:2], focus.replay.scene.detections.box[track.detection, :2]])
            signs += [("detection", line)] if np.hypot(*(line[1] - line[0])) > GAP else []
    if distance(focus, frame.frame) is not None:
        signs.append(("ego", np.stack([place, focus.replay.scene.ego[frame.frame, :2]])))
    return signs


def _starts(rows: Sequence[Sequence[Any]]) -> Ints:
    return starts_of([len(row) for row in rows])


def _colors(rows: Sequence[Sequence[tuple[Any, ...]]]) -> Colors:
    return np.array([ROLES[thing[0]] for row in rows for thing in row], dtype=np.uint8).reshape(-1, 3)


def _log_names(log: Log, rows: Sequence[Sequence[Labelled]], height: float) -> None:
    names = [name for row in rows for name in row]
    place = np.array([place for _, place, _ in names]).reshape(-1, 2)
    columns = rr.Points3D.columns(
        positions=np.column_stack([place, np.full(len(names), height)]),
        colors=packed(_colors(rows)),
        labels=[drawable(name) for _, _, name in names],
    )
    style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5), show_labels=True)
    log.columns("world/focus/name", style, columns.partition([len(row) for row in rows]))


def _names(focus: Focus, frame: FocusFrame, half: float) -> list[Labelled]:
    """Names beside the boxes, each on a side of its own, and at the ends of paths, so that none hides another.

    ``half``: of what is shown, m.
    """
    t, place, turn = frame.frame, focus.place(frame.frame), turn_of(focus)
    away = 0.5 * length_of(focus) + 0.1 * half
    sides: dict[str, list[str]] = {"truth": [focus.named]} if len(frame.object_box) else {}
    for track in frame.tracks:
        sides.setdefault(track.role, []).append(f"track {track.track_id}")
    angle = {role: turn + SIDES[role] for role in sides}
    names: list[Labelled] = [
        (role, place + away * np.array([np.cos(angle[role]), np.sin(angle[role])]), ", ".join(texts))
        for role, texts in sides.items()
    ]
    ends = [(role, path[-1], f"forecast {role}") for role, path in _nearest(focus, frame)[::-1]]
    ends[1:1] = [("truth", frame.future[-1], "true place then")] if len(frame.future) > 1 else []
    ends += _scores(focus, frame)
    ends += [(track.role, track.expected, "expected") for track in frame.tracks if track.expected is not None]
    far = distance(focus, t)
    if far is not None:
        share = min(1.0, 0.8 * half / max(far, 1e-9))
        ends.append(("ego", place + share * (focus.replay.scene.ego[t, :2] - place), f"ego {far:.0f} m away"))
    for role, end, name in ends:
        if all(np.hypot(*(end - taken)) > 0.9 * away for taken in [taken for _, taken, _ in names]):
            names.append((role, end, name))
    return names


def _scores(focus: Focus, frame: FocusFrame) -> list[Labelled]:
    """Scores of the nearest detections."""
    far = np.hypot(*(frame.detection_box[:, :2] - focus.place(frame.frame)).T)
    nearest = np.argsort(far, kind="stable")[:MOST_SCORES]
    return [("detection", frame.detection_box[i, :2], frame.detection_text[i]) for i in nearest.tolist()]
