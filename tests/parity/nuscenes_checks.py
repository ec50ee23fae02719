"""Checks of a scene against the rows of the devkit's export."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from mtp_bench.cards import Card
from mtp_bench.scoring.targets import find_targets
from mtp_bench.types import Floats, Ints, Ragged, Scene
from tests.parity.nuscenes_export import Export, Indices, Numbers, Rows

TOLERANCE = 1e-6  # m, rad, s: the files have three to six decimals, only the noise of float64 arithmetic may pass
SPEED_TOLERANCE = 1e-5  # m/s: the devkit divides by differences of seconds since 1970, which float64 has to 2e-7 s
PAST_SECONDS = 2.15  # the devkit's past of 2 s may take 0.15 s more
YAW = 3  # column of a box


@dataclass(frozen=True)
class Check:
    """One line of the result: rows on both sides, rows without a counterpart, and how far the pairs differ."""

    what: str
    official: int
    ours: int
    unpaired: int = 0
    largest: float = 0.0
    unit: str | None = "m"  # None: only counted
    allowed: float = TOLERANCE

    @property
    def same(self) -> bool:
        """Whether every row has its counterpart, up to the tolerance."""
        return self.official == self.ours and self.unpaired == 0 and self.largest <= self.allowed

    def __add__(self, other: Check) -> Check:
        return replace(
            self,
            official=self.official + other.official,
            ours=self.ours + other.ours,
            unpaired=self.unpaired + other.unpaired,
            largest=max(self.largest, other.largest),
        )


def pair(one: Rows, other: Rows) -> tuple[Indices, Indices]:
    """Rows of both sides that belong together: nearest within frame and class, each used once."""
    left, right = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    group, other_group = one.frame * 100 + one.kind, other.frame * 100 + other.kind
    for key in np.intersect1d(group, other_group):
        i, j = np.flatnonzero(group == key), np.flatnonzero(other_group == key)
        cost = difference(one.value[i][:, None], other.value[j][None]).max(axis=-1)
        a, b = linear_sum_assignment(np.minimum(cost, 100.0))
        left.append(i[a])
        right.append(j[b])
    return np.concatenate(left), np.concatenate(right)


def difference(one: Numbers, other: Numbers) -> Numbers:
    """Absolute differences of boxes; of the yaw, the smaller way round."""
    gap = np.abs(one - other)
    gap[..., YAW] = np.abs((gap[..., YAW] + np.pi) % (2 * np.pi) - np.pi)
    return gap


def largest(values: Numbers) -> float:
    """Largest value, 0 of none; infinite where one is not a number."""
    return float(np.nan_to_num(values, nan=np.inf).max(initial=0.0))


def box_checks(what: str, official: Rows, ours: Rows) -> list[Check]:
    """Checks of the metric columns, of the yaw and, where there is one, of the score."""
    i, j = pair(official, ours)
    gap = difference(official.value[i], ours.value[j])
    counts = Check(what, len(official.frame), len(ours.frame), len(official.frame) + len(ours.frame) - 2 * len(i))
    checks = [
        replace(counts, largest=largest(np.delete(gap[:, :7], YAW, axis=1))),
        replace(counts, what=f"{what}: yaw", largest=largest(gap[:, YAW]), unit="rad"),
    ]
    if gap.shape[1] > 7:
        checks.append(replace(counts, what=f"{what}: score", largest=largest(gap[:, 7]), unit=""))
    return checks


def pose_checks(export: Export, scene: Scene) -> list[Check]:
    """Keyframes, their times since the first one, and ego poses."""
    time, ego = export.samples(scene.name)
    counts = Check("ego poses", len(time), scene.frames, abs(len(time) - scene.frames))
    if len(time) != scene.frames:
        return [counts]
    gap = difference(ego, np.asarray(scene.ego, dtype=np.float64))
    late = np.abs((time - time[0]) / 1e6 - (scene.time - scene.time[0]))
    return [
        replace(counts, what="time stamps", largest=largest(late), unit="s"),
        replace(counts, largest=largest(gap[:, :YAW])),
        replace(counts, what="ego poses: yaw", largest=largest(gap[:, YAW]), unit="rad"),
    ]


def truth_checks(export: Export, scene: Scene) -> list[Check]:
    """True boxes, which of them are neutral, and whether our objects are the devkit's instances."""
    official, instance, beside = export.truth(scene.name, scene.listed_targets)
    truth = scene.truth
    ours = rows_of(truth.start, truth.class_id, truth.box, np.arange(len(truth.box)))
    i, j = pair(official, ours)
    neutral = Check("true boxes: neutral", int(beside.sum()), int(truth.neutral.sum()), unit=None)
    object_id = np.asarray(truth.object_id)
    links = set(zip(instance[i].tolist(), object_id[j].tolist(), strict=True))
    objects = Check("objects", len(np.unique(instance)), len(np.unique(object_id)), unit=None)
    # one object that is two instances, or two that are one, has a link too many
    tangled = abs(2 * len(links) - objects.official - objects.ours)
    return [
        *box_checks("true boxes", official, ours),
        replace(neutral, unpaired=int((beside[i] != truth.neutral[j]).sum())),
        replace(objects, unpaired=tangled),
    ]


def rows_of(start: Ints, kind: Ints, value: Floats, row: Ints) -> Rows:
    """Some rows of a ragged table."""
    at = np.asarray(row, dtype=np.int64)
    frame = np.asarray(Ragged(np.asarray(start)).frame_of_rows, dtype=np.int64)
    return Rows(frame[at], np.asarray(kind, dtype=np.int64)[at], np.asarray(value, dtype=np.float64)[at])


def detection_checks(export: Export, scene: Scene, detector: str) -> list[Check]:
    """Detections of a detector."""
    found = scene.detections
    value = np.column_stack([found.box, found.score])
    ours = rows_of(found.start, found.class_id, value, np.arange(len(value)))
    return box_checks(f"detections of {detector}", export.detections(detector, scene.name), ours)


def target_checks(export: Export, scene: Scene, card: Card) -> list[Check]:
    """Targets, their futures, pasts and speeds."""
    official, future, past, speed = export.targets(scene.name)
    found = find_targets(scene, card)
    ours = rows_of(scene.truth.start, scene.truth.class_id, scene.truth.box, found.row)
    i, j = pair(official, ours)
    counts = Check("futures", len(official.frame), len(found), len(official.frame) + len(found) - 2 * len(i))
    ahead = np.abs(future[i] - found.future[j])
    behind, ours_behind = past[i], past_positions(scene, found.row[j], past.shape[1])
    now = np.linalg.norm(scene.truth.velocity[found.row[j]], axis=-1)
    return [
        box_checks("targets", official, ours)[0],
        replace(counts, largest=largest(ahead)),
        replace(counts, what="pasts", largest=gap_where_known(behind, ours_behind)),
        replace(counts, what="speeds", largest=gap_where_known(speed[i], now), unit="m/s", allowed=SPEED_TOLERANCE),
    ]


def gap_where_known(one: Numbers, other: Numbers) -> float:
    """Largest difference where one side has a number; infinite where the other has none."""
    neither = np.isnan(one) & np.isnan(other)
    return largest(np.where(neither, 0.0, np.abs(one - other)))


def past_positions(scene: Scene, rows: Ints, length: int) -> Numbers:
    """Positions [n, length, 2] of the objects of ``rows`` in the 2 s before, the latest first, NaN past their end."""
    truth, frame = scene.truth, scene.truth.frame_of_rows
    positions = np.full((len(rows), length, 2), np.nan)
    for n, row in enumerate(rows):
        since = scene.time[frame[row]] - scene.time[frame[:row]]
        before = np.flatnonzero((truth.object_id[:row] == truth.object_id[row]) & (since < PAST_SECONDS))
        before = before[::-1][:length]
        positions[n, : len(before)] = truth.box[before, :2]
    return positions
