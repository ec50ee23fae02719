"""A plain single-hypothesis tracker, written from its description alone, with dictionaries and textbook matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from mtp_bench.tracking import ClassParameters
from mtp_bench.types import Floats, Ints
from tests.support.plain_geometry import giou_3d

MOVE = np.eye(10) + np.eye(10, k=7)  # x += vx, y += vy, z += vz
SEE = np.eye(7, 10)
PROCESS = np.diag([1.0] * 7 + [0.01] * 3)
AT_BIRTH = np.diag([10.0] * 7 + [10_000.0] * 3)

Track = dict[str, Any]  # id, class, x [10], P [10, 10], hits, age, past: {frame: box}


class HungarianTracker:
    """AB3DMOT by the book; ``greedy`` asks for greedy assignment where the parameters say so."""

    def __init__(self, parameters: tuple[ClassParameters, ...], greedy: bool = False) -> None:
        self.parameters = parameters
        self.greedy = greedy
        self.tracks: list[Track] = []
        self.frame = 0
        self.born = 0

    def step(self, boxes: Floats, classes: Ints) -> list[Track]:
        """Tracks to output; ``detection`` is what each took in this frame, -1 for none."""
        self.frame += 1
        for track in self.tracks:
            track["x"] = MOVE @ track["x"]
            track["P"] = MOVE @ track["P"] @ MOVE.T + PROCESS
            track["detection"] = -1
            track["age"] += 1
        for row, column in self.pairs(boxes, classes):
            self.update(self.tracks[row], boxes[column])
            self.tracks[row]["detection"] = column
        taken = {track["detection"] for track in self.tracks}
        for column in range(len(boxes)):
            if column not in taken:
                self.tracks.append(self.new(boxes[column], int(classes[column]), column))
        self.tracks = [t for t in self.tracks if t["age"] < self.parameters[t["class"]].max_age]
        for track in self.tracks:
            if track["detection"] >= 0:
                track["past"][self.frame] = boxes[track["detection"]]
        return [t for t in self.tracks if self.confirmed(t)]

    def confirmed(self, track: Track) -> bool:
        enough = self.parameters[track["class"]].min_hits
        return bool(track["hits"] >= enough or self.frame <= enough)

    def new(self, box: Floats, class_id: int, column: int) -> Track:
        self.born += 1
        return {
            "id": self.born - 1, "class": class_id, "x": np.concatenate([box, np.zeros(3)]), "P": AT_BIRTH, "hits": 1,
            "age": 0, "detection": column, "past": {},
        }  # fmt: skip

    def update(self, track: Track, box: Floats) -> None:
        z, x = box.copy(), track["x"]
        while abs(z[3] - x[3]) > np.pi / 2:  # nearest of the two directions of the box's axis
            z[3] -= np.pi * np.sign(z[3] - x[3])
        gain = track["P"] @ SEE.T @ np.linalg.inv(SEE @ track["P"] @ SEE.T + np.eye(7))
        x = x + gain @ (z - SEE @ x)
        x[3] = np.arctan2(np.sin(x[3]), np.cos(x[3]))
        track["x"], track["P"] = x, (np.eye(10) - gain @ SEE) @ track["P"]
        track["hits"] += 1
        track["age"] = 0

    def pairs(self, boxes: Floats, classes: Ints) -> list[tuple[int, int]]:
        """(track, detection) of every match, class by class."""
        result = []
        for class_id, rule in enumerate(self.parameters):
            rows = [i for i, t in enumerate(self.tracks) if t["class"] == class_id]
            columns = np.flatnonzero(classes == class_id).tolist()
            gain = np.array([[self.gain(self.tracks[i], boxes[j], rule) for j in columns] for i in rows])
            if gain.size:
                greedy = self.greedy and rule.assignment == "greedy"
                match = greedy_pairs(gain) if greedy else hungarian_pairs(gain)
                result += [(rows[i], columns[j]) for i, j in match]
        return result

    def gain(self, track: Track, box: Floats, rule: ClassParameters) -> float:
        mine = track["x"][:7]
        if rule.affinity == "center_distance":
            return rule.gate - float(np.linalg.norm(mine[:3] - box[:3]))
        return float(giou_3d(mine[None], box[None])[0]) - rule.gate


def hungarian_pairs(gain: Floats) -> list[tuple[int, int]]:
    """The largest total gain of pairs inside the gate."""
    pairs = zip(*linear_sum_assignment(np.maximum(gain, 0.0), maximize=True), strict=True)
    return [(int(i), int(j)) for i, j in pairs if gain[i, j] >= 0]


def greedy_pairs(gain: Floats) -> list[tuple[int, int]]:
    """The best pair first, then the best of what is left."""
    rows: set[int] = set()
    columns: set[int] = set()
    result = []
    order = sorted((-gain[i, j], i, j) for i in range(gain.shape[0]) for j in range(gain.shape[1]))
    for cost, i, j in order:
        if cost <= 0 and i not in rows and j not in columns:
            rows.add(i)
            columns.add(j)
            result.append((i, j))
    return result
