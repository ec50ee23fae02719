"""An event alone in a recording: what belongs to it, bright; small pictures, the sentence and the key beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...types import Floats, Ints, starts_of
from ..drawing.report import strip
from ..focus import Focus, FocusFrame
from ..palette import NOW, SKY, TRUTH, Color
from .arrays import Boxes, Strips
from .colors import SWITCH, Colors, packed
from .entities import TRACK_FILL, Log, frame_times
from .sdk import rr

ROOT = "world/focus"
SECONDS = 5.0  # before and after the event in which its things are bright
COLORS: dict[str, Color] = {"truth": TRUTH, "before": SKY, "now": NOW, "detection": (190, 190, 190), "event": SWITCH}
WORDS = {
    "truth": "green",
    "before": "blue",
    "now": "orange",
    "detection": "light grey",
    "event": "pink",
    "dim": "dark grey",
}
SIDES = {"truth": np.pi / 2, "now": -np.pi / 2, "before": np.pi}  # rad from the way of the object, where its name is
BOLD, THIN, EDGE = -2.5, -0.6, -1.2  # half the width of lines: negative numbers are points of the screen
LIFT = 0.3  # m, that lines lie above the ground of what is dim


def frames_around(focus: Focus) -> Ints:
    """The frames in which the things of the event are shown, and one more, which clears them."""
    time = focus.replay.scene.time
    near = np.flatnonzero(np.abs(time - time[focus.at.frame]) <= SECONDS)
    return np.append(near, near[-1] + 1)[: focus.replay.frames - near[0]]


def shown_in(focus: Focus, t: int) -> bool:
    """Whether frame ``t`` is near the event."""
    time = focus.replay.scene.time
    return bool(abs(time[t] - time[focus.at.frame]) <= SECONDS)


def log_focus(recording: rr.RecordingStream, focus: Focus, root: str = "", alone: bool = True) -> None:
    """Log what is bright in the frames around the event, and what stands beside it.

    ``root``: prefix of the paths; ``alone``: no other run is shown, so there is room for large letters.
    """
    frames = frames_around(focus)
    shown = [focus.frame(t) if shown_in(focus, t) else None for t in frames.tolist()]
    log = Log(recording, frame_times(focus.replay.scene, frames), root)

    def boxes(things: Callable[[FocusFrame], Things]) -> Boxes:
        return _boxes([[] if frame is None else things(frame) for frame in shown])

    def strips(things: Callable[[FocusFrame], Things]) -> Strips:
        return _strips([[] if frame is None else things(frame) for frame in shown], focus.height)

    truth = boxes(lambda frame: [("truth", box) for box in (*frame.object_box, *frame.others)])
    log.boxes(f"{ROOT}/truth", truth, radius=BOLD)
    detected = boxes(lambda frame: [("detection", box) for box in frame.detection_box])
    log.boxes(f"{ROOT}/detection", detected, radius=THIN)
    tracks = boxes(lambda frame: [(track.role, track.box) for track in frame.tracks])
    log.boxes(f"{ROOT}/track", tracks, TRACK_FILL, EDGE)
    ways = strips(lambda frame: [("truth", frame.future)] if len(frame.future) > 1 else [])
    log.strips(f"{ROOT}/way", ways, BOLD)
    log.strips(f"{ROOT}/samples", strips(lambda frame: _samples(focus, frame)), THIN)
    log.strips(f"{ROOT}/forecast", strips(lambda frame: _nearest(focus, frame)), BOLD)
    _log_labels(log, focus, [[] if frame is None else _names(focus, frame) for frame in shown])
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
    said = f"### {focus.sentence}." if large else f"**{focus.sentence}.**"
    return f"{said}\n\n{table}\n\nBold: the sample that {focus.bold}. {hint}\n"


Things = Sequence[tuple[str, Floats]]  # a role, and boxes [7] or a path [n, 2]
Name = tuple[str, Floats, str]  # role, place [2] and text


def _nearest(focus: Focus, frame: FocusFrame) -> Things:
    return [(role, forecast.nearest_path) for role, forecast in focus.forecasts(frame.frame)]


def _samples(focus: Focus, frame: FocusFrame) -> Things:
    """All samples of the newest forecast, and where the tracks were."""
    trails = [(track.role, track.trail) for track in frame.tracks if len(track.trail) > 1]
    paths = [
        (role, np.concatenate([forecast.start[None], path]))
        for role, forecast in focus.forecasts(frame.frame)[-1:]
        for path in forecast.path
    ]
    return [*trails, *paths]


def _boxes(rows: Sequence[Things]) -> Boxes:
    """Boxes over the frames, in the colours of their roles."""
    box = np.array([box for row in rows for _, box in row], dtype=np.float32).reshape(-1, 7)
    return Boxes(starts_of([len(row) for row in rows]), box, _colors(rows), [])


def _strips(rows: Sequence[Things], height: float) -> Strips:
    """Polylines over the frames; a shorter one repeats its last point."""
    paths = [path for row in rows for _, path in row]
    longest = max((len(path) for path in paths), default=2)
    point = np.full((len(paths), longest, 3), height + LIFT, dtype=np.float32)
    for i, path in enumerate(paths):
        point[i, :, :2] = np.concatenate([path, np.repeat(path[-1:], longest - len(path), axis=0)])
    return Strips(starts_of([len(row) for row in rows]), point, _colors(rows))


def _colors(rows: Sequence[Sequence[tuple[Any, ...]]]) -> Colors:
    return np.array([COLORS[thing[0]] for row in rows for thing in row], dtype=np.uint8).reshape(-1, 3)


def _log_labels(log: Log, focus: Focus, rows: Sequence[Sequence[Name]]) -> None:
    """Names beside the boxes, each on a side of its own, so that none hides another."""
    flat = [name for row in rows for name in row]
    height = np.full(len(flat), focus.height + LIFT)
    columns = rr.Points3D.columns(
        positions=np.column_stack([np.array([place for _, place, _ in flat]).reshape(-1, 2), height]),
        colors=packed(_colors(rows)),
        labels=[name for _, _, name in flat],
    )
    style = rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.5), show_labels=True)
    log.columns(f"{ROOT}/name", style, columns.partition([len(row) for row in rows]))


def _names(focus: Focus, frame: FocusFrame) -> list[Name]:
    """The names of a frame: of the boxes beside the object, of paths where they end."""
    window, place = focus.window(), focus.case.place(frame.frame)
    away = 0.5 * focus.length + 0.1 * max(window.high, window.wide / 2)

    def beside(role: str) -> Floats:
        angle = focus.turn + SIDES[role]
        return np.asarray(place + away * np.array([np.cos(angle), np.sin(angle)]))

    names = [("truth", beside("truth"), f"{focus.case.noun} {focus.at.object_id}")] if len(frame.object_box) else []
    names += [(track.role, beside(track.role), f"track {track.track_id}") for track in frame.tracks]
    ends = [(role, path[-1], f"forecast {role}") for role, path in _nearest(focus, frame)[::-1]]
    ends = [*ends[:1], *([("truth", frame.future[-1], "true place then")] if len(frame.future) > 1 else []), *ends[1:]]
    for role, end, text in ends:
        if all(np.hypot(*(end - taken)) > away for _, taken, _ in [*names, ("truth", place, "")]):
            names.append((role, end, text))
    return names
