"""The predictor without learning: constant velocity, with calibrated spread."""

from __future__ import annotations

import numpy as np

from ..agent import Tracks
from ..errors import ShapeError
from ..types import Floats, Ints, Task
from .kalman import NoiseTable, filtered, heading_frame
from .motion_noise import stored_noise

_NUMBERS = 7  # standard normal numbers per sample: of the state 4, of the acceleration 2, and one that is not used:
# with another number of them every sample that was ever drawn would be another


class KinematicPredictor:
    """Samples futures from the state's posterior and a fitted motion noise; a single sample is the mean.

    ``noise``: None takes what was fitted to the task's detector. ``past``: frames of history to use, None for all that
    the task gives.
    """

    def __init__(self, noise: NoiseTable | None = None, past: int | None = None) -> None:
        if past is not None and past < 1:
            raise ShapeError(f"past is {past}, expected 1 or more frames")
        self._given = noise
        self._past = past

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._task = task
        self._noise = self._given or stored_noise(task)
        self._tau = task.dt * np.arange(1, task.future + 1)
        self._frame = 0

    def begin(self, tracks: Tracks) -> None:
        """Filter the distinct tracks of the next frame, once for all their samples."""
        self._frame += 1
        window = slice(-self._past if self._past else None, None)
        position = heading_frame(tracks.past[:, window], tracks.box[:, 3])
        self._state = filtered(position, tracks.past_valid[:, window], tracks.class_id, self._noise, self._task.dt)

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q], with the draws ``draw`` [Q]."""
        if len(leaf) == 0:
            return np.zeros((0, samples, self._task.future, 2))
        normal = self._draws(int(draw.max()) + 1, samples)[draw]
        motion = self._motions(tracks.class_id, leaf, normal)
        del normal  # the largest array beside the futures
        motion = _turned(motion, tracks.box[leaf, 3][:, None])
        motion[0] += tracks.past[leaf, -1, :2].T[:, :, None]
        return _expanded(motion, self._tau)

    def _draws(self, draws: int, samples: int) -> Floats:
        """The same numbers for every agent with this seed, however many draws it takes.

        One sample is the point forecast: all numbers are 0, for a random one would be a worse guess than the mean.
        """
        if samples == 1:
            return np.zeros((draws, 1, _NUMBERS))
        rng = np.random.default_rng([self._task.seed, self._frame])
        return rng.standard_normal((draws, samples, _NUMBERS))

    def _motions(self, class_id: Ints, place: Ints, normal: Floats) -> Floats:
        """Position, velocity and acceleration, along and across the heading, of every sample: [3, 2, Q, samples]."""
        state = self._state
        factor = np.linalg.cholesky(state.covariance)[place]  # [Q, 2, 2, 2]
        motion = np.empty((3, 2, *normal.shape[:2]))
        for axis in range(2):
            first, second = normal[:, :, 2 * axis], normal[:, :, 2 * axis + 1]
            low = factor[:, axis, :, :, None]
            motion[0, axis] = state.position[place, axis, None] + low[:, 0, 0] * first
            motion[1, axis] = state.velocity[place, axis, None] + low[:, 1, 0] * first + low[:, 1, 1] * second
            motion[2, axis] = self._noise.acceleration[class_id, axis][place, None] * normal[:, :, 4 + axis]
        return motion


def _turned(motion: Floats, heading: Floats) -> Floats:
    """Vectors [3, 2, Q, S] given along and across the heading [Q, 1], in absolute axes."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([c * motion[:, 0] - s * motion[:, 1], s * motion[:, 0] + c * motion[:, 1]], axis=1)


def _expanded(motion: Floats, tau: Floats) -> Floats:
    """Positions [Q, S, T, 2] at the times ``tau`` [T] of motions [3, 2, Q, S] with constant acceleration."""
    powers = np.stack([np.ones_like(tau), tau, tau**2 / 2])
    future = np.empty((*motion.shape[2:], len(tau), 2))
    for axis in range(2):
        # One matrix product for all samples: the polynomial is the same for all of them.
        future[..., axis] = np.tensordot(motion[:, axis], powers, axes=(0, 0))
    return future
