"""Predictors without learning: constant velocity and constant turn rate, with calibrated spread."""

from __future__ import annotations

import numpy as np

from ..agent import Tracks
from ..errors import ShapeError
from ..types import Bools, Floats, Ints, Task
from .kalman import NoiseTable, Posterior, filtered, heading_frame
from .motion_noise import stored_noise

_NUMBERS = 7  # standard normal numbers behind one sample: state (4), acceleration (2), turn rate (1)


class KinematicPredictor:
    """Samples futures from the state's posterior and a fitted motion noise; a single sample is the mean.

    ``turning``: False is constant velocity, True adds the turn rate seen in the headings of the past. ``noise``: None
    takes what was fitted to the task's detector. ``past``: frames of history to use, None for all that the task gives.
    """

    def __init__(self, turning: bool = False, noise: NoiseTable | None = None, past: int | None = None) -> None:
        if past is not None and past < 1:
            raise ShapeError(f"past is {past}, expected 1 or more frames")
        self._turning = turning
        self._given = noise
        self._past = past

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._task = task
        self._noise = self._given or stored_noise(task)
        self._tau = task.dt * np.arange(1, task.future + 1)
        self._frame = 0
        self._tracks: Tracks | None = None

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q], with the draws ``draw`` [Q]."""
        if tracks is not self._tracks:  # the next frame: its distinct tracks are filtered once
            self._frame += 1
            self._tracks = tracks
            self._filtered = self._states(tracks)
        if len(leaf) == 0:
            return np.zeros((0, samples, self._task.future, 2))
        state, (rate, rate_deviation) = self._filtered
        normal = self._draws(int(draw.max()) + 1, samples)[draw]
        motion = self._motions(state, tracks.class_id, leaf, normal)
        turning = normal[:, :, 6].copy() if self._turning else None
        del normal  # the largest array beside the futures
        motion = _turned(motion, tracks.box[leaf, 3][:, None])
        motion[0] += tracks.past[leaf, -1, :2].T[:, :, None]
        if turning is None:
            return _expanded(motion, self._tau)
        turn = rate[leaf][:, None] + rate_deviation[leaf][:, None] * turning
        start = motion[0].copy()
        motion[0] = 0.0
        bent = _bent(_expanded(motion, self._tau), turn[:, :, None] * self._tau)
        return np.asarray(np.moveaxis(start, 0, -1)[:, :, None] + bent)

    def _draws(self, draws: int, samples: int) -> Floats:
        """The same numbers for every agent with this seed, however many draws it takes.

        One sample is the point forecast: all numbers are 0, for a random one would be a worse guess than the mean.
        """
        if samples == 1:
            return np.zeros((draws, 1, _NUMBERS))
        rng = np.random.default_rng([self._task.seed, self._frame])
        return rng.standard_normal((draws, samples, _NUMBERS))

    def _states(self, tracks: Tracks) -> tuple[Posterior, tuple[Floats, Floats]]:
        window = slice(-self._past if self._past else None, None)
        past, valid, class_id = tracks.past[:, window], tracks.past_valid[:, window], tracks.class_id
        position = heading_frame(past, tracks.box[:, 3])
        state = filtered(position, valid, class_id, self._noise, self._task.dt)
        return state, turn_rate(past[:, :, 3], valid, self._noise.turn_rate[class_id], self._task.dt)

    def _motions(self, state: Posterior, class_id: Ints, place: Ints, normal: Floats) -> Floats:
        """Position, velocity and acceleration, along and across the heading, of every sample: [3, 2, Q, samples]."""
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


def turn_rate(heading: Floats, valid: Bools, prior: Floats, dt: float) -> tuple[Floats, Floats]:
    """Mean and standard deviation [N] of the turn rate (rad/s) from past headings [N, P].

    Least squares on heading changes modulo pi (detectors confuse front and back), drawn towards 0 by the prior.
    """
    step = np.diff(heading, axis=1)
    step = step - np.pi * np.round(step / np.pi)
    both = valid[:, 1:] & valid[:, :-1]
    count = both.sum(axis=1)
    mean = np.where(both, step, 0.0).sum(axis=1) / np.maximum(count, 1) / dt
    # The mean of n changes of noisy headings has the noise of two headings, spread over n frames.
    measured = 2 * (HEADING_NOISE / np.maximum(count, 1) / dt) ** 2
    weight = np.where(count > 0, prior**2 / (prior**2 + measured), 0.0)
    return weight * mean, prior * np.sqrt(1 - weight)


HEADING_NOISE = 0.1  # rad, of a detected heading


def _bent(straight: Floats, angle: Floats) -> Floats:
    """Turn straight displacements [..., T, 2] into arcs whose direction has changed by ``angle`` [..., T]."""
    small = np.abs(angle) < 1e-6
    safe = np.where(small, 1.0, angle)
    sine = np.where(small, 1.0, np.sin(safe) / safe)
    cosine = np.where(small, angle / 2, (1 - np.cos(safe)) / safe)
    x, y = straight[..., 0], straight[..., 1]
    return np.stack([sine * x - cosine * y, cosine * x + sine * y], axis=-1)
