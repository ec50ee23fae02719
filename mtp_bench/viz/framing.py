"""Content of the pictures of an event: what is bright in a frame, and the window."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core import Floats, Ints, Lane, Scene, rotate
from .evidence import (
    expected,
    near_detections,
    of_other_class,
    owner_of,
    taken_detection,
    trail,
)
from .focus import Focus, nearest_box
from .incident import MOMENT, Incident
from .run_replay import Replay

MAX_DETECTIONS = 5  # that are bright: the nearest
TRAIL_SECONDS = 3.0
AROUND_SECONDS = 3.0  # before and after an event that are played
LARGEST_M = 60.0  # half of what a picture shows
CLOSE_M = 12.0  # the same of a close-up
MARGIN = 1.12  # of what has to be seen
ARROW_M = np.array([[-1.3, 0.6], [0.0, 0.0], [-1.3, -0.6]])  # of a lane
ARROW_STEP_M = 15.0  # between two arrows
OFF_CENTER = 0.3  # of half a picture: the object stays in the middle third


def arrows_of(lanes: Iterable[Lane]) -> Iterator[Floats]:
    """Yield arrow heads [3, 2] along the direction of travel.

    Each lane has at least one.
    """
    for lane in lanes:
        steps = np.diff(lane.center, axis=0)
        along = np.append(0.0, np.cumsum(np.linalg.norm(steps, axis=1)))
        count = max(1, round(along[-1] / ARROW_STEP_M))
        for station in (np.arange(count) + 0.5) / count * along[-1]:
            step = min(int(np.searchsorted(along, station)), len(steps)) - 1
            heading = np.arctan2(steps[step, 1], steps[step, 0])
            place = [np.interp(station, along, axis) for axis in lane.center[:, :2].T]
            yield rotate(ARROW_M, heading) + place


@dataclass(frozen=True)
class Window:
    """The part of the world that a picture shows at least."""

    x: float  # m, its centre
    y: float  # m
    wide: float  # m
    high: float  # m
    turn: float = 0.0  # rad, direction that points to the right; 0: north is up


class ShownTrack(NamedTuple):
    """A track in colour."""

    track_id: int
    # "before", "now", or "named": it is at the object, or follows it at another time
    role: str
    box: Floats  # [7]
    trail: Floats  # [n, 2], the newest place last
    expected: Floats | None  # [2] place at constant velocity
    detection: int  # row of the detection that it took, -1 for none


@dataclass(frozen=True, eq=False)
class FocusFrame:
    """One frame: what is bright, and what is dim."""

    frame: int
    object_box: Floats  # [0 or 1, 7] the true object
    past: Floats  # [n, 2] places of the object, now first
    future: Floats  # [n, 2] places of the object, now first
    tracks: tuple[ShownTrack, ...]
    other_boxes: Floats  # [n, 7] other true boxes of these tracks and detections
    other_names: tuple[str, ...]  # n, such as "car 8"
    detection_box: Floats  # [D, 7] the nearest
    detection_text: tuple[str, ...]  # D: class, score, and object if another one
    dim_truth: Floats  # [n, 7]
    dim_track: Floats  # [n, 7]
    dim_detection: Floats  # [n, 7]


def counterpart(replay: Replay, at: Incident) -> Incident:
    """Return the incident of ``replay`` that matches another run's.

    Both are runs of one scene. It is the event of the object in that frame, or the
    false forecast nearest to that place within the forecast gate. Without either it is
    an incident of kind MOMENT.
    """
    if at.object_id >= 0:
        for event in replay.events:
            if (event.object_id, event.frame) == (at.object_id, at.frame):
                return event
        return replace(replay.moment(at.row), name="no event")
    rollout = replay.rollout
    rows = rollout.objects.rows(at.frame)
    same_class = rollout.object_class[rows] == at.class_id
    is_alike = replay.forecast_false[rows] & same_class
    place = np.array(at.position[:2])
    gate_m = Focus(replay, at).gate_m
    row = nearest_box(rollout.object_box, rows, is_alike, place, gate_m)
    if row < 0:
        return replace(
            at, kind=MOMENT, name="no event", row=-1, new_id=-1, confidence=None
        )
    track_id = int(replay.answers.object_track_id[row])
    # the run of false forecasts that this one is part of
    incident = next(
        run
        for run in replay.incidents
        if run.kind == "spurious"
        and run.frame <= at.frame <= run.until
        and (run.row == row or run.new_id == track_id >= 0)
    )
    x, y, z = rollout.object_box[row, :3].tolist()
    return replace(incident, frame=at.frame, row=row, position=(x, y, z))


def focuses_of(replays: Sequence[Replay], at: Incident) -> list[Focus]:
    """Focus on an event of a run and on its counterparts.

    All are runs of one scene and seen from the same direction.
    """
    first = Focus(replays[0], at)
    facing = turn_of(first)
    counterparts = [Focus(run, counterpart(run, at), facing) for run in replays[1:]]
    return [first, *counterparts]


def frames_around(scene: Scene, t: int) -> range:
    """Return the frames within `AROUND_SECONDS` of frame ``t``."""
    offset_s = np.abs(scene.time - scene.time[t])
    frames = np.flatnonzero(offset_s <= AROUND_SECONDS + 1e-6)  # rounding
    return range(int(frames[0]), int(frames[-1]) + 1)


def frame_of(focus: Focus, t: int) -> FocusFrame:
    """Collect the content of a picture of frame ``t``."""
    replay = focus.replay
    truth = replay.scene.truth
    detections = replay.scene.detections
    rollout = replay.rollout
    frames_back = round(TRAIL_SECONDS * replay.card.task.rate)
    tracks = tuple(_tracks(focus, t, frames_back))
    track_rows = _existing_rows(
        [focus.track_rows(track.track_id)[t] for track in tracks]
    )
    object_rows = _existing_rows([focus.rows[t]])
    shown_detections = [track.detection for track in tracks]
    if len(object_rows):
        shown_detections.append(of_other_class(focus, t, detections))
    shown_detections += near_detections(focus, t)[:MAX_DETECTIONS].tolist()
    detection_rows = np.unique(_existing_rows(shown_detections))
    owners = [owner_of(focus, row, t) for row in detection_rows.tolist()]
    followed = [focus.other_object(track.track_id, t) for track in tracks]
    neighbour = _nearest_other(focus, t)
    other_rows = np.unique(_existing_rows([*followed, neighbour, *owners]))
    is_hidden = ~focus.shown[rollout.tracks.rows(t)]  # in other hypotheses
    hidden_rows = rollout.tracks.start[t] + np.flatnonzero(is_hidden)
    texts = [
        _detection_text(focus, row, owner)
        for row, owner in zip(detection_rows.tolist(), owners, strict=True)
    ]
    dim_truth = _without(truth.rows(t), object_rows, other_rows)
    dim_track = _without(rollout.tracks.rows(t), hidden_rows, track_rows)
    dim_detection = _without(detections.rows(t), detection_rows)
    return FocusFrame(
        frame=t,
        object_box=truth.box[object_rows],
        past=focus.path(t, t - frames_back),
        future=focus.future(t),
        tracks=tracks,
        other_boxes=truth.box[other_rows],
        other_names=tuple(map(focus.name_of, other_rows.tolist())),
        detection_box=detections.box[detection_rows],
        detection_text=tuple(texts),
        dim_truth=truth.box[dim_truth],
        dim_track=rollout.track_box[dim_track].astype(np.float64),
        dim_detection=detections.box[dim_detection],
    )


def _tracks(focus: Focus, t: int, frames_back: int) -> Iterator[ShownTrack]:
    """Yield the tracks in colour, with trails of ``frames_back`` frames."""
    roles = dict.fromkeys(focus.tracks_at(t), "named")
    # a track that is found again under its own id is that of "now"
    roles |= {focus.at.old_id: "before"} | {focus.at.new_id: "now"}
    for track_id, role in roles.items():
        row = focus.track_rows(track_id)[t]
        if row >= 0:
            yield ShownTrack(
                track_id,
                role,
                focus.replay.rollout.track_box[row].astype(np.float64),
                trail(focus, track_id, t, 1 + frames_back),
                expected(focus, track_id, t),
                taken_detection(focus, track_id, t),
            )


def _nearest_other(focus: Focus, t: int) -> int:
    """Return the row of the nearest other true object, or -1."""
    truth = focus.replay.scene.truth
    rows = truth.rows(t)
    is_other = np.arange(rows.start, rows.stop) != focus.rows[t]
    return nearest_box(truth.box, rows, is_other, focus.place(t), focus.near_m)


def _detection_text(focus: Focus, row: int, owner: int) -> str:
    """Describe a detection: ".85" or "pedestrian .85, of cyclist 3"."""
    detections = focus.replay.scene.detections
    text = f"{detections.score[row]:.2f}".replace("0.", ".")
    class_id = detections.class_id[row]
    if focus.at.object_id < 0 or class_id != focus.at.class_id:
        text = f"{focus.replay.class_noun(class_id)} {text}"
    return f"{text}, of {focus.name_of(owner)}" if owner >= 0 else text


def _existing_rows(rows: Iterable[int]) -> Ints:
    """Return the rows without -1."""
    return np.array([row for row in rows if row >= 0], dtype=np.int64)


def _without(rows: slice, *left_out: Ints) -> Ints:
    """Return the rows of a frame without those ``left_out``."""
    return np.setdiff1d(np.arange(rows.start, rows.stop), np.concatenate(left_out))


# ---- the window


def length_of(focus: Focus) -> float:
    """Return the length of the object, else of its track, else 2 m."""
    t = focus.at.frame
    replay = focus.replay
    if focus.rows[t] >= 0:
        return float(replay.scene.truth.box[focus.rows[t], 4])
    track_row = focus.track_rows(focus.at.new_id)[t]
    return float(replay.rollout.track_box[track_row, 4]) if track_row >= 0 else 2.0


def turn_of(focus: Focus) -> float:
    """Return the direction of the object's way, rad.

    It is `Focus.facing` if that is stated, and 0 for a false forecast. Else it is that
    of the object's future, or its heading if it stands.
    """
    if focus.facing is not None:
        return focus.facing
    row = focus.rows[focus.at.frame]
    if row < 0:
        return 0.0
    future = focus.future(focus.at.frame)
    way = future[-1] - future[0]
    if np.hypot(*way) > length_of(focus) / 2:
        return float(np.arctan2(way[1], way[0]))
    return float(focus.replay.scene.truth.box[row, 3])


def window_of(
    focus: Focus, t: int, compared: Sequence[Focus] = (), is_close: bool = False
) -> Window:
    """Return the window of frame ``t``, which follows the object.

    It holds the object in its middle third, and its future and forecasts at the event;
    if ``is_close`` only the boxes. All frames of an event have windows of one size, and
    so have the pictures of all ``compared`` runs, of which ``focus`` is one.
    """
    turn = turn_of(focus)
    shown = compared or (focus,)
    offsets_m = [
        _places_to_show(run, is_close) - run.place(run.at.frame) for run in shown
    ]
    offset_m = MARGIN * rotate(np.concatenate(offsets_m), -turn)
    low = offset_m.min(axis=0)
    high = offset_m.max(axis=0)
    # The object, at 0, is at most OFF_CENTER halves off the middle. So a window is
    # as large as its content, or as the far end needs.
    far_end = np.maximum(high, -low)
    half = np.maximum((high - low) / 2, far_end / (1 + OFF_CENTER))
    smallest = 1.5 + 1.2 * max(map(length_of, shown))  # the whole object and some room
    largest = max(smallest, CLOSE_M) if is_close else LARGEST_M
    half = np.clip(half, smallest, largest)
    offset = np.clip((low + high) / 2, -OFF_CENTER * half, OFF_CENTER * half)
    x, y = (focus.place(t) + rotate(offset, turn)).tolist()
    return Window(x, y, float(2 * half[0]), float(2 * half[1]), turn)


def _places_to_show(focus: Focus, is_close: bool) -> Floats:
    """Return places [n, 2] that the picture has to show at the event."""
    t = focus.at.frame
    shown = frame_of(focus, t)
    boxes = [*shown.object_box, *shown.other_boxes, *shown.detection_box]
    boxes += [track.box for track in shown.tracks]
    places = np.array([focus.place(t), *(box[:2] for box in boxes)])
    if is_close:
        return places
    paths = [forecast.nearest_path for _, forecast in focus.forecasts(t)]
    return np.concatenate([focus.future(t), *paths, places])
