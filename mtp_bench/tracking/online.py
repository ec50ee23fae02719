"""An adapter for online trackers of other libraries.

Detections go in, ``(id, box, score)`` comes out.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
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
    select,
)
from .given import Histories, TrackReport
from .joint import k_best

_ROW_FORM = "(id, box, score) or (id, box, score, detection)"
_BOX_FORM = "x y z yaw l w h with sizes above 0, or x1 y1 x2 y2 in pixels, all finite"


@dataclass(frozen=True)
class BirdsEye:
    """Axis-aligned rectangles of boxes in a picture of the ground.

    They are for trackers of image boxes. ``scale``: pixels per metre; ``padding``:
    metres by which rectangles are larger on every side.

    Pixel (0, 0) is the origin of the observations' frame, so coordinates may be
    negative. The frame does not move with the ego where the env compensates its motion:
    what stands still stays where it is. Padding helps where objects move by more than
    their own size between two frames, which leaves no overlap.
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
        """Return the rectangles [D, 4] x1 y1 x2 y2, pixels, around boxes.

        ``box`` [D, 7]: x y z yaw l w h, metres and radians.
        """
        corners = bev_corners(np.asarray(box, dtype=np.float64))
        low = corners.min(axis=-2) - self.padding
        high = corners.max(axis=-2) + self.padding
        return self.scale * np.concatenate([low, high], axis=-1)

    def centres(self, rectangle: Floats) -> Floats:
        """Return centres [N, 2], metres, of rectangles [N, 4] in pixels.

        A rectangle and the box inside it have the same centre.
        """
        return (rectangle[..., :2] + rectangle[..., 2:]) / (2 * self.scale)


@dataclass(frozen=True, eq=False)
class OnlineDetections:
    """The detections of a frame, as an online tracker is given them."""

    box: Floats  # [D, 7] x y z yaw l w h, metres and radians
    # [D, 4] x1 y1 x2 y2 around the box, pixels of the adapter's `BirdsEye`
    rectangle: Floats
    class_id: Ints  # [D] index into task.classes
    score: Floats  # [D] as the detector gives it, a logit may be negative
    velocity: Floats  # [D, 2] m/s; zeros where it is not measured
    time: float  # s since the first frame
    dt: float  # s since the frame before

    def __len__(self) -> int:
        return len(self.box)

    def select(self, mask: Bools) -> Self:
        """Return the detections where ``mask`` [D]."""
        return select(self, mask)


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

    ``make`` is called with the task when a scene begins, and after a hole in time. It
    gives the tracker: an object with ``update(detections)``, or a function. That is
    called once per frame with `OnlineDetections`, and answers with a row for each of
    its tracks::

        (id, box, score)                  the detection that it took is found by place
        (id, box, score, detection)       it says so: a row of the detections, -1: none

    ``id``: anything hashable. It goes on after a gap, and stands for another identity
    in another class. ``box``: 7 numbers as in the detections, or 4 numbers of a
    rectangle. For a rectangle the track has the whole box of its detection, or its last
    box, moved to the rectangle's centre. A track that takes no detection (coasts) is
    kept as long as the tracker names it; one that never took any has no class, and is
    left out. ``score``: score of the track. It counts only until the track takes a
    detection: from then on the scores of its detections count.

    ``per_class``: a tracker for each class of the task, which sees the detections of
    that class alone. ``view``: how rectangles are drawn. ``gate``: m, BEV, up to which
    a track takes a detection that it did not name.

    Example: `Pipeline(OnlineTracker(lambda task: MyTracker()), KinematicPredictor(),
    KMeansSampler())`.

    Raises SubmissionError for what cannot be updated, and ShapeError, naming frame and
    row, for a wrong answer.
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
        self._make_tracker = make
        self._per_class = per_class
        self._view = view or BirdsEye()
        self._gate_m = gate

    def reset(self, task: Task) -> None:
        """Forget all tracks, and make new trackers."""
        self._task = task
        self._frame = -1
        self._segment = 0  # of the scene, between two holes in time
        # identity of a track's key in a class; the key: see `_reports`
        self._identities: dict[tuple[Hashable, int], int] = {}
        # class of each tracker; None: all classes
        self._tracker_classes: list[int | None] = [None]
        if self._per_class:
            self._tracker_classes = list(range(len(task.classes)))
        self._begin()

    def _begin(self) -> None:
        """Begin a scene with new trackers, also after a hole in time."""
        self._updates = [
            _update_of(self._make_tracker(self._task)) for _ in self._tracker_classes
        ]
        self._histories = Histories(self._task.past)
        # last class and box of each key
        self._last_states: dict[Hashable, tuple[int, Floats]] = {}

    def step(self, observation: Observation) -> Tracks:
        """Return the tracks that the tracker names after this frame."""
        self._frame += 1
        if self._task.after_hole(observation):
            self._segment += 1
            self._begin()
        rows = np.flatnonzero(observation["detection_valid"])
        detections = self._detections(observation, rows)
        reports: list[TrackReport] = []
        for tracker_class, update in zip(
            self._tracker_classes, self._updates, strict=True
        ):
            mask = np.ones(len(detections), dtype=bool)
            if tracker_class is not None:
                mask = detections.class_id == tracker_class
            answer = read_rows(
                update(detections.select(mask)), int(mask.sum()), self._frame
            )
            keys = [(self._segment, tracker_class, track.id) for track in answer]
            shown = detections.select(mask)  # not what the tracker may have changed
            reports += self._reports(answer, keys, shown, rows[mask])
        return self._histories.after(reports, observation["detection_score"])

    def _detections(self, observation: Observation, rows: Ints) -> OnlineDetections:
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
        keys: Sequence[Hashable],
        detections: OnlineDetections,
        rows: Ints,
    ) -> list[TrackReport]:
        """Return the rows of one tracker with their classes.

        ``keys``: (segment, class of the tracker, id) of each row of ``answer``.
        ``rows`` [D]: row in the observation of each detection.
        """
        reports = []
        taken_rows = self._taken_rows(answer, keys, detections).tolist()
        for track, key, taken in zip(answer, keys, taken_rows, strict=True):
            has_box = len(track.box) == 7
            if taken >= 0:
                class_id = int(detections.class_id[taken])
                measured = detections.box[taken]
                box = track.box if has_box else measured
                row = int(rows[taken])
            elif key in self._last_states:
                class_id, last_box = self._last_states[key]
                moved = np.concatenate([self._centre(track.box), last_box[2:]])
                box = track.box if has_box else moved
                measured = box
                row = -1
            else:
                continue  # it never took a detection, so that its class is unknown
            self._last_states[key] = class_id, box
            identity = self._identities.setdefault(
                (key, class_id), len(self._identities)
            )
            reports.append(
                TrackReport(identity, box, class_id, track.score, row, measured)
            )
        return reports

    def _taken_rows(
        self,
        answer: list[TrackRow],
        keys: Sequence[Hashable],
        detections: OnlineDetections,
    ) -> Ints:
        """Return the detection that each row took, -1 for none.

        A row takes the detection that it states; otherwise the nearest one that is
        free. No detection is taken twice.
        """
        stated = [-1 if row.detection is None else row.detection for row in answer]
        taken = np.array(stated, dtype=np.int64)
        free = np.setdiff1d(np.arange(len(detections)), taken)
        unstated = [i for i, row in enumerate(answer) if row.detection is None]
        if not len(free) or not unstated:
            return taken
        centre = np.array([self._centre(answer[i].box) for i in unstated])
        offset = centre[:, None] - detections.box[None, free, :2]
        distance = np.linalg.norm(offset, axis=-1)
        no_state = (-1, None)  # of a track that is new
        track_class = np.array(
            [self._last_states.get(keys[i], no_state)[0] for i in unstated]
        )[:, None]
        other_class = (track_class != -1) & (track_class != detections.class_id[free])
        # Its own class first. All costs are below 0, the cost of taking none.
        cost = distance + self._gate_m * other_class - 3 * self._gate_m
        allowed_cost = np.where(distance <= self._gate_m, cost, np.inf)
        _, row_to_column, _ = k_best(allowed_cost, k=1)
        # index -1 picks the appended -1
        taken[unstated] = np.append(free, -1)[row_to_column[0]]
        return taken

    def _centre(self, box: Floats) -> Floats:
        """Return the centre [2] of a box [7] or of a rectangle [4], m."""
        return box[:2] if len(box) == 7 else self._view.centres(box)


def _update_of(tracker: _Updated | Update) -> Update:
    if isinstance(tracker, _Updated):
        return tracker.update
    if callable(tracker):
        return tracker
    raise SubmissionError(
        f"OnlineTracker got a {type(tracker).__name__} from its function, expected an "
        "object with update(detections), or a function of detections"
    )


def read_rows(answer: Any, detection_count: int, frame: int) -> list[TrackRow]:
    """Read the rows of an answer to ``detection_count`` boxes.

    Raises ShapeError that names the frame, the row and what is wrong with it, such as
    an id or a detection given twice.
    """
    where = f"frame {frame}: the tracker gave"
    if not isinstance(answer, Iterable) or isinstance(answer, str | bytes):
        raise ShapeError(f"{where} {_short(answer)}, expected a list of {_ROW_FORM}")
    rows = [
        _track_row(row, detection_count, f"{where} {_short(row)} as row {place}:")
        for place, row in enumerate(answer)
    ]
    for track_id, count in Counter(row.id for row in rows).items():
        if count > 1:
            raise ShapeError(
                f"{where} id {track_id!r} twice, expected each id once; "
                "leave out what has no id yet"
            )
    for detection, count in Counter(row.detection for row in rows).items():
        if count > 1 and detection not in (None, -1):
            raise ShapeError(
                f"{where} detection {detection} to two tracks, expected one"
            )
    return rows


def _track_row(row: Any, detection_count: int, where: str) -> TrackRow:
    try:
        track_id, numbers, score, *stated = row
        box = np.asarray(numbers, dtype=np.float64).reshape(-1)
        track = TrackRow(track_id, box, float(score), *(stated or [None]))
        hash(track_id)
    except (TypeError, ValueError):
        raise ShapeError(
            f"{where} expected {_ROW_FORM}: "
            "a number or a text, 7 numbers or 4, a number, a row"
        ) from None
    if track_id is None or (isinstance(track_id, float) and np.isnan(track_id)):
        raise ShapeError(
            f"{where} the id is {track_id}, expected a number or a text; "
            "leave out what has no id yet"
        )
    is_box = len(box) in (4, 7) and np.isfinite(box).all() and (box[4:] > 0).all()
    if not is_box:
        raise ShapeError(f"{where} the box is {box.tolist()}, expected {_BOX_FORM}")
    if not np.isfinite(track.score):
        raise ShapeError(
            f"{where} the score is {track.score}, expected a finite number"
        )
    if stated:
        _require_row(stated[0], detection_count, where)
    return track


def _require_row(detection: Any, detection_count: int, where: str) -> None:
    """Raise ShapeError unless ``detection`` is -1 or a row of the detections."""
    is_whole = isinstance(detection, int | np.integer)
    is_row = is_whole and not isinstance(detection, bool)
    if not is_row or not -1 <= detection < detection_count:
        raise ShapeError(
            f"{where} the detection is {_short(detection)}, expected -1 or one of the "
            f"{detection_count} rows of the detections"
        )
