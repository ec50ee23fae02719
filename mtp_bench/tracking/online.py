"""Anybody's online tracker in place of ours: detections in, ``(id, box, score)`` out, histories kept for it."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..agent import Observation, Tracks
from ..errors import ShapeError, SubmissionError
from ..types import Bools, Floats, Ints, Task
from .birds_eye import BirdsEye
from .histories import Histories, Said
from .joint import k_best
from .online_rows import Row, read_rows


@dataclass(frozen=True, eq=False)
class OnlineDetections:
    """The detections of a frame, as an online tracker is given them."""

    box: Floats  # [D, 7] x y z yaw l w h, metres and radians
    rectangle: Floats  # [D, 4] x1 y1 x2 y2 around the box, pixels of the adapter's `BirdsEye`
    class_id: Ints  # [D] index into task.classes
    score: Floats  # [D] as the detector gives it, a logit may be negative
    velocity: Floats  # [D, 2] m/s; zeros where it is not measured
    time: float  # s since the first frame
    dt: float  # s since the frame before

    def __len__(self) -> int:
        return len(self.box)

    def select(self, kept: Bools) -> OnlineDetections:
        """The detections where ``kept`` [D]."""
        named = ("box", "rectangle", "class_id", "score", "velocity")
        return replace(self, **{name: getattr(self, name)[kept] for name in named})


@runtime_checkable
class _Updated(Protocol):
    def update(self, detections: OnlineDetections) -> Sequence[Any]: ...


Update = Callable[[OnlineDetections], Sequence[Any]]
Make = Callable[[Task], _Updated | Update]


class OnlineTracker:
    """An ordinary online tracker as a `Tracker` of one hypothesis.

    ``make``: is called with the task when a scene begins and gives the tracker: an object with ``update(detections)``,
    or a function. It is called once per frame with `OnlineDetections` and answers with a row for each of its tracks::

        (id, box, score)                  the detection that it took is found by place
        (id, box, score, detection)       it says so: a row of the detections, -1 for none

    ``id``: anything hashable. It goes on after a gap, and stands for another identity in another class. ``box``: 7
    numbers as in the detections, or 4 numbers of a rectangle: then the track has the whole box of its detection, or its
    last one, moved to the rectangle's centre. A track that takes no detection (coasts) is kept as long as the tracker
    names it; one that never took any has no class, and is left out. ``score``: of the track; it counts only until the
    track takes a detection, whose scores are remembered instead.

    ``per_class``: a tracker for each class of the task, which sees the detections of that class alone.
    ``view``: how rectangles are drawn. ``gate``: metres, BEV, up to which a track takes a detection that it did not
    name.

    Example: `Pipeline(OnlineTracker(lambda task: MyTracker()), KinematicPredictor(), KMeansSampler())`.

    Raises SubmissionError for what cannot be updated, and ShapeError, naming frame and row, for a wrong answer.
    """

    def __init__(self, make: Make, per_class: bool = False, view: BirdsEye | None = None, gate: float = 2.0) -> None:
        if not 0 < gate < np.inf:
            raise ShapeError(f"gate is {gate}, expected metres, a finite number above 0")
        self._make, self._per_class, self._view, self._gate = make, per_class, view or BirdsEye(), gate

    def reset(self, task: Task) -> None:
        """Forget everything, and make new trackers."""
        self._groups: list[int | None] = list(range(len(task.classes))) if self._per_class else [None]
        self._updates = [_update_of(self._make(task)) for _ in self._groups]
        self._histories = Histories(task.past)
        self._frame = -1
        self._number: dict[tuple[Hashable, int], int] = {}  # identity of an id (and its tracker) in a class
        self._last: dict[Hashable, tuple[int, Floats]] = {}  # class and box of an id

    def step(self, observation: Observation) -> Tracks:
        """Tracks after this frame: those that the tracker names."""
        self._frame += 1
        rows = np.flatnonzero(np.asarray(observation["detection_valid"]))
        seen = self._seen(observation, rows)
        told: list[_Told] = []
        for group, update in zip(self._groups, self._updates, strict=True):
            mine = np.ones(len(seen), dtype=bool) if group is None else seen.class_id == group
            said = read_rows(update(seen.select(mine)), int(mine.sum()), self._frame)
            told += self._resolve(said, seen.select(mine), np.flatnonzero(mine), group)
        return self._histories.after(_said(told, rows), observation["detection_score"])

    def _seen(self, observation: Observation, rows: Ints) -> OnlineDetections:
        box = np.asarray(observation["detection_box"], dtype=np.float64)[rows]
        return OnlineDetections(
            box=box,
            rectangle=self._view.rectangles(box),
            class_id=np.asarray(observation["detection_class"], dtype=np.int64)[rows],
            score=np.asarray(observation["detection_score"], dtype=np.float64)[rows],
            velocity=np.asarray(observation["detection_velocity"], dtype=np.float64)[rows],
            time=float(observation["time"]),
            dt=float(observation["dt"]),
        )

    def _resolve(self, said: list[Row], seen: OnlineDetections, place: Ints, group: int | None) -> list[_Told]:
        """What the rows of one tracker mean; ``place`` [D] of the detections that it saw, among all."""
        told = []
        for row, at in zip(said, self._taken(said, seen, group).tolist(), strict=True):
            key = (group, row.id)
            if at >= 0:
                class_id, measured = int(seen.class_id[at]), seen.box[at]
                box = row.box if len(row.box) == 7 else measured
            elif key in self._last:
                class_id, last = self._last[key]
                moved = np.concatenate([self._centre(row.box), last[2:]])
                box = measured = row.box if len(row.box) == 7 else moved
            else:
                continue  # it never took a detection: nobody knows of which class it is
            self._last[key] = class_id, box
            number = self._number.setdefault((key, class_id), len(self._number))
            told.append(_Told(number, box, class_id, row.score, -1 if at < 0 else int(place[at]), measured))
        return told

    def _taken(self, said: list[Row], seen: OnlineDetections, group: int | None) -> Ints:
        """The detection that each row took, -1 for none: what it says, else the nearest that is free, one to one."""
        taken = np.array([-1 if row.detection is None else row.detection for row in said], dtype=np.int64)
        free = np.setdiff1d(np.arange(len(seen)), taken)
        silent = np.array([at for at, row in enumerate(said) if row.detection is None], dtype=np.int64)
        if not len(free) or not len(silent):
            return taken
        centre = np.array([self._centre(said[i].box) for i in silent])
        distance = np.linalg.norm(centre[:, None] - seen.box[None, free, :2], axis=-1)
        known = [self._last.get((group, said[i].id), (-1,))[0] for i in silent]
        strange = np.array([[k not in (-1, c) for c in seen.class_id[free].tolist()] for k in known])
        cost = distance + self._gate * strange - 3 * self._gate  # its own class first
        column = k_best(np.where(distance <= self._gate, cost, np.inf), 1)[1][0]
        taken[silent] = np.append(free, -1)[column]
        return taken

    def _centre(self, box: Floats) -> Floats:
        """Centre [2] of a box [7] or of a rectangle [4], m."""
        return box[:2] if len(box) == 7 else self._view.centres(box)


@dataclass(frozen=True, eq=False)
class _Told:
    """One track of a frame."""

    number: int
    box: Floats
    class_id: int
    score: float
    detection: int  # among the detections of the frame
    measured: Floats


def _said(told: list[_Told], rows: Ints) -> Said:
    """The tracks of a frame as arrays; ``rows`` [D]: where its detections are in the observation."""
    return Said(
        track_id=np.array([one.number for one in told], dtype=np.int64),
        box=np.array([one.box for one in told], dtype=np.float64).reshape(-1, 7),
        class_id=np.array([one.class_id for one in told], dtype=np.int64),
        score=np.array([one.score for one in told], dtype=np.float64),
        detection=np.append(rows, -1)[np.array([one.detection for one in told], dtype=np.int64)],
        measured=np.array([one.measured for one in told], dtype=np.float64).reshape(-1, 7),
    )


def _update_of(tracker: _Updated | Update) -> Update:
    if isinstance(tracker, _Updated):
        return tracker.update
    if callable(tracker):
        return tracker
    raise SubmissionError(
        f"OnlineTracker got a {type(tracker).__name__} from its function, expected an object with update(detections), "
        "or a function of detections"
    )
