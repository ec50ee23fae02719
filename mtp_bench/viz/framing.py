"""Content of the pictures of an event: what is bright and what is dim in a frame, and the part of the world shown."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core import Floats, Ints, Lane, Scene, rotate
from .evidence import (
    confusing,
    expected,
    near_detections,
    owner_of,
    says,
    share,
    taken,
    trail,
)
from .focus import Focus
from .incident import MOMENT, Incident
from .palette import BEFORE, BLACK, NOW, PURPLE, TRUTH
from .run_replay import Replay

MOST_DETECTIONS = 5  # that are bright: the nearest
TRAIL_SECONDS = 3.0
SECONDS = (
    3.0  # before and after an event that are played, and in which its things are bright
)
LARGEST = 60.0  # m, half of what a picture shows
MARGIN = 1.12  # of what has to be seen
ARROW, ARROWS = (
    np.array([[-1.3, 0.6], [0.0, 0.0], [-1.3, -0.6]]),
    15.0,
)  # m: an arrow of a lane, and between two
OFF_CENTER = 0.3  # of half a picture: the object stays in the middle third
# role of a thing in the event -> its colour
ROLES = {
    "truth": TRUTH,
    "before": BEFORE,
    "now": NOW,
    "detection": BLACK,
    "named": PURPLE,
}


def arrows_of(lanes: Iterable[Lane]) -> Iterator[Floats]:
    """Arrow heads [3, 2] on the middle lines, which show the direction of travel; one at least on each lane."""
    for lane in lanes:
        step = np.diff(lane.center, axis=0)
        along = np.append(0.0, np.cumsum(np.linalg.norm(step, axis=1)))
        count = max(1, round(along[-1] / ARROWS))
        for station in (np.arange(count) + 0.5) / count * along[-1]:
            part = min(int(np.searchsorted(along, station)), len(step)) - 1
            place = [
                np.interp(station, along, lane.center[:, axis]) for axis in range(2)
            ]
            yield rotate(ARROW, np.arctan2(step[part, 1], step[part, 0])) + place


@dataclass(frozen=True)
class Window:
    """The part of the world that a picture shows at least."""

    x: float  # m, its centre
    y: float  # m
    wide: float  # m
    high: float  # m
    turn: float = (
        0.0  # rad, the direction of the world that points to the right; 0: north is up
    )


class Follower(NamedTuple):
    """A track that texts name in a picture; its box at the event where it is not output in that frame."""

    track_id: int
    role: str  # "before", "now", or "named": one that has the object at another time, or another object
    frame: int  # of its box: that of the picture, or that in which it takes the object, or the nearest one with a box
    box: Floats  # [7]
    trail: Floats  # [n, 2], the newest place last
    expected: Floats | None  # [2] place by its own forecast of the frame before
    detection: int  # row of the detection that it took, -1 for none


@dataclass(frozen=True, eq=False)
class FocusFrame:
    """One frame: what is bright, and what is dim."""

    frame: int
    object_box: Floats  # [0 or 1, 7] the true object
    past: Floats  # [n, 2] places of the object, now first
    future: Floats  # [n, 2] places of the object, now first
    named: tuple[
        Follower, ...
    ]  # the tracks that texts name; those that are not output then only at the event
    others: Floats  # [n, 7] true boxes that these tracks follow, and these detections are of, besides the object
    other_names: tuple[str, ...]  # n, such as "car 8"
    detection_box: Floats  # [D, 7] the nearest
    detection_text: tuple[
        str, ...
    ]  # D: class where that is not the object's, score, and object where it is another
    dim_truth: Floats  # [n, 7]
    dim_track: Floats  # [n, 7]
    dim_detection: Floats  # [n, 7]

    @property
    def tracks(self) -> tuple[Follower, ...]:
        """The named tracks that are output in this frame."""
        return tuple(track for track in self.named if track.frame == self.frame)


def counterpart(run: Replay, at: Incident) -> Incident:
    """The incident of ``run`` at the place of ``at``, an incident of another run of the same scene.

    It is the event of the object in that frame, or the false forecast nearest to that place, within the forecast gate;
    without either, an incident of kind MOMENT.
    """
    if at.object_id >= 0:
        own = [
            i for i in run.events if (i.object_id, i.frame) == (at.object_id, at.frame)
        ]
        return own[0] if own else replace(run.moment(at.row), name="no event")
    rows = run.rollout.objects.rows(at.frame)
    row = rows.start + np.flatnonzero(
        run.forecast_false[rows] & (run.rollout.object_class[rows] == at.class_id)
    )
    far = np.hypot(*(run.rollout.object_box[row, :2] - np.array(at.position[:2])).T)
    if not (far <= run.card.per_class(run.card.task.forecast_gate)[at.class_id]).any():
        return replace(
            at, kind=MOMENT, name="no event", row=-1, new_id=-1, confidence=None
        )
    best = int(row[np.argmin(far)])
    track = int(run.answers.object_track_id[best])
    lasting = [
        i
        for i in run.incidents
        if i.kind == "spurious" and i.frame <= at.frame <= i.until
    ]
    incident = next(i for i in lasting if i.row == best or i.new_id == track >= 0)
    x, y, z = run.rollout.object_box[best, :3].tolist()
    return replace(incident, frame=at.frame, row=best, position=(x, y, z))


def focuses_of(replays: Sequence[Replay], at: Incident) -> list[Focus]:
    """The event ``at`` of the first of several runs of a scene, and its counterparts, seen the same way."""
    first = Focus(replays[0], at)
    return [
        first,
        *(Focus(run, counterpart(run, at), turn_of(first)) for run in replays[1:]),
    ]


def frames_around(scene: Scene, t: int) -> range:
    """The frames within SECONDS of frame ``t``."""
    near = np.flatnonzero(np.abs(scene.time - scene.time[t]) <= SECONDS + 1e-6)
    return range(int(near[0]), int(near[-1]) + 1)


def frame_of(focus: Focus, t: int) -> FocusFrame:
    """Content of a picture of frame ``t``."""
    truth, detections, rollout = (
        focus.replay.scene.truth,
        focus.replay.scene.detections,
        focus.replay.rollout,
    )
    back = round(TRAIL_SECONDS * focus.replay.card.task.rate)
    named = tuple(_followers(focus, t, back))
    rows = _present([focus.track_rows(track.track_id)[t] for track in named])
    own = _present([focus.rows[t]])
    detected = [*(track.detection for track in named), confusing(focus, t)]
    near = np.unique(
        _present([*detected, *near_detections(focus, t)[:MOST_DETECTIONS]])
    )
    owners = {int(row): owner_of(focus, int(row), t) for row in near}
    followed = (focus.other(track.track_id, t) for track in named)
    others = np.unique(_present([*followed, *_beside(focus, t), *owners.values()]))
    tracked = rollout.tracks.rows(t)
    hidden = tracked.start + np.flatnonzero(~focus.shown[tracked])
    return FocusFrame(
        frame=t,
        object_box=truth.box[own],
        past=focus.path(t, t - back),
        future=focus.future(t),
        named=named,
        others=truth.box[others],
        other_names=tuple(focus.name_of(int(row)) for row in others),
        detection_box=detections.box[near],
        detection_text=tuple(
            _detection_text(focus, row, owner) for row, owner in owners.items()
        ),
        dim_truth=truth.box[_rest(truth.rows(t), own, others)],
        dim_track=rollout.track_box[_rest(tracked, hidden, rows)].astype(np.float64),
        dim_detection=detections.box[_rest(detections.rows(t), near)],
    )


def _followers(focus: Focus, t: int, back: int) -> Iterator[Follower]:
    """The tracks that texts name, with trails of ``back`` frames."""
    at = focus.at
    tracks, taker = (
        (*focus.named_tracks, *focus.tracks_at(t)),
        focus.follower(max(focus.regained, 0)),
    )
    # a track that is found again under its own id is that of "now"
    roles = {**dict.fromkeys(tracks, "named"), at.old_id: "before", at.new_id: "now"}
    for track_id, role in roles.items():
        rows = focus.track_rows(track_id)
        frames = np.flatnonzero(rows >= 0)
        if len(frames) and (rows[t] >= 0 or t == at.frame):
            nearest = int(frames[np.argmin(np.abs(frames - t))])
            frame = (
                focus.regained
                if nearest != t and track_id == taker and focus.regained >= 0
                else nearest
            )
            box = focus.replay.rollout.track_box[rows[frame]].astype(np.float64)
            way, place = (
                trail(focus, track_id, t, 1 + back),
                expected(focus, track_id, t),
            )
            yield Follower(
                track_id, role, frame, box, way, place, taken(focus, track_id, t)
            )


def _beside(focus: Focus, t: int) -> Ints:
    """Row [0 or 1] of the true object beside the object or at a false forecast, of any class."""
    rows = _rest(focus.replay.scene.truth.rows(t), focus.rows[t : t + 1])
    far = np.hypot(*(focus.replay.scene.truth.box[rows, :2] - focus.place(t)).T)
    return rows[np.argsort(far, kind="stable")][: int((far <= focus.near).any())]


def _detection_text(focus: Focus, row: int, owner: int) -> str:
    """Score of a detection, after its class where the object is not of that class: "pedestrian .85, of cyclist 3"."""
    detections = focus.replay.scene.detections
    same = focus.at.object_id >= 0 and detections.class_id[row] == focus.at.class_id
    text = share(detections.score[row]) if same else says(focus, row)
    return f"{text}, of {focus.name_of(owner)}" if owner >= 0 else text


def _present(rows: Sequence[int]) -> Ints:
    """The rows but -1."""
    return np.array([row for row in rows if row >= 0], dtype=np.int64)


def _rest(rows: slice, *shown: Ints) -> Ints:
    """The rows of a frame that are not shown otherwise."""
    return np.setdiff1d(np.arange(rows.start, rows.stop), np.concatenate(shown))


def length_of(focus: Focus) -> float:
    """Length of the object, m; of its track, if only that is there."""
    t, run = focus.at.frame, focus.replay
    rows = (
        (run.scene.truth.box, focus.rows),
        (run.rollout.track_box, focus.track_rows(focus.at.new_id)),
    )
    return next((float(boxes[row[t], 4]) for boxes, row in rows if row[t] >= 0), 2.0)


def turn_of(focus: Focus) -> float:
    """Direction (rad) of the object's way: of its future, else its heading; 0 for a false forecast."""
    row, future = focus.rows[focus.at.frame], focus.future(focus.at.frame)
    if focus.facing is not None or row < 0:
        return focus.facing or 0.0
    way = future[-1] - future[0]
    turns = np.hypot(*way) > length_of(focus) / 2
    return float(
        np.arctan2(way[1], way[0]) if turns else focus.replay.scene.truth.box[row, 3]
    )


def window_of(focus: Focus, t: int, beside: Sequence[Focus] = ()) -> Window:
    """Window of the picture of frame ``t``: the object in its middle third, its future and its forecasts at the event.

    All frames of an event have windows of one size, which follow the object; so have the pictures of all runs
    ``beside`` this one.
    """
    turn, shown = turn_of(focus), beside or (focus,)
    gap = MARGIN * rotate(
        np.concatenate([_things(each) - each.place(each.at.frame) for each in shown]),
        -turn,
    )
    low, high = gap.min(axis=0), gap.max(axis=0)
    half = np.maximum((high - low) / 2, np.maximum(high, -low) / (1 + OFF_CENTER))
    half = np.clip(half, 1.5 + 1.2 * max(map(length_of, shown)), LARGEST)
    x, y = focus.place(t) + rotate(
        np.clip((low + high) / 2, -OFF_CENTER * half, OFF_CENTER * half), turn
    )
    return Window(float(x), float(y), float(2 * half[0]), float(2 * half[1]), turn)


def _things(focus: Focus) -> Floats:
    """Places [n, 2] that the picture of an event has to show, the object's own among them."""
    at = focus.at.frame
    paths, shown = (
        [forecast.nearest_path for _, forecast in focus.forecasts(at)],
        frame_of(focus, at),
    )
    boxes = [
        *shown.object_box,
        *(track.box for track in shown.named),
        *shown.others,
        *shown.detection_box,
    ]
    places = np.array([focus.place(at), *(box[:2] for box in boxes)])
    return np.concatenate([focus.future(at), *paths, places])


def close_window(focus: Focus, t: int, beside: Sequence[Focus]) -> Window:
    """Window of a small picture of frame ``t``: the object and its tracks from near, all at one scale."""
    shown = beside or (focus,)
    reach = max(1.2 + 0.8 * length_of(each) for each in shown)
    for each in shown:
        place, frame = each.place(each.at.frame), frame_of(each, each.at.frame)
        for box in (*frame.object_box, *(track.box for track in frame.tracks)):
            reach = max(
                reach, min(1.3 * float(np.hypot(*(box[:2] - place)) + box[4] / 2), 12.0)
            )
    x, y = focus.place(t).tolist()
    return Window(x, y, 2 * reach, 2 * reach, turn_of(focus))
