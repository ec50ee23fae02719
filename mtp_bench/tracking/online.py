"""An adapter for online trackers of other libraries: detections in, ``(id, box, score)`` out."""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from reprlib import repr as _short
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

import numpy as np

from ..core import (
    Bools,
    Floats,
    Ints,
    Observation,
    ShapeError,
    SubmissionError,
    Task,
    Tracks,
    bev_corners,
)
from .given import Histories, TrackReport
from .joint import k_best

FORM = "(id, box, score) or (id, box, score, detection)"
_BOX = "x y z yaw l w h with sizes above 0, or x1 y1 x2 y2 in pixels, all finite"


@dataclass(frozen=True)
class BirdsEye:
    """Axis-aligned rectangles of boxes in a picture of the ground, for trackers of image boxes.

    ``scale``: pixels per metre; ``padding``: metres by which rectangles are larger on every side.

    Pixel (0, 0) is the origin of the observations' frame, so coordinates may be negative. The frame does not move with
    the ego where the env compensates its motion: what stands still stays where it is. Padding helps where objects
    move by more than their own size between two frames, which leaves no overlap.
    """

    scale: float = 10.0
    padding: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.scale < np.inf:
            raise ShapeError(
                f"scale is {self.scale}, expected pixels per metre, a number above 0"
            )
        if not 0 <= self.padding < np.inf:
            raise ShapeError(f"padding is {self.padding}, expected metres, 0 or more")

    def rectangles(self, box: Floats) -> Floats:
        """The rectangles [D, 4] x1 y1 x2 y2, pixels, around boxes [D, 7] x y z yaw l w h, metres."""
        corners = bev_corners(np.asarray(box, dtype=np.float64))
        low, high = (
            corners.min(axis=-2) - self.padding,
            corners.max(axis=-2) + self.padding,
        )
        return self.scale * np.concatenate([low, high], axis=-1)

    def centres(self, rectangle: Floats) -> Floats:
        """Centres [N, 2] x y, metres, of rectangles [N, 4] in pixels: those of the boxes inside."""
        return (rectangle[..., :2] + rectangle[..., 2:]) / (2 * self.scale)


@dataclass(frozen=True, eq=False)
class OnlineDetections:
    """The detections of a frame, as an online tracker is given them."""

    box: Floats  # [D, 7] x y z yaw l w h, metres and radians
    rectangle: (
        Floats  # [D, 4] x1 y1 x2 y2 around the box, pixels of the adapter's `BirdsEye`
    )
    class_id: Ints  # [D] index into task.classes
    score: Floats  # [D] as the detector gives it, a logit may be negative
    velocity: Floats  # [D, 2] m/s; zeros where it is not measured
    time: float  # s since the first frame
    dt: float  # s since the frame before

    def __len__(self) -> int:
        return len(self.box)

    def select(self, kept: Bools) -> Self:
        """The detections where ``kept`` [D]."""
        named = ("box", "rectangle", "class_id", "score", "velocity")
        return replace(self, **{name: getattr(self, name)[kept] for name in named})


class TrackRow(NamedTuple):
    """One track of a frame."""

    id: Hashable
    box: Floats  # [7], or [4] of a rectangle
    score: float
    detection: int | None  # -1: none was taken; None: not stated


@runtime_checkable
class _Updated(Protocol):
    def update(self, detections: OnlineDetections) -> Sequence[Any]: ...


Update = Callable[[OnlineDetections], Sequence[Any]]
Make = Callable[[Task], _Updated | Update]


class OnlineTracker:
    """An ordinary online tracker as a `Tracker` of one hypothesis.

    ``make``: is called with the task when a scene begins, and after a hole in time, and gives the tracker: an object
    with ``update(detections)``, or a function. It is called once per frame with `OnlineDetections` and answers with a
    row for each of its tracks::

        (id, box, score)                  the detection that it took is found by place
        (id, box, score, detection)       it says so: a row of the detections, -1 for none

    ``id``: anything hashable. It goes on after a gap, and stands for another identity in another class. ``box``: 7
    numbers as in the detections, or 4 numbers of a rectangle: then the track has the whole box of its detection, or its
    last one, moved to the rectangle's centre. A track that takes no detection (coasts) is kept as long as the tracker
    names it; one that never took any has no class, and is left out. ``score``: of the track; it counts only until the
    track takes a detection, whose scores are remembered instead.

    ``per_class``: a tracker for each class of the task, which sees the detections of that class alone.
    ``view``: how rectangles are drawn. ``gate``: m, BEV, up to which a track takes a detection that it did not name.

    Example: `Pipeline(OnlineTracker(lambda task: MyTracker()), KinematicPredictor(), KMeansSampler())`.

    Raises SubmissionError for what cannot be updated, and ShapeError, naming frame and row, for a wrong answer.
    """

    def __init__(
        self,
        make: Make,
        per_class: bool = False,
        view: BirdsEye | None = None,
        gate: float = 2.0,
    ) -> None:
        if not 0 < gate < np.inf:
            raise ShapeError(
                f"gate is {gate}, expected metres, a finite number above 0"
            )
        self._make, self._per_class, self._view, self._gate = (
            make,
            per_class,
            view or BirdsEye(),
            gate,
        )

    def reset(self, task: Task) -> None:
        """Forget everything, and make new trackers."""
        self._groups: list[int | None] = (
            list(range(len(task.classes))) if self._per_class else [None]
        )
        self._frame, self._piece, self._task = -1, 0, task
        self._number: dict[
            tuple[Hashable, int], int
        ] = {}  # identity of an id (and its tracker) in a class
        self._begin()

    def _begin(self) -> None:
        """Begin a scene, or what follows a hole in time, with new trackers."""
        self._updates = [_update_of(self._make(self._task)) for _ in self._groups]
        self._histories = Histories(self._task.past)
        self._last: dict[Hashable, tuple[int, Floats]] = {}  # class and box of an id

    def step(self, observation: Observation) -> Tracks:
        """Tracks after this frame: those that the tracker names."""
        self._frame += 1
        if self._task.after_hole(observation):
            self._piece += 1
            self._begin()
        rows = np.flatnonzero(observation["detection_valid"])
        seen = self._seen(observation, rows)
        reports: list[TrackReport] = []
        for group, update in zip(self._groups, self._updates, strict=True):
            mine = (
                np.ones(len(seen), dtype=bool)
                if group is None
                else seen.class_id == group
            )
            answer = read_rows(update(seen.select(mine)), int(mine.sum()), self._frame)
            reports += self._reports(answer, seen.select(mine), rows[mine], group)
        return self._histories.after(reports, observation["detection_score"])

    def _seen(self, observation: Observation, rows: Ints) -> OnlineDetections:
        box = observation["detection_box"][rows].astype(np.float64)
        return OnlineDetections(
            box=box,
            rectangle=self._view.rectangles(box),
            class_id=observation["detection_class"][rows].astype(np.int64),
            score=observation["detection_score"][rows].astype(np.float64),
            velocity=observation["detection_velocity"][rows].astype(np.float64),
            time=float(observation["time"]),
            dt=float(observation["dt"]),
        )

    def _reports(
        self,
        answer: list[TrackRow],
        seen: OnlineDetections,
        row: Ints,
        group: int | None,
    ) -> list[TrackReport]:
        """Rows of one tracker with their classes; ``row`` [D]: its detections in the observation."""
        reports = []
        for track, taken in zip(
            answer, self._taken(answer, seen, group).tolist(), strict=True
        ):
            key = (self._piece, group, track.id)
            if taken >= 0:
                class_id, measured = int(seen.class_id[taken]), seen.box[taken]
                box = track.box if len(track.box) == 7 else measured
            elif key in self._last:
                class_id, last = self._last[key]
                moved = np.concatenate([self._centre(track.box), last[2:]])
                box = measured = track.box if len(track.box) == 7 else moved
            else:
                continue  # it never took a detection, so that its class is unknown
            self._last[key] = class_id, box
            number = self._number.setdefault((key, class_id), len(self._number))
            detection = int(row[taken]) if taken >= 0 else -1
            reports.append(
                TrackReport(number, box, class_id, track.score, detection, measured)
            )
        return reports

    def _taken(
        self, answer: list[TrackRow], seen: OnlineDetections, group: int | None
    ) -> Ints:
        """The detection that each row took, -1 for none: the stated one, else the nearest free one, one to one."""
        taken = np.array(
            [-1 if row.detection is None else row.detection for row in answer],
            dtype=np.int64,
        )
        free = np.setdiff1d(np.arange(len(seen)), taken)
        unstated = np.array(
            [i for i, row in enumerate(answer) if row.detection is None], dtype=np.int64
        )
        if not len(free) or not len(unstated):
            return taken
        centre = np.array([self._centre(answer[i].box) for i in unstated])
        distance = np.linalg.norm(centre[:, None] - seen.box[None, free, :2], axis=-1)
        known = [
            self._last.get((self._piece, group, answer[i].id), (-1,))[0]
            for i in unstated
        ]
        other_class = np.array(
            [[k not in (-1, c) for c in seen.class_id[free].tolist()] for k in known]
        )
        cost = (
            distance + self._gate * other_class - 3 * self._gate
        )  # its own class first
        column = k_best(np.where(distance <= self._gate, cost, np.inf), 1)[1][0]
        taken[unstated] = np.append(free, -1)[column]
        return taken

    def _centre(self, box: Floats) -> Floats:
        """Centre [2] of a box [7] or of a rectangle [4], m."""
        return box[:2] if len(box) == 7 else self._view.centres(box)


def _update_of(tracker: _Updated | Update) -> Update:
    if isinstance(tracker, _Updated):
        return tracker.update
    if callable(tracker):
        return tracker
    raise SubmissionError(
        f"OnlineTracker got a {type(tracker).__name__} from its function, expected an object with update(detections), "
        "or a function of detections"
    )


def read_rows(answer: Any, detections: int, frame: int) -> list[TrackRow]:
    """The rows of an answer to ``detections`` boxes.

    Raises ShapeError that names the frame, the row and what is wrong with it, such as an id or a detection given twice.
    """
    where = f"frame {frame}: the tracker gave"
    if not isinstance(answer, Iterable) or isinstance(answer, str | bytes):
        raise ShapeError(f"{where} {_short(answer)}, expected a list of {FORM}")
    rows = [
        _row(row, detections, f"{where} {_short(row)} as row {place}:")
        for place, row in enumerate(answer)
    ]
    for name, count in Counter(row.id for row in rows).items():
        if count > 1:
            raise ShapeError(
                f"{where} id {name!r} twice, expected each id once; leave out what has no id yet"
            )
    for taken, count in Counter(row.detection for row in rows).items():
        if count > 1 and taken not in (None, -1):
            raise ShapeError(f"{where} detection {taken} to two tracks, expected one")
    return rows


def _row(row: Any, detections: int, where: str) -> TrackRow:
    try:
        name, given, score, *rest = row
        box = np.asarray(given, dtype=np.float64).reshape(-1)
        track = TrackRow(name, box, float(score), *(rest or [None]))
        hash(name)
    except (TypeError, ValueError):
        raise ShapeError(
            f"{where} expected {FORM}: a number or a text, 7 numbers or 4, a number, a row"
        ) from None
    taken, sizes = track.detection, box[4:]
    known = not rest or (
        isinstance(taken, int | np.integer) and not isinstance(taken, bool)
    )
    wrong = {
        f"the id is {name}, expected a number or a text; leave out what has no id yet": name
        is None
        or (isinstance(name, float) and np.isnan(name)),
        f"the box is {box.tolist()}, expected {_BOX}": len(box) not in (4, 7)
        or not np.isfinite(box).all()
        or not (sizes > 0).all(),
        f"the score is {track.score}, expected a finite number": not np.isfinite(
            track.score
        ),
        f"the detection is {_short(taken)}, expected -1 or one of the {detections} rows of the detections": not known
        or not -1 <= (taken if taken is not None else -1) < detections,
    }
    for problem in (text for text, found in wrong.items() if found):
        raise ShapeError(f"{where} {problem}")
    return track
