"""An event alone in a recording: its things, bright; small pictures, sentence, key and camera images beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import numpy as np

from ...types import Floats, Ints, starts_of
from ..drawing.report import strip
from ..focus import Focus, FocusFrame
from ..palette import NOW, SKY, TRUTH, Color
from ..photo import Photo, photo_of
from .colors import SWITCH, Colors, packed
from .entities import TRACK_FILL, Log, frame_times
from .sdk import rr

ROOT = "world/focus"
SECONDS = 5.0  # before and after the event in which its things are bright
COLORS: dict[str, Color] = {"truth": TRUTH, "before": SKY, "now": NOW, "detection": (190, 190, 190), "event": SWITCH}
WORDS = {
    "truth": "green", "before": "blue", "now": "orange", "detection": "light grey", "event": "pink", "dim": "dark grey",
}  # fmt: skip
SIDES = {"truth": np.pi / 2, "now": -np.pi / 2, "before": np.pi}  # rad from the way of the object to its name
BOLD, THIN, EDGE = -2.5, -0.6, -1.2  # half the width of lines: negative numbers are points of the screen
LIFT = 0.3  # m, that lines lie above the ground of dim things
QUALITY = 85  # of a JPEG

Things = Sequence[tuple[str, Floats]]  # a role, and a box [7] or a path [n, 2]
Labelled = tuple[str, Floats, str]  # role, place [2] and text


def _frames(focus: Focus) -> list[int | None]:
    """The frames around the event; None at the end, which clears its things, if the scene goes on."""
    time = focus.replay.scene.time
    near = np.flatnonzero(np.abs(time - time[focus.at.frame]) <= SECONDS)
    return [*near.tolist(), *([None] if near[-1] + 1 < focus.replay.frames else [])]


def _log_at(recording: rr.RecordingStream, focus: Focus, frames: Sequence[int | None], root: str = "") -> Log:
    first = frames[0] or 0
    numbers: Ints = np.arange(first, first + len(frames))
    return Log(recording, frame_times(focus.replay.scene, numbers), root)


def log_focus(recording: rr.RecordingStream, focus: Focus, root: str = "", alone: bool = True) -> None:
    """Log the bright things of the frames around the event, and the texts and pictures beside them.

    ``root``: prefix of the paths; ``alone``: no other run is shown, so there is room for large letters.
    """
    frames = _frames(focus)
    shown = [None if t is None else focus.frame(t) for t in frames]
    log = _log_at(recording, focus, frames, root)

    def rows_of(things: Callable[[FocusFrame], Things]) -> list[Things]:
        return [[] if frame is None else things(frame) for frame in shown]

    def boxes(path: str, things: Callable[[FocusFrame], Things], radius: float, **style: Any) -> None:
        rows = rows_of(things)
        box = np.array([box for row in rows for _, box in row]).reshape(-1, 7)
        log.boxes(f"{ROOT}/{path}", starts_of(list(map(len, rows))), box, _colors(rows), radius=radius, **style)

    def strips(path: str, things: Callable[[FocusFrame], Things], radius: float) -> None:
        rows = rows_of(things)
        paths = [path for row in rows for _, path in row]
        longest = max(map(len, paths), default=2)
        point = np.full((len(paths), longest, 3), focus.height + LIFT)
        for i, each in enumerate(paths):  # a shorter path repeats its last point
            point[i, :, :2] = np.concatenate([each, np.repeat(each[-1:], longest - len(each), axis=0)])
        log.strips(f"{ROOT}/{path}", starts_of(list(map(len, rows))), point, _colors(rows), radius)

    boxes("truth", lambda frame: [("truth", box) for box in (*frame.object_box, *frame.others)], BOLD)
    boxes("detection", lambda frame: [("detection", box) for box in frame.detection_box], THIN)
    boxes("track", lambda frame: [(track.role, track.box) for track in frame.tracks], EDGE, fill=TRACK_FILL)
    strips("way", lambda frame: [("truth", frame.future)] if len(frame.future) > 1 else [], BOLD)
    strips("samples", lambda frame: _samples(focus, frame), THIN)
    strips("forecast", lambda frame: _nearest(focus, frame), BOLD)
    _log_names(log, focus, [[] if frame is None else _names(focus, frame) for frame in shown])
    recording.log(f"{root}focus/pictures", rr.Image(np.asarray(strip(focus))), static=True)
    recording.log(f"{root}focus/text", rr.TextDocument(text(focus, alone), media_type="text/markdown"), static=True)


def text(focus: Focus, large: bool = True) -> str:
    """The sentence and the key, in Markdown; ``large``: the sentence in large letters."""
    lines = [f"| {WORDS[key.role]} {key.mark.replace('other', 'box')} | {key.text} |" for key in focus.key]
    table = "\n".join(["| mark | what |", "|---|---|", *lines])
    hint = (
        f"The viewer stays at frame {focus.at.frame}. Drag the time cursor to leave it, and step with the arrow keys; "
        "the play button leads back. To play the whole scene, switch the loop off and set the speed to 1."
    )
    heading = f"### {focus.sentence}." if large else f"**{focus.sentence}.**"
    return f"{heading}\n\n{table}\n\nBold: the sample that {focus.bold}. {hint}\n"


def _nearest(focus: Focus, frame: FocusFrame) -> Things:
    return [(role, forecast.nearest_path) for role, forecast in focus.forecasts(frame.frame)]


def _samples(focus: Focus, frame: FocusFrame) -> Things:
    """All samples of the newest forecast, and the trails of the tracks."""
    trails = [(track.role, track.trail) for track in frame.tracks if len(track.trail) > 1]
    paths = [
        (role, np.concatenate([forecast.start[None], path]))
        for role, forecast in focus.forecasts(frame.frame)[-1:]
        for path in forecast.path
    ]
    return [*trails, *paths]


def _colors(rows: Sequence[Sequence[tuple[Any, ...]]]) -> Colors:
    return np.array([COLORS[thing[0]] for row in rows for thing in row], dtype=np.uint8).reshape(-1, 3)


def _log_names(log: Log, focus: Focus, rows: Sequence[Sequence[Labelled]]) -> None:
    names = [name for row in rows for name in row]
    height = np.full(len(names), focus.height + LIFT)
    columns = rr.Points3D.columns(
        positions=np.column_stack([np.array([place for _, place, _ in names]).reshape(-1, 2), height]),
        colors=packed(_colors(rows)),
        labels=[name for _, _, name in names],
    )
    style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5), show_labels=True)
    log.columns(f"{ROOT}/name", style, columns.partition([len(row) for row in rows]))


def _names(focus: Focus, frame: FocusFrame) -> list[Labelled]:
    """Names beside the boxes, each on a side of its own, and at the ends of paths, so that none hides another."""
    window, place = focus.window(), focus.case.place(frame.frame)
    away = 0.5 * focus.length + 0.1 * max(window.high, window.wide / 2)

    def beside(role: str) -> Floats:
        angle = focus.turn + SIDES[role]
        return np.asarray(place + away * np.array([np.cos(angle), np.sin(angle)]))

    names = [("truth", beside("truth"), focus.named)] if len(frame.object_box) else []
    names += [(track.role, beside(track.role), f"track {track.track_id}") for track in frame.tracks]
    ends = [(role, path[-1], f"forecast {role}") for role, path in _nearest(focus, frame)[::-1]]
    ends[1:1] = [("truth", frame.future[-1], "true place then")] if len(frame.future) > 1 else []
    for role, end, name in ends:
        if all(np.hypot(*(end - taken)) > away for _, taken, _ in [*names, ("truth", place, "")]):
            names.append((role, end, name))
    return names


def log_camera(recording: rr.RecordingStream, focus: Focus) -> None:
    """Log the best camera image of each frame around the event with the boxes in it, if the event itself is seen."""
    if photo_of(focus, focus.at.frame) is None:  # then there is no view of them either
        return
    frames = _frames(focus)
    photos = [None if t is None else photo_of(focus, t) for t in frames]
    blobs = [None if photo is None else _jpeg(photo) for photo in photos]
    readable = [blob for blob in blobs if blob is not None]
    if not readable:
        return
    log = _log_at(recording, focus, frames)
    count = [int(blob is not None) for blob in blobs]
    images = rr.EncodedImage.columns(blob=readable, media_type=["image/jpeg"] * len(readable)).partition(count)
    log.columns("focus/camera", rr.EncodedImage.from_fields(draw_order=-1.0), images)
    rows = [
        [(role, line) for role, edges in ([] if photo is None else photo.edges) for line in edges] for photo in photos
    ]
    lines = [line for row in rows for _, line in row]
    strips = rr.LineStrips2D.columns(strips=lines, colors=packed(_colors(rows))).partition([len(row) for row in rows])
    log.columns("focus/camera/box", rr.LineStrips2D.from_fields(radii=EDGE), strips)


def _jpeg(photo: Photo) -> bytes | None:
    """The image as a small file; None if its file cannot be read."""
    if photo.picture is None:
        return None
    content = BytesIO()
    photo.picture.save(content, "JPEG", quality=QUALITY)
    return content.getvalue()
