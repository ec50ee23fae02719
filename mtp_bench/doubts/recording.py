"""A scene as the doctor reads it: rows in the world, motion, and nearest detections."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

from ..cards import Card
from ..core import (
    Bools,
    Detections,
    Floats,
    Ints,
    Scene,
    Truth,
    pieces_of,
    rotate,
)
from ..sources import in_world

NEVER = -1  # in place of a row
_GROUP_GAP_M = 1e5  # between rows of two frames or classes in the search tree
TOLERANCE_GATES = 0.2  # distance from which a misfit grows slower
_REACH_GATES = 2.0  # distance from which a detection is of another object
_MAX_ROWS = 600  # true boxes that are compared with detections


class Places:
    """Places of rows, to be searched within their frame and class."""

    def __init__(self, xy: Floats, frame: Ints, class_id: Ints) -> None:
        self._tree = KDTree(_keys(xy, frame, class_id))

    def nearest(
        self, xy: Floats, frame: Ints, class_id: Ints, reach_m: float
    ) -> tuple[Floats, Ints]:
        """Return distances [n] to the nearest rows, m, and these rows.

        Distances are inf, and rows `NEVER`, beyond ``reach_m``.
        """
        keys = _keys(xy, frame, class_id)
        distance, row = self._tree.query(keys, distance_upper_bound=reach_m)
        return distance, np.where(np.isfinite(distance), row, NEVER)

    def pairs(self, distance_m: float) -> Ints:
        """Return pairs [n, 2] of rows that are not further apart."""
        return np.asarray(self._tree.query_pairs(distance_m, output_type="ndarray"))


def _keys(xy: Floats, frame: Ints, class_id: Ints) -> Floats:
    """Return places [n, 4] in which frames and classes are far apart."""
    return np.column_stack([xy, _GROUP_GAP_M * frame, _GROUP_GAP_M * class_id])


@dataclass(frozen=True, eq=False)
class RecordedScene:
    """A scene in one frame of reference, with what its card says about it."""

    scene: Scene
    card: Card

    @classmethod
    def of(cls, scene: Scene, card: Card) -> "RecordedScene":
        """Return the recording of a scene of a card."""
        if scene.world is not None:  # lanes are as seen in each frame
            scene = replace(in_world(scene), lanes=())
        return cls(scene, card)

    @property
    def truth(self) -> Truth:
        """True boxes [R], sorted by frame."""
        return self.scene.truth

    @property
    def detections(self) -> Detections:
        """Detections [D], sorted by frame."""
        return self.scene.detections

    @property
    def ego(self) -> Floats:
        """Poses of the ego [F, 4], x y z yaw."""
        return self.scene.ego

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return self.scene.frames

    @property
    def period(self) -> float:
        """Time between two frames of the task, s."""
        return 1.0 / self.card.task.rate

    @cached_property
    def gate(self) -> Floats:
        """Distance to a detection of the same object, by class [C], m."""
        return np.array(self.card.per_class(self.card.task.forecast_gate))

    @cached_property
    def has_ego(self) -> bool:
        """True if a vehicle that moves carries the sensors."""
        return self.card.has_ego and bool(np.ptp(self.ego[:, :2], axis=0).any())

    def object_name(self, object_id: int) -> str:
        """Return the name of an object: "car 8"; empty for no object."""
        rows = np.flatnonzero(self.truth.object_id == object_id)
        if not len(rows):
            return ""
        class_name = self.card.task.classes[self.truth.class_id[rows[0]]]
        return f"{class_name.replace('_', ' ')} {self.scene.short_name(object_id)}"

    def with_rows(self, rows: Truth | Detections) -> "RecordedScene":
        """Return the recording with other truth, or other detections."""
        if isinstance(rows, Truth):
            return replace(self, scene=replace(self.scene, truth=rows))
        return replace(self, scene=replace(self.scene, detections=rows))

    def is_of(self, class_id: Ints, names: tuple[str, ...]) -> Bools:
        """Return marks [n] of classes that have one of the names."""
        return np.isin(np.array(self.card.task.classes)[class_id], names)

    @cached_property
    def motion(self) -> "Motion":
        """Tracks of the true objects."""
        return Motion(self.scene, self.period)

    @cached_property
    def sample(self) -> Ints:
        """True rows [n] that are compared with detections, spread over the scene."""
        rows = np.flatnonzero(~self.truth.neutral)
        stride = max(1, -(-len(rows) // _MAX_ROWS))
        return rows[::stride]

    @cached_property
    def detected(self) -> Places:
        """Places of the detections."""
        rows = self.detections
        return Places(rows.box[:, :2], rows.frame_of_rows, rows.class_id)

    def losses(
        self, xy: Floats, frame: Ints, class_id: Ints, zoom: float = 1.0
    ) -> Floats:
        """Return how badly places [n] fit their nearest detection, in [0, 1].

        0: there is one exactly there; 1: none within `_REACH_GATES`. ``zoom``: how
        much longer a metre is in these places.
        """
        gate = zoom * self.gate[class_id]
        reach = _REACH_GATES * gate
        largest = float(reach.max(initial=0.0))
        distance, _ = self.detected.nearest(xy, frame, class_id, largest)
        share = np.minimum(distance, reach) / (TOLERANCE_GATES * gate)
        most = _REACH_GATES / TOLERANCE_GATES
        return np.asarray(np.log1p(share**2) / np.log1p(most**2))


class Motion:
    """Tracks of true objects: their rows by object and frame, places between frames."""

    def __init__(self, scene: Scene, period: float) -> None:
        truth = scene.truth
        frame = truth.frame_of_rows
        order = np.lexsort((frame, truth.object_id))
        self.stride = scene.annotated_step  # frames between two rows of an object
        self.scene_time = scene.time
        self.object_id = truth.object_id[order]
        self.frame = frame[order]
        self.time = scene.time[self.frame]
        self.piece = pieces_of(scene.time, period)[self.frame]
        self.xy = truth.box[order, :2]
        self.yaw = truth.box[order, 3]
        self.class_id = truth.class_id[order]
        _, self.number = np.unique(self.object_id, return_inverse=True)
        self._rank = np.argsort(order)  # place of each row

    @cached_property
    def joined(self) -> Bools:
        """Marks [n - 1] of neighbouring rows of one object, without a hole in time."""
        return np.asarray((np.diff(self.number) == 0) & (np.diff(self.piece) == 0))

    @cached_property
    def steady(self) -> Bools:
        """Marks [n - 1] of rows that the next annotated frame follows."""
        return np.asarray(self.joined & (np.diff(self.frame) == self.stride))

    @cached_property
    def step(self) -> Floats:
        """Lengths [n - 1] of the steps to the next row, m; NaN between objects."""
        length = np.hypot(*np.diff(self.xy, axis=0).T)
        return np.where(self.joined, length, np.nan)

    @cached_property
    def velocity(self) -> Floats:
        """Velocities [n, 2] m/s, by the neighbouring frames; NaN for a single row."""
        later = self._clipped(1.0)
        earlier = self._clipped(-1.0)
        moved = self._between(later) - self._between(earlier)
        time = self.scene_time
        seconds = time[later.astype(int)] - time[earlier.astype(int)]
        return np.asarray(moved / np.where(seconds > 0, seconds, np.nan)[:, None])

    @cached_property
    def speed(self) -> Floats:
        """Speeds [n] m/s; 0 for a single row."""
        return np.asarray(np.nan_to_num(np.hypot(*self.velocity.T)))

    @cached_property
    def course(self) -> Floats:
        """Directions of motion [n], rad."""
        return np.asarray(np.arctan2(self.velocity[:, 1], self.velocity[:, 0]))

    def places(self, rows: Ints, frames_later: float) -> Floats:
        """Return where the objects of true rows [n] are some frames later, m [n, 2].

        Between frames on straight lines, beyond a track at its end.
        """
        if not len(rows):
            return np.empty((0, 2))
        return self._between(self._clipped(frames_later))[self._rank[rows]]

    def _clipped(self, frames_later: float) -> Floats:
        """Return frames [n] later, within the tracks."""
        first, last = self.frame[self.spans[self.number]].T
        return np.asarray(np.clip(self.frame + frames_later, first, last))

    def _between(self, frame: Floats) -> Floats:
        """Return the places [n, 2] of the objects in frames [n] of their tracks."""
        span = float(self.frame.max(initial=0)) + 1.0
        known = self.number * span + self.frame
        wanted = self.number * span + frame
        return np.stack([np.interp(wanted, known, axis) for axis in self.xy.T], axis=-1)

    @cached_property
    def spans(self) -> Ints:
        """First and last row [objects, 2] of each object."""
        first = np.flatnonzero(np.diff(self.number, prepend=NEVER))
        last = np.flatnonzero(np.diff(self.number, append=NEVER))
        return np.column_stack([first, last])


def to_ego(xy: Floats, pose: Floats) -> Floats:
    """Return places [n, 2] as seen from poses [n, 4] x y z yaw."""
    return rotate(xy - pose[:, :2], -pose[:, 3])


def from_ego(xy: Floats, pose: Floats) -> Floats:
    """Return places [n, 2] that are seen from poses [n, 4], in the world."""
    return rotate(xy, pose[:, 3]) + pose[:, :2]
