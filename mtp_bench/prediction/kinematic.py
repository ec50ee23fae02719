"""Predictors without learning: constant velocity, with calibrated spread."""

import numpy as np

from ..agent import Forecasts, Frame
from ..core import Floats, Ints, ShapeError, Task, Tracks
from ..tracking import kernel
from .kalman import NoiseTable, filtered, heading_frame, require_noise, stored_noise

_NUMBERS = 7  # standard normal numbers per sample: 4 of the state, 2 of the acceleration; the last one is unused, but
# without it every seed would draw other samples


class KinematicPredictor:
    """Draw futures from the state's posterior and a fitted motion noise; a single sample is the mean.

    ``noise``: a row per class of the task; None takes what was fitted to the task's detector. ``past``: frames of
    history to use, None for all that the task gives. ``draws``: each hypothesis that holds a track draws so many times
    k samples of it. Hypotheses draw different random numbers, and all tracks of a hypothesis the same ones.

    Raises ShapeError for noise that no motion can have, and at ``reset`` for noise of another number of classes.
    """

    def __init__(
        self, noise: NoiseTable | None = None, past: int | None = None, draws: int = 1
    ) -> None:
        if past is not None and past < 1:
            raise ShapeError(f"past is {past}, expected 1 or more frames")
        if (
            isinstance(draws, bool)
            or not isinstance(draws, int | np.integer)
            or draws < 1
        ):
            raise ShapeError(
                f"draws is {draws!r}, expected a whole number of at least 1"
            )
        if noise is not None:
            require_noise(noise)
        self._given, self._draws = noise, draws
        self._past = past or 0  # 0: all

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        self._noise = self._given or stored_noise(task)
        if len(self._noise.measurement) != len(task.classes):
            got, expected = len(self._noise.measurement), len(task.classes)
            raise ShapeError(
                f"noise has {got} classes, expected {expected}, the classes of {task.env_id}"
            )

    def predict(self, frame: Frame) -> Forecasts:
        """A row of draws x k samples for each track in each hypothesis that holds it."""
        hypothesis, track = np.nonzero(frame.tracks.member)
        k, draws = self._task.k, self._draws
        draw = hypothesis[:, None] * draws + np.arange(draws)
        futures = self.futures(frame, np.repeat(track, draws), draw.ravel(), k)
        row = np.full(frame.tracks.member.shape, -1)
        row[hypothesis, track] = np.arange(len(track))
        return Forecasts(
            futures.reshape(len(track), draws * k, self._task.future, 2), row=row
        )

    def futures(self, frame: Frame, track: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2], absolute x y, of tracks ``track`` [Q]; ``draw`` [Q] picks the random numbers."""
        task = self._task
        tau = task.dt * np.arange(1, task.future + 1)
        normal = self._normal(frame, int(draw.max(initial=-1)) + 1, samples)
        future = np.empty((len(track), samples, task.future, 2))
        expand(
            self.states(frame.tracks),
            track.astype(np.int64),
            draw.astype(np.int64),
            normal,
            tau,
            future,
        )
        return future

    def _normal(self, frame: Frame, draws: int, samples: int) -> Floats:
        """Standard normal numbers [draws, samples, 7] of a frame: the same for every agent with this seed.

        A single sample is the point forecast: all its numbers are 0, since a random future is worse than the mean.
        """
        if samples == 1:
            return np.zeros((draws, 1, _NUMBERS))
        rng = np.random.default_rng([self._task.seed, frame.number + 1])
        return rng.standard_normal((draws, samples, _NUMBERS))

    def states(self, tracks: Tracks) -> Floats:
        """Rows [N, 16] of tracks as `expand` reads them.

        For each of two axes position, velocity, the three numbers of the covariance's Cholesky factor and the deviation
        of the acceleration; then cosine and sine of the heading, and x and y of the last box.
        """
        heading, past = tracks.box[:, 3], tracks.past[:, -self._past :]
        position = heading_frame(past, heading)
        state = filtered(
            position,
            tracks.past_valid[:, -self._past :],
            tracks.class_id,
            self._noise,
            self._task.dt,
        )
        low, axis = np.linalg.cholesky(state.covariance), np.empty((len(heading), 2, 6))
        axis[..., 0], axis[..., 1] = state.position, state.velocity
        axis[..., 2], axis[..., 3], axis[..., 4] = (
            low[..., 0, 0],
            low[..., 1, 0],
            low[..., 1, 1],
        )
        axis[..., 5] = self._noise.acceleration[tracks.class_id]
        origin = np.stack(
            [np.cos(heading), np.sin(heading), *past[:, -1, :2].T], axis=1
        )
        return np.concatenate([axis.reshape(-1, 12), origin], axis=1)


def absolute(state: Floats) -> tuple[Floats, Floats]:
    """Positions and velocities [N, 2] of the rows [N, 16] of `KinematicPredictor.states`, not turned with the track."""
    (c, s), place, velocity = state[:, 12:14].T, state[:, [0, 6]], state[:, [1, 7]]
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)
    place, velocity = (
        np.einsum("nij,nj->ni", turn, vector) for vector in (place, velocity)
    )
    return place + state[:, 14:], velocity


PASTS = (2, 3, 5, 10)  # frames


class HedgedPredictor:
    """Spread k samples over several lengths of the past, `PASTS`, and one sample that stands still.

    It is a control with one hypothesis (docs/definitions). The pasts, as far as the task gives them, share the
    samples evenly, and the shortest ones get the remainder. Each past draws random numbers of its own.
    """

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        pasts = sorted({min(past, task.past) for past in PASTS})
        self._readings = [KinematicPredictor(past=past) for past in pasts]
        for reading in self._readings:
            reading.reset(task)

    def predict(self, frame: Frame) -> Forecasts:
        """A row of k samples for each track in each hypothesis that holds it."""
        hypothesis, track = np.nonzero(frame.tracks.member)
        count, still = len(self._readings), min(1, self._task.k - 1)
        share, rest = divmod(self._task.k - still, count)
        parts = [
            reading.futures(frame, track, hypothesis * count + i, share + (i < rest))
            for i, reading in enumerate(self._readings)
            if share + (i < rest)
        ]
        here = frame.tracks.past[track, -1, :2][:, None, None]
        parts.append(np.broadcast_to(here, (len(track), still, self._task.future, 2)))
        row = np.full(frame.tracks.member.shape, -1)
        row[hypothesis, track] = np.arange(len(track))
        return Forecasts(np.concatenate(parts, axis=1), row=row)


@kernel("void(f8[:, ::1], i8[::1], i8[::1], f8[:, :, ::1], f8[::1], f8[:, :, :, ::1])")
def expand(
    table: Floats, track: Ints, draw: Ints, normal: Floats, tau: Floats, future: Floats
) -> None:
    """Positions [Q, S, T, 2] at the times ``tau`` [T] of motions with constant acceleration, drawn by ``normal``.

    ``table`` [N, 16]: states of tracks; ``track`` [Q]: its rows; ``draw`` [Q]: rows of the normal numbers [D, S, 7].
    """
    for q in range(len(track)):
        px, vx, xx, xv, vvx, ax, py, vy, yy, yv, vvy, ay, c, s, x, y = table[track[q]]
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
