"""Nearest-neighbour tracking with constant-velocity forecasts: a whole agent to start from.

The contract: ``build(task)`` makes an agent, ``reset(task)`` begins a scene, ``act(observation)`` answers one frame.
Metres, seconds, radians; a box is ``x y z yaw l w h``. ``mtp_bench.answer`` makes the action from plain arrays.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench import Action, Agent, Observation, Task, Tracks, answer

Array = NDArray[Any]


def build(task: Task, gate: float = 3.0, patience: float = 1.0) -> Agent:
    """``gate``: m that a detection may lie off its track. ``patience``: s that a track lives without detections."""
    return NearestAgent(gate, patience)


class NearestAgent:
    """One hypothesis: every track takes the detection nearest to where it should be by now."""

    def __init__(self, gate: float, patience: float) -> None:
        self._gate, self._patience = gate, patience

    def reset(self, task: Task) -> None:
        """Forget everything: the answers to one scene must not depend on the scene before."""
        self._task = task
        self._next_id = 0
        self._box = np.zeros((0, 7))  # of every track, as it should be now
        self._velocity = np.zeros((0, 2))
        self._class, self._id, self._hits = (np.zeros(0, dtype=np.int64) for _ in range(3))
        self._unseen = np.zeros(0)  # s since its last detection

    def act(self, observation: Observation) -> Action:
        """Answer this frame, before the next one is known."""
        valid = observation["detection_valid"] == 1  # the rows beyond are padding
        box = observation["detection_box"][valid].astype(np.float64)  # a copy: observations are not ours to write into
        dt = float(observation["dt"]) or self._task.dt  # 0 in the first frame
        self._box[:, :2] += self._velocity * dt
        self._unseen += dt
        track, detection = self._pairs(box, observation["detection_class"][valid])
        off = box[detection, :2] - self._box[track, :2]
        gain = np.where(self._hits[track] == 1, 1.0, 0.4)  # the second detection gives the first velocity
        self._velocity[track] += gain[:, None] * off / dt
        self._box[track] = box[detection]
        self._hits[track] += 1
        self._unseen[track] = 0.0
        new = np.setdiff1d(np.arange(len(box)), detection)
        self._begin(box[new], observation["detection_velocity"][valid][new], observation["detection_class"][valid][new])
        sure = np.flatnonzero(self._hits > 1)  # one detection gives no velocity, and may be false
        # That it is there is likelier the more often it was seen, and the more lately.
        confidence = self._hits[sure] / (self._hits[sure] + 1) * np.exp(-self._unseen[sure])
        tracks = Tracks.of_one_hypothesis(self._id, self._box, self._class)
        forecasts = self._forecasts(sure)
        return answer(self._task, self._box[sure], self._class[sure], forecasts, confidence=confidence, tracks=tracks)

    def _pairs(self, box: Array, class_id: Array) -> tuple[Array, Array]:
        """Tracks and the detections they take, the nearest pair first."""
        distance = np.linalg.norm(self._box[:, None, :2] - box[None, :, :2], axis=-1)
        distance[self._class[:, None] != class_id[None]] = np.inf
        pairs = []
        while distance.size and distance.min() <= self._gate:
            pairs.append(np.unravel_index(distance.argmin(), distance.shape))
            distance[pairs[-1][0], :] = distance[:, pairs[-1][1]] = np.inf
        found = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        return found[:, 0], found[:, 1]

    def _begin(self, box: Array, velocity: Array, class_id: Array) -> None:
        """Drop the tracks that were not seen for long and begin one for each of these detections."""
        kept = self._unseen <= self._patience
        new_id = self._next_id + np.arange(len(box))  # an id is never given twice
        self._next_id += len(box)
        self._box = np.concatenate([self._box[kept], box])
        self._velocity = np.concatenate([self._velocity[kept], velocity])  # 0 where the detector measures none
        self._class = np.concatenate([self._class[kept], class_id])
        self._id = np.concatenate([self._id[kept], new_id])
        self._hits = np.concatenate([self._hits[kept], np.ones(len(box), dtype=np.int64)])
        self._unseen = np.concatenate([self._unseen[kept], np.zeros(len(box))])

    def _forecasts(self, tracks: Array) -> Array:
        """Samples [O, K, T, 2] in metres from each object's centre: somewhat slower to faster, straight or turning."""
        sample = np.arange(self._task.samples)
        speed = 1.0 - 0.06 * ((sample + 1) // 2) * (-1.0) ** sample  # 1, 1.06, 0.94, 1.12, ... times the speed
        turn = np.array([0.0, 0.0, 0.15, -0.15])[sample % 4]  # rad/s
        angle = turn[:, None] * self._task.dt * np.arange(self._task.future)
        step = speed[:, None] * np.stack([np.cos(angle), np.sin(angle)]) * self._task.dt
        along, across = np.cumsum(step, axis=-1)  # [K, T] each, for a velocity of 1 m/s along x
        vx, vy = self._velocity[tracks].T[:, :, None, None]
        return np.stack([vx * along - vy * across, vy * along + vx * across], axis=-1)
