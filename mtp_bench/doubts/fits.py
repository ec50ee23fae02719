"""Causes of the misfit between detections and truth, which compete.

Each is fitted alone, by few parameters: an offset, a box given by its rear axle and a
delay look alike, and limits of separate statistics would confuse them.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ..core import Bools, Detections, Floats, Truth, rotate, starts_of_sorted
from .maps import (
    PlaneMap,
    fixed_maps,
    later_offset,
    offset_ego,
    offset_world,
    pose_late,
    scale,
    turn,
)
from .recording import NEVER, TOLERANCE_GATES, RecordedScene
from .signs import Sign, Undo, mean_of_others

_PAIR_GATES = (3.0, 2.0, 1.0, 0.5)  # from far pairs inwards
_STEPS = 2  # of each fit at a distance
_PROBE = 1e-3  # change of a parameter, for slopes
_OFFSET_STEPS_M = (0.0, -4.0, -2.0, 2.0, 4.0)
_OFFSETS_M = np.stack(np.meshgrid(_OFFSET_STEPS_M, _OFFSET_STEPS_M), -1).reshape(-1, 2)
_MOST_FRAMES = 0.9  # share of the clear frames, from which all have a fixed map
_FRAME_GAIN = 0.3  # of misfit that a fixed map takes from a frame
_PARAMETER_GAIN = 0.003  # of misfit that another parameter must gain
_MIN_GAIN = 0.01  # of misfit, below which a fit explains nothing
_MOST_LEFT = 0.9  # misfit, above which nothing is explained
_MIN_OTHERS_GAIN = 0.005  # without the object that gains most
_MIN_LATE_FRAMES = 0.15
_MIN_OBJECTS = 2
_FEW_OBJECTS = 4  # below which a fit must gain more
_STRONG_GAIN = 0.2
_MIN_FRAMES = 3
_MIN_TURN_RAD = 0.3  # of headings, below which a point of the box is an offset
_MIN_PAIRS = 20
_SPLITS = 14  # of a scene, at which an offset may begin
_BY_GAIN = ("late", "pose_late")  # kinds whose value is the gain
_POWER_FRAMES = 0.5
_POWER_M = 0.5
_POWER_DEGREES = 2.0

Predict = Callable[[Floats], Floats]
UndoWith = Callable[[Floats], Undo]


class CauseFits:
    """True boxes beside their nearest detections."""

    def __init__(self, recording: RecordedScene) -> None:
        self.recording = recording
        truth = recording.truth
        self.rows = recording.sample
        self.xy = truth.box[self.rows, :2]
        self.frame = truth.frame_of_rows[self.rows]
        self.class_id = truth.class_id[self.rows]
        self.gate = recording.gate[self.class_id]
        self.object_id = truth.object_id[self.rows]
        self.objects = len(np.unique(self.object_id))
        self.losses = self._losses(self.xy)
        self.misfit = _mean(self.losses)  # of the true boxes as they are, in [0, 1]

    @property
    def near_share(self) -> float:
        """Share of the true boxes with a detection of their class within a gate."""
        reach = float(self.gate.max(initial=0.0))
        places = (self.xy, self.frame, self.class_id)
        distance, _ = self.recording.detected.nearest(*places, reach)
        return _mean(distance <= self.gate)

    @property
    def apart(self) -> float:
        """Share of the true boxes without a detection near; 0 if there are few."""
        is_large = min(len(self.xy), len(self.recording.detections.box)) >= _MIN_PAIRS
        return (1.0 - self.near_share) * is_large

    def signs(self) -> Iterator[Sign]:
        """Yield all causes, each as well as it fits."""
        is_short = self.recording.frames < _MIN_FRAMES
        has_rows = self.objects >= _MIN_OBJECTS and len(self.recording.detections.box)
        if is_short or not has_rows:
            return
        yield self._late()
        if np.ptp(self.recording.truth.box[self.rows, 3]) > _MIN_TURN_RAD:
            yield self._box_point()
        yield from self._moved()
        yield from self._fixed()

    def powers(self) -> dict[str, bool]:
        """Return which small faults would raise the misfit by enough to be told."""
        ego = self.recording.ego
        ahead = offset_ego(np.array([_POWER_M, 0.0]), ego)
        turned = turn(np.array([np.radians(_POWER_DEGREES)]), ego)
        seconds = _POWER_FRAMES * self.recording.period
        places = {
            f"a delay of {seconds:.2g} s": self._places_later(-_POWER_FRAMES),
            f"an offset of {_POWER_M:g} m": ahead.places(self.xy, self.frame),
            f"a turn of {_POWER_DEGREES:g}°": turned.places(self.xy, self.frame),
        }
        return {
            text: _mean(self._losses(xy)) > self.misfit + _MIN_GAIN
            for text, xy in places.items()
        }

    def _losses(self, xy: Floats) -> Floats:
        return self.recording.losses(xy, self.frame, self.class_id)

    def _places_later(self, frames_later: float) -> Floats:
        return self.recording.motion.places(self.rows, frames_later)

    def _late(self) -> Sign:
        """Return by how many frames detections are late; below 0: early."""

        def predict(values: Floats) -> Floats:
            return self._places_later(-float(values[0]))

        def undo(values: Floats) -> Undo:
            return partial(self._on_time, float(values[0]))

        return self._fitted("late", predict, np.arange(-3.0, 3.1, 0.5)[:, None], undo)

    def _box_point(self) -> Sign:
        """Return which point of the box detections give, in lengths and widths."""
        box = self.recording.truth.box[self.rows]
        corners = np.stack(np.meshgrid([0.0, -0.5, 0.5], [0.0, -0.5, 0.5]), axis=-1)

        def predict(values: Floats) -> Floats:
            return self.xy + _from_center(box, values)

        def undo(values: Floats) -> Undo:
            return partial(_centered, values)

        sign = self._fitted("box_point", predict, corners.reshape(-1, 2), undo)
        size_m = np.hypot(*(np.array(sign.values) * np.median(box[:, 4:6], axis=0)))
        return replace(sign, size=float(size_m), value=float(size_m) * (sign.value > 0))

    def _moved(self) -> Iterator[Sign]:
        """Yield small mistakes of place."""
        ego = self.recording.ego
        yield self._mapped("offset", offset_ego, _OFFSETS_M)
        if np.ptp(ego[:, 3]) > _MIN_TURN_RAD:
            yield self._mapped("world_offset", offset_world, _OFFSETS_M)
        yield from self._moved_later()
        degrees = np.arange(-180.0, 180.0, 10.0)
        yield self._mapped("turn", turn, np.radians(degrees)[:, None])
        shares = np.array([0.0, -0.5, -0.3, -0.1, -0.03, 0.03, 0.1, 0.4, 1.0])
        yield self._mapped("scale", scale, shares[:, None])
        if self.recording.has_ego:
            frames = np.array([0.0, -1.0, -0.5, 0.5, 1.0])
            yield self._mapped("pose_late", pose_late, frames[:, None])

    def _moved_later(self) -> Iterator[Sign]:
        """Yield the offset that changes within the scene, where it fits best."""
        losses = np.stack([self._losses(self.xy + offset) for offset in _OFFSETS_M])
        last = self.recording.frames - 1
        fits = []
        for first in np.unique(np.linspace(2, last - 1, _SPLITS).astype(int)).tolist():
            parts = (self.frame < first, self.frame >= first)
            if first < 2 or min(part.sum() for part in parts) < _MIN_PAIRS:
                continue
            sums = [losses[:, part].sum(axis=1) for part in parts]
            start = np.concatenate([_OFFSETS_M[each.argmin()] for each in sums])
            fits.append((sums[0].min() + sums[1].min(), first, start))
        if fits:
            _, first, start = min(fits, key=lambda fit: fit[0])
            make = partial(later_offset, first)
            sign = self._mapped("later_offset", make, start[None])
            yield replace(sign, first=first, last=last)

    def _mapped(
        self,
        kind: str,
        make: Callable[[Floats, Floats], PlaneMap],
        starts: Floats,
    ) -> Sign:
        ego = self.recording.ego

        def predict(values: Floats) -> Floats:
            return make(values, ego).places(self.xy, self.frame)

        def undo(values: Floats) -> Undo:
            back = make(values, ego).inverse()
            return partial(_remapped, "detections", back, np.ones(len(ego), dtype=bool))

        return self._fitted(kind, predict, starts, undo)

    def _fitted(
        self, kind: str, predict: Predict, starts: Floats, undo: UndoWith
    ) -> Sign:
        """Return a cause with the parameters that fit best.

        ``starts`` [k, p]: parameters to begin with. The value of the sign is 0 unless
        the cause explains something.
        """
        misfits = [_mean(self._losses(predict(values))) for values in starts]
        best = int(np.argmin(misfits))
        values, after = self._refined(predict, starts[best], misfits[best])
        size = _size(kind, values)
        gain = self.misfit - after
        value = gain if kind in _BY_GAIN else abs(size)
        is_short = kind in _BY_GAIN and abs(size) < _MIN_LATE_FRAMES
        is_weak = self.objects < _FEW_OBJECTS and gain < _STRONG_GAIN
        row_gain = self.losses - self._losses(predict(values))
        is_weak |= mean_of_others(row_gain, self.object_id) < _MIN_OTHERS_GAIN
        is_weak |= gain < _MIN_GAIN or after > _MOST_LEFT
        if is_short or is_weak:
            value = 0.0
        return Sign(
            kind,
            value,
            size,
            values=tuple(values.tolist()),
            before=self.misfit,
            after=after,
            undo=undo(values),
        )

    def _refined(
        self, predict: Predict, start: Floats, misfit: float
    ) -> tuple[Floats, float]:
        """Return better parameters, and the misfit with them."""
        best = start
        values = start
        for gates in _PAIR_GATES:
            for _ in range(_STEPS):
                values = values + self._step(predict, values, gates)
            after = _mean(self._losses(predict(values)))
            if after < misfit:
                best = values
                misfit = after
        return best, misfit

    def _step(self, predict: Predict, values: Floats, gates: float) -> Floats:
        """Return the change of the parameters that brings pairs together."""
        xy = predict(values)
        reach = gates * self.gate
        largest = float(reach.max())
        distance, row = self.recording.detected.nearest(
            xy, self.frame, self.class_id, largest
        )
        pair = np.flatnonzero((row != NEVER) & (distance < reach))
        if len(pair) < 2:
            return np.zeros_like(values)
        missing = self.recording.detections.box[row[pair], :2] - xy[pair]
        slopes = []
        for change in _PROBE * np.eye(len(values)):
            moved = predict(values + change)[pair] - xy[pair]
            slopes.append(moved.ravel() / _PROBE)
        slope = np.column_stack(slopes)
        share = distance[pair] / (TOLERANCE_GATES * self.gate[pair])
        weight = np.repeat(1.0 / np.sqrt(1.0 + share**2), 2)
        solution = np.linalg.lstsq(slope * weight[:, None], missing.ravel() * weight)
        return np.asarray(solution[0])

    def _fixed(self) -> Iterator[Sign]:
        """Yield the fixed mistakes, each in the frames that it makes better."""
        frames = self.recording.frames
        count = np.bincount(self.frame, minlength=frames)
        before = np.bincount(self.frame, self.losses, frames)
        for kind, variant, made in fixed_maps(self.recording.ego):
            if not made.changes:
                continue
            zoom = float(np.sqrt(abs(np.linalg.det(made.matrix[0]))))
            places = made.places(self.xy, self.frame)
            loss = self.recording.losses(places, self.frame, self.class_id, zoom)
            after = np.bincount(self.frame, loss, frames)
            gain = (before - after) / np.maximum(count, 1)
            has = gain > _FRAME_GAIN
            share = float(has.sum() / np.count_nonzero(count))
            # frames with few objects follow those that are clear
            has |= has.sum() > _MOST_FRAMES * np.count_nonzero(
                np.abs(gain) > _FRAME_GAIN
            )
            undo = partial(_remapped, "detections", made.inverse(), has)
            if kind.startswith("truth"):
                undo = partial(_remapped, "truth", made, has)
            yield Sign(
                kind,
                share,
                variant=variant,
                before=self.misfit,
                after=float(np.where(has, after, before).sum() / count.sum()),
                undo=undo,
            )

    def _on_time(self, late: float, recording: RecordedScene) -> RecordedScene:
        """Undo a delay: whole frames by their numbers, the rest along the motion."""
        detections = recording.detections
        # half a frame is undone without the loss of a frame at the end
        whole = int(np.sign(late) * np.floor(abs(late) + 0.25))
        if abs(late - whole) < _MIN_LATE_FRAMES:
            late = whole
        truth = self.recording.truth
        motion = self.recording.motion
        rows = np.arange(len(truth.box))
        xy = motion.places(rows, -late)
        _, row = self.recording.detected.nearest(
            xy, truth.frame_of_rows, truth.class_id, float(self.gate.max())
        )
        seen = row != NEVER
        box = detections.box.copy()
        box[row[seen], :2] += (motion.places(rows, -whole) - xy)[seen]
        frame = detections.frame_of_rows - whole
        kept = (frame >= 0) & (frame < self.recording.frames)
        start = starts_of_sorted(frame[kept], self.recording.frames)
        moved = replace(detections, box=box).select(kept)
        return recording.with_rows(replace(moved, start=start))


def penalty(sign: Sign) -> float:
    """Return the misfit that a cause leaves, and what its parameters must gain."""
    return sign.after + _PARAMETER_GAIN * len(sign.values)


def _mean(values: Floats | Bools) -> float:
    return float(values.mean()) if len(values) else 0.0


def _size(kind: str, values: Floats) -> float:
    """Return the size of a cause: m, frames, degrees or percent."""
    if kind == "turn":
        return float(np.degrees(values[0]))
    if kind == "scale":
        return float(100.0 * values[0])
    if kind == "later_offset":
        return float(np.hypot(*(values[2:] - values[:2])))
    return float(np.hypot(*values)) if len(values) > 1 else float(values[0])


def _remapped(
    part: str, made: PlaneMap, has: Bools, recording: RecordedScene
) -> RecordedScene:
    """Map truth or detections in the frames [F] that need it."""
    rows: Truth | Detections = getattr(recording, part)
    frame = rows.frame_of_rows
    mapped = has[frame, None]
    box = np.where(mapped, made.boxes(rows.box, frame), rows.box)
    velocity = np.where(mapped, made.turned(rows.velocity, frame), rows.velocity)
    return recording.with_rows(replace(rows, box=box, velocity=velocity))


def _centered(values: Floats, recording: RecordedScene) -> RecordedScene:
    """Return detections by their centres that were given by another point."""
    detections = recording.detections
    box = detections.box.copy()
    box[:, :2] -= _from_center(box, values)
    return recording.with_rows(replace(detections, box=box))


def _from_center(box: Floats, values: Floats) -> Floats:
    """Return the way [n, 2] to a point of boxes, given in lengths and widths, m."""
    return rotate(values * box[:, 4:6], box[:, 3])
