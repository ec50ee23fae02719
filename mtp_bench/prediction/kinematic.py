"""Predictors without learning: constant velocity, with calibrated spread."""

import numpy as np

from ..agent import Forecasts, Frame
from ..core import Floats, Ints, ShapeError, Task, Tracks, rotation
from ..tracking import kernel
from .kalman import (
    NoiseTable,
    filter_tracks,
    heading_frame,
    require_noise,
    stored_noise,
)

# Standard normal numbers per sample: 4 of the state, 2 of the acceleration. The last
# one is unused, but without it every seed would draw other samples.
_NUMBERS = 7


class KinematicPredictor:
    """Draws from the state's posterior and a fitted motion noise.

    A single sample is the mean. Hypotheses draw different random numbers, and all
    tracks of a hypothesis the same ones.

    Args:
        noise: a row per class of the task; None takes what was fitted to the task's
            detector.
        past: frames of history to use, None for all that the task gives.
        draws: each hypothesis that holds a track draws so many times k samples of it.

    Raises ShapeError for noise that no motion can have, and at ``reset`` for noise of
    another number of classes.
    """

    def __init__(
        self, noise: NoiseTable | None = None, past: int | None = None, draws: int = 1
    ) -> None:
        if past is not None and past < 1:
            raise ShapeError(f"past is {past}, expected 1 or more frames")
        is_whole = isinstance(draws, int | np.integer) and not isinstance(draws, bool)
        if not is_whole or draws < 1:
            raise ShapeError(
                f"draws is {draws!r}, expected a whole number of at least 1"
            )
        if noise is not None:
            require_noise(noise)
        self._given_noise = noise
        self._draws = draws
        self._past = past or 0  # 0: all, as the slice [-0:] takes

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        self._noise = self._given_noise or stored_noise(task)
        noise_classes = len(self._noise.measurement)
        if noise_classes != len(task.classes):
            raise ShapeError(
                f"noise has {noise_classes} classes, expected {len(task.classes)}, "
                f"the classes of {task.env_id}"
            )

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the tracks of each hypothesis, with draws x k samples each."""
        hypothesis, track = np.nonzero(frame.tracks.member)
        samples = self._task.k
        draws = self._draws
        draw = (hypothesis[:, None] * draws + np.arange(draws)).ravel()
        futures = self.futures(frame, np.repeat(track, draws), draw, samples)
        shape = (len(track), draws * samples, self._task.future, 2)
        return Forecasts(futures.reshape(shape), row=_rows_of(frame, hypothesis, track))

    def futures(self, frame: Frame, track: Ints, draw: Ints, samples: int) -> Floats:
        """Return futures [Q, samples, T, 2] of tracks, absolute x y.

        ``track`` [Q]: their numbers; ``draw`` [Q] picks the random numbers.
        """
        task = self._task
        time_s = task.dt * np.arange(1, task.future + 1)
        normal = self._normal_numbers(frame, int(draw.max(initial=-1)) + 1, samples)
        future = np.empty((len(track), samples, task.future, 2))
        expand(
            self.states(frame.tracks),
            track.astype(np.int64),
            draw.astype(np.int64),
            normal,
            time_s,
            future,
        )
        return future

    def _normal_numbers(self, frame: Frame, draws: int, samples: int) -> Floats:
        """Draw standard normal numbers [draws, samples, 7] of a frame.

        Every agent with this seed gets the same numbers. A single sample is the point
        forecast: all its numbers are 0, since a random future is worse than the mean.
        """
        if samples == 1:
            return np.zeros((draws, 1, _NUMBERS))
        rng = np.random.default_rng([self._task.seed, frame.number + 1])
        return rng.standard_normal((draws, samples, _NUMBERS))

    def states(self, tracks: Tracks) -> Floats:
        """Return rows [N, 16] of tracks as `expand` reads them.

        For each of two axes position, velocity, the three numbers of the covariance's
        Cholesky factor and the deviation of the acceleration; then cosine and sine of
        the heading, and x and y of the last box.
        """
        heading = tracks.box[:, 3]
        past = tracks.past[:, -self._past :]
        state = filter_tracks(
            heading_frame(past, heading),
            tracks.past_valid[:, -self._past :],
            tracks.class_id,
            self._noise,
            self._task.dt,
        )
        factor = np.linalg.cholesky(state.covariance)
        axes = np.empty((len(heading), 2, 6))
        axes[..., 0] = state.position
        axes[..., 1] = state.velocity
        axes[..., 2] = factor[..., 0, 0]
        axes[..., 3] = factor[..., 1, 0]
        axes[..., 4] = factor[..., 1, 1]
        axes[..., 5] = self._noise.acceleration[tracks.class_id]
        last_x, last_y = past[:, -1, :2].T
        origin = np.stack([np.cos(heading), np.sin(heading), last_x, last_y], axis=1)
        return np.concatenate([axes.reshape(-1, 12), origin], axis=1)


def absolute(state: Floats, heading: Floats) -> tuple[Floats, Floats]:
    """Return positions and velocities [N, 2] in the frame of the observations.

    ``state`` [N, 16]: rows of `KinematicPredictor.states`; ``heading`` [N]: of tracks.
    """
    turn = rotation(heading)
    place = np.einsum("nij,nj->ni", turn, state[:, [0, 6]])
    velocity = np.einsum("nij,nj->ni", turn, state[:, [1, 7]])
    return place + state[:, 14:], velocity


PASTS = (2, 3, 5, 10)  # frames


class HedgedPredictor:
    """Samples spread over several lengths of the past, `PASTS`.

    One of the k samples stands still. It is a control with one hypothesis
    (docs/definitions). The pasts, as far as the task gives them, share the samples
    evenly, and the shortest ones get the remainder. Each past draws random numbers of
    its own.
    """

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        self._task = task
        pasts = sorted({min(past, task.past) for past in PASTS})
        self._predictors = [KinematicPredictor(past=past) for past in pasts]
        for predictor in self._predictors:
            predictor.reset(task)

    def predict(self, frame: Frame) -> Forecasts:
        """Forecast the tracks of each hypothesis, with k samples each."""
        hypothesis, track = np.nonzero(frame.tracks.member)
        count = len(self._predictors)
        still = min(1, self._task.k - 1)  # not if k is 1
        share, remainder = divmod(self._task.k - still, count)
        parts = []
        for i, predictor in enumerate(self._predictors):
            samples = share
            if i < remainder:
                samples += 1
            if samples:
                draw = hypothesis * count + i
                parts.append(predictor.futures(frame, track, draw, samples))
        last_place = frame.tracks.past[track, -1, :2][:, None, None]
        still_shape = (len(track), still, self._task.future, 2)
        parts.append(np.broadcast_to(last_place, still_shape))
        row = _rows_of(frame, hypothesis, track)
        return Forecasts(np.concatenate(parts, axis=1), row=row)


def _rows_of(frame: Frame, hypothesis: Ints, track: Ints) -> Ints:
    """Return the row [H, N] of the forecasts of each track.

    It is -1 where the hypothesis does not hold the track.
    """
    row = np.full(frame.tracks.member.shape, -1)
    row[hypothesis, track] = np.arange(len(track))
    return row


@kernel("void(f8[:, ::1], i8[::1], i8[::1], f8[:, :, ::1], f8[::1], f8[:, :, :, ::1])")
def expand(
    table: Floats,
    track: Ints,
    draw: Ints,
    normal: Floats,
    time_s: Floats,
    future: Floats,
) -> None:
    """Write positions ``future`` [Q, S, T, 2] of motions with constant acceleration.

    ``time_s`` [T]; ``normal`` [D, S, 7]: random numbers; ``table`` [N, 16]: see
    `KinematicPredictor.states`; ``track`` [Q]: its rows; ``draw`` [Q]: rows of
    ``normal``.
    """
    for q in range(len(track)):
        px, vx, xx, xv, vvx, ax, py, vy, yy, yv, vvy, ay, c, s, x, y = table[track[q]]
        for k in range(future.shape[1]):
            z = normal[draw[q], k]
            path = future[q, k]
            p0 = px + xx * z[0]
            v0 = vx + xv * z[0] + vvx * z[1]
            a0 = ax * z[4]
            p1 = py + yy * z[2]
            v1 = vy + yv * z[2] + vvy * z[3]
            a1 = ay * z[5]
            # out of the heading frame
            place_x = c * p0 - s * p1 + x
            place_y = s * p0 + c * p1 + y
            speed_x = c * v0 - s * v1
            speed_y = s * v0 + c * v1
            half_x = 0.5 * (c * a0 - s * a1)
            half_y = 0.5 * (s * a0 + c * a1)
            for t in range(len(time_s)):
                path[t, 0] = place_x + time_s[t] * (speed_x + time_s[t] * half_x)
                path[t, 1] = place_y + time_s[t] * (speed_y + time_s[t] * half_y)
