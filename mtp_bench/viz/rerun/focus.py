"""An event alone in a recording: its things, bright; small pictures, sentence and key beside them."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...types import Floats, Ints, starts_of
from ..drawing.report import small_pictures
from ..focus import Focus
from ..framing import FocusFrame, frame_of, length_of, turn_of, window_of
from ..palette import NOW, PURPLE, SKY, TRUTH, Color
from ..sentence import sentence
from .colors import SWITCH, Colors, packed
from .entities import EDGE as RING
from .entities import TRACK_FILL, Log, frame_times
from .sdk import rr

SECONDS = 5.0  # before and after the event in which its things are bright
COLORS: dict[str, Color] = {"truth": TRUTH, "before": SKY, "now": NOW, "named": PURPLE, "detection": (190, 190, 190)}
SIDES = {
    "truth": np.pi / 2,
    "now": -np.pi / 2,
    "before": np.pi,
    "named": 0.0,
}  # rad from the way of the object to its name
BOLD, THIN, EDGE = -2.5, -0.6, -1.2  # half the width of lines: negative numbers are points of the screen
LIFT = 0.3  # m, that lines lie above the ground of dim things

Things = Sequence[tuple[str, Floats]]  # a role, and a box [7] or a path [n, 2]
Labelled = tuple[str, Floats, str]  # role, place [2] and text


TEXT = """{heading}

| mark | what |
|---|---|
| green box, green path | the object, and where it really goes |
| blue box, blue path | its track before the event, and its forecast |
| orange box, orange paths | its track now, and its forecast |
| light grey box | detections nearby |
| pink ring | the event |
| dark grey box | all other boxes |

Bold: the sample that is nearest to the truth, or the heaviest if that is unknown.
The viewer stays at frame {frame}. Drag the time cursor to leave it, and step with the arrow keys; the play button leads
back. To play the whole scene, switch the loop off and set the speed to 1.
"""


def log_focus(recording: rr.RecordingStream, focus: Focus, root: str, large: bool) -> None:
    """Log the bright things of the frames around the event, and the texts and pictures beside them.

    ``root``: prefix of the paths; ``large``: the sentence in large letters.
    """
    log = Log(recording, frame_times(focus.replay.scene, _frames(focus)), root)
    shown = [frame_of(focus, t) for t in _frames(focus)]
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
    _log_names(log, focus, [_names(focus, frame) for frame in shown], height)
    scene, end = focus.replay.scene, int(_frames(focus)[-1]) + 1
    if end < scene.frames:
        recording.set_time("frame", sequence=end)
        recording.set_time("time", duration=float(scene.time[end] - scene.time[0]))
        recording.log(f"{root}world/focus", rr.Clear(recursive=True))
        recording.reset_time()
    recording.log(f"{root}focus/pictures", rr.Image(np.asarray(small_pictures(focus))), static=True)
    text = TEXT.format(heading=f"{'###' if large else '####'} {sentence(focus)}.", frame=focus.at.frame)
    recording.log(f"{root}focus/text", rr.TextDocument(text, media_type="text/markdown"), static=True)


def log_ring(recording: rr.RecordingStream, focus: Focus) -> None:
    """A ring around the place of the event, in all frames."""
    angle, (x, y, z), radius = np.linspace(0.0, 2 * np.pi, 49), focus.at.position, 0.4 + 0.65 * length_of(focus)
    ring = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), np.full(len(angle), z)])
    recording.log("world/at", rr.LineStrips3D([ring], radii=RING, colors=SWITCH), static=True)


def _frames(focus: Focus) -> Ints:
    """The frames around the event."""
    time = focus.replay.scene.time
    return np.flatnonzero(np.abs(time - time[focus.at.frame]) <= SECONDS)


def _nearest(focus: Focus, frame: FocusFrame) -> Things:
    return [(role, forecast.nearest_path) for role, forecast in focus.forecasts(frame.frame)]


def _samples(focus: Focus, frame: FocusFrame) -> Things:
    """All samples of the newest forecast, and the trails of the tracks."""
    trails = [(track.role, track.trail) for track in frame.tracks if len(track.trail) > 1]
    newest = focus.forecasts(frame.frame)[-1:]
    return trails + [(role, np.vstack([forecast.start, path])) for role, forecast in newest for path in forecast.path]


def _starts(rows: Sequence[Sequence[Any]]) -> Ints:
    return starts_of([len(row) for row in rows])


def _colors(rows: Sequence[Sequence[tuple[Any, ...]]]) -> Colors:
    return np.array([COLORS[thing[0]] for row in rows for thing in row], dtype=np.uint8).reshape(-1, 3)


def _log_names(log: Log, focus: Focus, rows: Sequence[Sequence[Labelled]], height: float) -> None:
    names = [name for row in rows for name in row]
    place = np.array([place for _, place, _ in names]).reshape(-1, 2)
    columns = rr.Points3D.columns(
        positions=np.column_stack([place, np.full(len(names), height)]),
        colors=packed(_colors(rows)),
        labels=[name for _, _, name in names],
    )
    style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5), show_labels=True)
    log.columns("world/focus/name", style, columns.partition([len(row) for row in rows]))


def _names(focus: Focus, frame: FocusFrame) -> list[Labelled]:
    """Names beside the boxes, each on a side of its own, and at the ends of paths, so that none hides another."""
    window, place, turn = window_of(focus, focus.at.frame), focus.place(frame.frame), turn_of(focus)
    away = 0.5 * length_of(focus) + 0.1 * max(window.high, window.wide / 2)
    texts = [("truth", focus.named)] if len(frame.object_box) else []
    texts += [(track.role, f"track {track.track_id}") for track in frame.tracks]
    names: list[Labelled] = []
    for role, name in texts:
        angle = turn + SIDES[role]
        names.append((role, place + away * np.array([np.cos(angle), np.sin(angle)]), name))
    ends = [(role, path[-1], f"forecast {role}") for role, path in _nearest(focus, frame)[::-1]]
    ends[1:1] = [("truth", frame.future[-1], "true place then")] if len(frame.future) > 1 else []
    for role, end, name in ends:
        if all(np.hypot(*(end - taken)) > away for taken in [place, *(taken for _, taken, _ in names)]):
            names.append((role, end, name))
    return names
