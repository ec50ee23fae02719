"""An event alone in a recording: its things, bright; small pictures, sentences, numbers and key beside them."""

from collections.abc import Callable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from ...core import Floats, Ints, rotate, starts_of, unit_vectors
from ...scoring import named_parts, parts_text
from ..drawing.report import small_pictures
from ..evidence import distance, gate, visible
from ..focus import Focus
from ..framing import FocusFrame, frame_of, length_of, turn_of, window_of
from ..pages import text_of
from ..sentences import sentence
from .entities import EDGE as RING, EVENT, TRACK_FILL, Log
from .sdk import rr
from .shown import ROLES, SWITCH, Colors, drawable

SIDES = {
    "truth": (0.0, 1.0),
    "now": (0.0, -1.0),
    "before": (-1.0, 0.0),
}  # from a box to its name, if the way is (1, 0)
BOLD, THIN, EDGE = (
    -2.5,
    -0.6,
    -1.2,
)  # half the width of lines: negative numbers are points of the screen
LIFT = 0.3  # m, that lines lie above the ground of dim things
CROSS = 0.3 * np.array(
    [[-1, -1], [1, 1], [0, 0], [-1, 1], [1, -1]]
)  # m, at an expected place
CIRCLE = unit_vectors(np.linspace(0.0, 2 * np.pi, 49))

MOST_DETECTIONS = 3  # whose scores are shown

Things = Sequence[tuple[str, Floats]]  # a role, and a box [7] or a path [n, 2]
Labelled = tuple[str, Floats, str]  # role, place [2] and text


def log_focus(
    recording: rr.RecordingStream,
    focuses: Sequence[Focus],
    number: int,
    root: str,
    window: range,
) -> None:
    """Log the bright things of the frames in the ``window``, and the text and the pictures beside them.

    ``number``: of the focus among those of all runs; ``root``: prefix of its paths.
    """
    focus, end = focuses[number], window.stop
    scene, (x, y, z) = focus.replay.scene, focus.at.position
    log = Log(recording, scene, window, root, ("time", EVENT), window.start)
    shown = [frame_of(focus, t) for t in window]

    def boxes(
        path: str, things: Callable[[FocusFrame], Things], radius: float, **style: Any
    ) -> None:
        rows = [things(frame) for frame in shown]
        box = np.array([box for row in rows for _, box in row]).reshape(-1, 7)
        log.boxes(
            f"world/focus/{path}",
            _starts(rows),
            box,
            _colors(rows),
            radius=radius,
            **style,
        )

    def strips(
        path: str, things: Callable[[FocusFrame], Things], radius: float
    ) -> None:
        rows = [things(frame) for frame in shown]
        paths = [path for row in rows for _, path in row]
        point = np.full((len(paths), max(map(len, paths), default=2), 3), z + LIFT)
        for i, each in enumerate(paths):  # a shorter path repeats its last point
            point[i, :, :2] = np.pad(
                each, ((0, point.shape[1] - len(each)), (0, 0)), mode="edge"
            )
        log.strips(f"world/focus/{path}", _starts(rows), point, _colors(rows), radius)

    boxes(
        "truth",
        lambda frame: [("truth", box) for box in (*frame.object_box, *frame.others)],
        BOLD,
    )
    boxes(
        "detection",
        lambda frame: [("detection", box) for box in frame.detection_box],
        THIN,
    )
    boxes(
        "track",
        lambda frame: [(track.role, track.box) for track in frame.tracks],
        EDGE,
        fill=TRACK_FILL,
    )
    strips(
        "way",
        lambda frame: [("truth", frame.future)] if len(frame.future) > 1 else [],
        BOLD,
    )
    strips("samples", lambda frame: _samples(focus, frame), THIN)
    strips("forecast", lambda frame: _nearest(focus, frame), BOLD)
    strips("signs", lambda frame: _signs(focus, frame), EDGE)
    picture = window_of(focus, focus.at.frame, focuses)
    rows = [
        _names(focus, frame, max(picture.high, picture.wide / 2)) for frame in shown
    ]
    places = [(*place, z + LIFT) for row in rows for _, place, _ in row]
    labels = [name for row in rows for _, _, name in row]
    log.names(
        "world/focus/name",
        _starts(rows),
        np.reshape(places, (-1, 3)),
        _colors(rows),
        labels,
        1.5,
    )
    texts = [drawable(event_text(focus, frame)) for frame in shown]
    log.columns(
        "focus/text",
        None,
        rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts)),
    )
    if end < scene.frames:
        recording.set_time("frame", sequence=end)
        recording.set_time("time", duration=float(scene.time[end] - scene.time[0]))
        recording.log(f"{root}world/focus", rr.Clear(recursive=True))
        recording.reset_time()
    small_pictures(focus, focuses, []).save(png := BytesIO(), format="PNG")
    pictures = rr.EncodedImage(contents=png.getvalue(), media_type="image/png")
    recording.log(f"{root}focus/pictures", pictures, static=True)
    if number == 0:
        ring = np.insert(
            (x, y) + (0.4 + 0.65 * length_of(focus)) * CIRCLE, 2, z, axis=1
        )
        recording.log(
            "world/at", rr.LineStrips3D([ring], radii=RING, colors=SWITCH), static=True
        )


def _nearest(focus: Focus, frame: FocusFrame) -> Things:
    return [
        (role, forecast.nearest_path) for role, forecast in focus.forecasts(frame.frame)
    ]


def _samples(focus: Focus, frame: FocusFrame) -> Things:
    """All samples of the newest forecast, and the trails of the tracks."""
    trails = [
        (track.role, track.trail) for track in frame.tracks if len(track.trail) > 1
    ]
    newest = focus.forecasts(frame.frame)[-1:]
    return trails + [
        (role, np.vstack([forecast.start, path]))
        for role, forecast in newest
        for path in forecast.path
    ]


def _signs(focus: Focus, frame: FocusFrame) -> Things:
    """The event gate, crosses at expected places, lines to detections that tracks took, and the line to the ego."""
    rule, place, detections = (
        gate(focus),
        focus.place(frame.frame),
        focus.replay.scene.detections,
    )
    signs = (
        [("detection", place + rule.threshold * CIRCLE)]
        if len(frame.object_box) and not rule.iou
        else []
    )
    for track in frame.tracks:
        signs += (
            [(track.role, track.expected + CROSS)] if track.expected is not None else []
        )
        took = (
            detections.box[track.detection : track.detection + 1, :2]
            if track.detection >= 0
            else ()
        )
        signs += [("detection", np.stack([track.box[:2], xy])) for xy in took]
    if distance(focus, frame.frame) is not None:
        signs += [("ego", np.stack([place, focus.replay.scene.ego[frame.frame, :2]]))]
    return signs


def _starts(rows: Sequence[Sequence[Any]]) -> Ints:
    return starts_of([len(row) for row in rows])


def _colors(rows: Sequence[Sequence[tuple[Any, ...]]]) -> Colors:
    return np.array(
        [ROLES[thing[0]] for row in rows for thing in row], dtype=np.uint8
    ).reshape(-1, 3)


def _names(focus: Focus, frame: FocusFrame, half: float) -> list[Labelled]:
    """Names beside the boxes, on a side for each role, and at the ends of paths, so that none hides another.

    ``half``: of what is shown, m.
    """
    t, place = frame.frame, focus.place(frame.frame)
    away = 0.5 * length_of(focus) + 0.1 * half
    boxes = [("truth", box, focus.named) for box in frame.object_box]
    boxes += [
        (track.role, track.box, f"track {track.track_id}") for track in frame.tracks
    ]
    sides = {
        role: away * rotate(np.array(side), turn_of(focus))
        for role, side in SIDES.items()
    }
    names: list[Labelled] = [
        (role, box[:2] + sides.get(role, 0.0), name) for role, box, name in boxes
    ]
    ends = [
        (role, path[-1], f"forecast {role}")
        for role, path in _nearest(focus, frame)[::-1]
    ]
    ends[1:1] = (
        [("truth", frame.future[-1], "true place then")]
        if len(frame.future) > 1
        else []
    )
    wanted = ends + [
        ("detection", place, text)
        for place, text, _ in nearest_detections(focus, frame)
    ]
    wanted += [
        (track.role, track.expected, "expected")
        for track in frame.tracks
        if track.expected is not None
    ]
    far = distance(focus, t)
    if far is not None:
        share = min(1.0, 0.8 * half / max(far, 1e-9))
        wanted.append(
            (
                "ego",
                place + share * (focus.replay.scene.ego[t, :2] - place),
                f"ego {far:.0f} m away",
            )
        )
    for each in wanted:
        if all(np.hypot(*(each[1] - other[1])) > 0.9 * away for other in names):
            names.append(each)
    return names


def event_key(focus: Focus) -> str:
    """Key to the view of an event."""
    rule, key = gate(focus), text_of(Path(__file__).parent, "event_key.md")
    return key.format(gate=f"{rule.text}, not drawn" if rule.iou else rule.text)


def event_text(focus: Focus, frame: FocusFrame) -> str:
    """The sentences of an event, and numbers of one frame."""
    t, run = frame.frame, focus.replay
    row, rows, follower = int(focus.rows[t]), {}, focus.follower(t)
    if row >= 0:
        parts = named_parts(run.part[row])
        error = f"{sum(parts.values()):.1f} m: {parts_text(parts)}"
        rows["error"] = "not a target" if np.isnan(run.part[row, 0]) else error
        rows |= (
            {"followed by": f"no track (gate: {gate(focus).text})"}
            if follower < 0
            else {}
        )
    for track in frame.tracks:
        follows = "follows it, " if track.track_id == follower else ""
        off = (
            f"{np.hypot(*(track.box[:2] - focus.place(t))):.1f} m from it, "
            if row >= 0
            else ""
        )
        rows[f"track {track.track_id}"] = (
            f"{follows}{off}took {'no' if track.detection < 0 else 'a'} detection"
        )
    detected = [
        f"{text}, {far:.1f} m off" for _, text, far in nearest_detections(focus, frame)
    ]
    rows["detected"] = "; ".join(detected) or "nothing"
    far, seen = distance(focus, t), visible(focus, t)
    if far is not None:
        rows["ego"] = f"{far:.0f} m away" + (
            "" if seen is None else f", sees {seen:.0%}"
        )
    heading, _, remark = f"{sentence(focus)}.".partition(". ")
    lines = [
        f"##### {heading}",
        "",
        remark,
        "",
        f"| {focus.seconds(t):.1f} s | frame {t} |",
        "|---|---|",
    ]
    return "\n".join([*lines, *(f"| {name} | {text} |" for name, text in rows.items())])


def nearest_detections(
    focus: Focus, frame: FocusFrame
) -> list[tuple[Floats, str, float]]:
    """Place [2], score and distance (m) of the detections nearest to the object."""
    gaps = np.hypot(*(frame.detection_box[:, :2] - focus.place(frame.frame)).T).tolist()
    rows = zip(frame.detection_box[:, :2], frame.detection_text, gaps, strict=True)
    return sorted(rows, key=lambda row: row[2])[:MOST_DETECTIONS]
