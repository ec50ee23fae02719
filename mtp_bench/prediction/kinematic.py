"""The predictor without learning: constant velocity, with calibrated spread."""

from __future__ import annotations

import numpy as np

from ..agent import Tracks
from ..tracking.kernels.compile import kernel
from ..types import Floats, Ints, Task
from .kalman import NoiseTable, Posterior, filtered, heading_frame
from .motion_noise import stored_noise
from .noise_checks import require_classes, require_noise, require_past

_NUMBERS = 7  # standard normal numbers per sample: of the state 4, of the acceleration 2, and one that is not used:
# with another number of them every sample that was ever drawn would be another
_AXES = {"measurement": (), "jerkiness": (2,), "speed": (2,), "acceleration": (2,)}


class KinematicPredictor:
    """Samples futures from the state's posterior and a fitted motion noise; a single sample is the mean.

    ``noise``: a row per class of the task; None takes what was fitted to the task's detector. ``past``: frames of
    history to use, None for all that the task gives.

    Raises ShapeError for noise that no motion can have, and at ``reset`` for noise of another number of classes.
    """

    def __init__(self, noise: NoiseTable | None = None, past: int | None = None) -> None:
        require_past(past)
        if noise is not None:
            require_noise(noise, _AXES)
        self._given = noise
        self._past = past or 0  # 0: all

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._task = task
        self._noise = self._given or stored_noise(task)
        require_classes(self._noise, task)
        self._tau = task.dt * np.arange(1, task.future + 1)
        self._frame = 0

    def begin(self, tracks: Tracks) -> None:
        """Filter the distinct tracks of the next frame, once for all their samples."""
        self._frame += 1
        self._normal = np.zeros((0, 0, _NUMBERS))
        position = heading_frame(tracks.past[:, -self._past :], tracks.box[:, 3])
        state = filtered(position, tracks.past_valid[:, -self._past :], tracks.class_id, self._noise, self._task.dt)
        self._table = _table(tracks, state, self._noise)

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q], with the draws ``draw`` [Q]."""
        future = np.empty((len(leaf), samples, self._task.future, 2))
        normal = self._draws(int(draw.max(initial=-1)) + 1, samples)
        expand(self._table, leaf.astype(np.int64), draw.astype(np.int64), normal, self._tau, future)
        return future

    def _draws(self, draws: int, samples: int) -> Floats:
        """At least ``draws`` rows [draws, samples, 7]: the same numbers for every agent with this seed, however many.

        One sample is the point forecast: all numbers are 0, for a random one would be a worse guess than the mean.
        """
        if samples == 1:
            return np.zeros((draws, 1, _NUMBERS))
        if len(self._normal) < draws or self._normal.shape[1] != samples:  # kept for the other objects of the frame
            rng = np.random.default_rng([self._task.seed, self._frame])
            self._normal = rng.standard_normal((draws, samples, _NUMBERS))
        return self._normal


def _table(tracks: Tracks, state: Posterior, noise: NoiseTable) -> Floats:
    """What `expand` reads of each track: [N, 16].

    For each of two axes position, velocity, the three numbers of the covariance's Cholesky factor and the deviation of
    the acceleration; then the heading's cosine and sine, and x and y of the last box.
    """
    low, axis = np.linalg.cholesky(state.covariance), np.empty((len(tracks.box), 2, 6))
    axis[..., 0], axis[..., 1] = state.position, state.velocity
    axis[..., 2], axis[..., 3], axis[..., 4] = low[..., 0, 0], low[..., 1, 0], low[..., 1, 1]
    axis[..., 5] = noise.acceleration[tracks.class_id]
    heading = tracks.box[:, 3]
    frame = np.stack([np.cos(heading), np.sin(heading), *tracks.past[:, -1, :2].T], axis=1)
    return np.concatenate([axis.reshape(-1, 12), frame], axis=1)


@kernel("void(f8[:, ::1], i8[::1], i8[::1], f8[:, :, ::1], f8[::1], f8[:, :, :, ::1])", vectorize=True)
def expand(table: Floats, leaf: Ints, draw: Ints, normal: Floats, tau: Floats, future: Floats) -> None:
    """Positions [Q, S, T, 2] at the times ``tau`` [T] of motions with constant acceleration, drawn by ``normal``.

    ``table`` [N, 16], see `_table`; ``leaf`` [Q]: its rows; ``draw`` [Q]: rows of the normal numbers [D, S, 7].
    """
    for q in range(len(leaf)):
        px, vx, xx, xv, vvx, ax, py, vy, yy, yv, vvy, ay, c, s, x, y = table[leaf[q]]
        for k in range(future.shape[1]):
            z, path = normal[draw[q], k], future[q, k]
            p0, v0, a0 = px + xx * z[0], vx + xv * z[0] + vvx * z[1], ax * z[4]
            p1, v1, a1 = py + yy * z[2], vy + yv * z[2] + vvy * z[3], ay * z[5]
            p0, p1 = c * p0 - s * p1 + x, s * p0 + c * p1 + y
            v0, v1 = c * v0 - s * v1, s * v0 + c * v1
            a0, a1 = 0.5 * (c * a0 - s * a1), 0.5 * (s * a0 + c * a1)
            for t in range(len(tau)):
                path[t, 0] = p0 + tau[t] * (v0 + tau[t] * a0)
                path[t, 1] = p1 + tau[t] * (v1 + tau[t] * a1)
