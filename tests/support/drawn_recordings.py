"""Recordings that hypothesis draws within what the layout of a dataset can hold."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mtp_bench.cards import Card
from mtp_bench.core import Floats

NAMES = (3, 7, 12, 20)  # of objects
PERSON = (0.6, 0.6, 1.75)  # m: nominal, where only places are known


class Row(NamedTuple):
    """A box x y z yaw l w h in the frame of reference of the scene."""

    frame: int
    name: int | str  # of the object
    kind: str  # the word of the files for its class
    box: Floats
    score: float = 1.0
    seen: bool = True  # by a sensor


@dataclass(frozen=True, eq=False)
class Recording:
    """What the files of a scene hold, rows in any order."""

    time: Floats  # [F] s from 0
    pose: Floats  # [F, 6] of the ego, x y z yaw pitch roll; the first one is at the origin
    truth: list[Row]
    detections: list[Row]

    def every(self, stride: int) -> "Recording":
        """Every n-th frame, which has a number of its own."""
        truth, detections = (
            [row._replace(frame=row.frame // stride) for row in rows if row.frame % stride == 0]
            for rows in (self.truth, self.detections)
        )
        return Recording(self.time[::stride], self.pose[::stride], truth, detections)

    @property
    def turn(self) -> Rotation:
        return Rotation.from_euler("ZYX", self.pose[:, 3:])

    def of(self, frame: int) -> list[Row]:
        return [row for row in self.truth if row.frame == frame]


@dataclass(frozen=True)
class Layout:
    """How the files of a dataset are written, and which recordings they can hold."""

    write: Callable[[Path, Recording], Path]  # returns the root of the dataset
    card: Callable[[Path], Card]
    scene: str
    kinds: Mapping[str, tuple[str, bool]]  # word of the files -> class, "" for skipped ones; neutral
    period: float  # s
    jitter: float = 0.0  # s, of the times
    people: bool = False  # places alone, on the grid of WILDTRACK
    level: bool = False  # the ego starts with a heading of 0
    own_frames: bool = False  # every frame has its own frame of reference
    marks_unseen: bool = True  # boxes without points are neutral
    least: int = 0  # objects and detections per frame
    stride: int = 1  # of the card
    detector: str = ""  # of stored detections
    scored: bool = True
    ahead: bool = False  # velocities look ahead too
    neutral_targets: bool = True


# ---- recordings
@st.composite
def recordings(draw: st.DrawFn, layout: Layout) -> Recording:
    objects = st.sets(st.sampled_from(NAMES), min_size=layout.least)
    present = draw(st.lists(objects, min_size=2 * layout.stride + 1, max_size=6))
    counts = draw(st.lists(st.integers(layout.least, 3), min_size=len(present), max_size=len(present)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    reported = [kind for kind, (name, neutral) in layout.kinds.items() if name and not neutral]
    kinds = dict(zip(NAMES, rng.choice(list(layout.kinds), len(NAMES)).tolist(), strict=True))
    kinds[NAMES[0]] = reported[0]
    present[0].add(NAMES[0])  # a scene needs some truth
    seen = dict(zip(NAMES, rng.random((len(NAMES), len(present))) < 0.7, strict=True))
    truth = [
        Row(t, name, kinds[name], make_box(rng, layout), seen=bool(seen[name][t]) or not layout.marks_unseen)
        for t, names in enumerate(present)
        for name in sorted(names)
    ]
    detections = [
        Row(t, 0, str(rng.choice(reported)), make_box(rng, layout), rng.uniform(0.2, 1) if layout.scored else 1.0)
        for t, count in enumerate(counts)
        for _ in range(count)
    ]
    time = layout.period * np.arange(len(present)) + rng.uniform(0, layout.jitter, len(present)) * (layout.jitter > 0)
    rows = [[table[i] for i in rng.permutation(len(table))] for table in (truth, detections)]
    return Recording(np.round(time - time[0], 6), make_poses(rng, len(present), layout), *rows)


def make_box(rng: np.random.Generator, layout: Layout) -> Floats:
    if layout.people:
        cell, side = rng.integers(0, (480, 1440)), rng.integers(20)
        if side < 2:  # often at a border
            cell[side] = (479, 1439)[side]
        return np.array([*(0.025 * cell - [3, 9]), PERSON[2] / 2, 0, *PERSON])
    return np.array([*rng.uniform(-20, 20, 2), *rng.uniform([-1, -3], [1, 3]), *rng.uniform(0.3, 6, 3)])


def make_poses(rng: np.random.Generator, frames: int, layout: Layout) -> Floats:
    """A drive of some metres on a road that is not level."""
    pose = np.cumsum(rng.uniform(-0.4, 0.4, (frames, 6)), axis=0)
    pose[:, 4:] = rng.uniform(-0.1, 0.1, (frames, 2))
    pose[:, :3] -= pose[0, :3]
    pose[:, 3] -= pose[0, 3] if layout.level else rng.uniform(-3, 3)
    return pose


def small_recording(layout: Layout, frames: int = 3) -> Recording:
    """One object that moves, and a detection of it, in every frame."""
    (kind, *_), frame = layout.kinds, np.arange(frames)
    box = np.tile([10.0, 4, 0.8, 0.5, 4, 2, 1.5], (frames, 1))
    if layout.people:
        box[:] = [5, 4, PERSON[2] / 2, 0, *PERSON]
    box[:, 0] -= 0.5 * frame
    rows = [Row(t, NAMES[0], kind, box[t]) for t in range(frames)]
    return Recording(layout.period * frame, np.zeros((frames, 6)), rows, rows)
