"""Three ways to move at once: an interacting-multiple-model filter (Blom, Bar-Shalom 1988).

A track moves at a steady velocity, at one that changes, or at a steady acceleration, and may go over from one to the
other. In the heading frame of a track the two axes are filtered alone, but share the probabilities of the models
(Bar-Shalom, Li, Kirubarajan 2001, ch. 11). What it needs to know is fitted, see ``imm_noise``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..agent import Tracks
from ..errors import ShapeError
from ..types import Bools, Floats, Ints, Task
from .imm_noise import MODELS, ImmNoise, stored_imm_noise
from .kalman import heading_frame, rotation
from .noise_checks import require_classes, require_noise, require_past

_MEAN = slice(9, 12)  # of the raw moments of a state: 3 x 3 second moments, then 3 means
_AXES = {"measurement": (), "speed": (2,), "jerkiness": (MODELS, 2), "acceleration": (MODELS, 2), "stay": ()}


@dataclass(frozen=True, eq=False)
class Mixture:
    """State of N tracks now under M models; axis 2 is along and across the heading."""

    mean: Floats  # [M, N, 2, 3] position m from the last box centre, velocity m/s, acceleration m/s^2
    covariance: Floats  # [M, N, 2, 3, 3]
    probability: Floats  # [M, N] of the models


def mixture(position: Floats, valid: Bools, class_id: Ints, noise: ImmNoise, dt: float) -> Mixture:
    """States of tracks now, from their pasts.

    ``position`` [N, P, 2] m, heading frame, oldest first; ``valid`` [N, P]: where a detection was taken; ``class_id``
    [N] chooses the row of ``noise``; ``dt``: frame period, s.
    """
    n, length, _ = position.shape
    variance = noise.measurement[class_id][:, None] ** 2  # [N, 1]
    move, disturbance = _transitions(dt), _disturbances(noise, dt)[:, class_id]
    prior = _prior(noise)[:, class_id]
    stay = noise.stay[class_id]
    change = np.where(np.eye(MODELS, dtype=bool)[..., None], stay, (1 - stay) / (MODELS - 1))  # [from, to, N]
    even = np.full((MODELS, n), 1 / MODELS)
    # Before its first detection a track has no state: in that frame it begins with the prior.
    state = Mixture(np.zeros((MODELS, n, 2, 3)), prior, even)
    started = np.zeros(n, dtype=bool)
    for step in range(length):
        here, seen = position[:, step], valid[:, step]
        ahead = _ahead(state, change, move, disturbance)
        begin = np.zeros_like(state.mean)
        begin[..., 0] = here
        state = _where(seen & started, _updated(ahead, here, variance), ahead)
        state = _where(started, state, Mixture(begin, prior, even))
        started |= seen
    return state


def _where(flag: Bools, yes: Mixture, no: Mixture) -> Mixture:
    """The states of ``yes`` where ``flag`` [N], else of ``no``."""
    return Mixture(
        np.where(flag[:, None, None], yes.mean, no.mean),
        np.where(flag[:, None, None, None], yes.covariance, no.covariance),
        np.where(flag, yes.probability, no.probability),
    )


def _ahead(state: Mixture, change: Floats, move: Floats, disturbance: Floats) -> Mixture:
    """One frame on: the models are mixed, then moved. ``change`` [M, M, N]: probability of going over, from and to."""
    joint = change * state.probability[:, None]
    probability = joint.sum(axis=0)
    # Mixing and motion are linear in the raw moments.
    mixed = np.einsum("ijn,inax->jnax", joint / probability, _raw(state))
    moments = (mixed.reshape(MODELS, -1, 12) @ move).reshape(mixed.shape)
    mean = moments[..., _MEAN]
    second = moments[..., :9].reshape(*mean.shape, 3)
    return Mixture(mean, second - mean[..., :, None] * mean[..., None, :] + disturbance, probability)


def _raw(state: Mixture) -> Floats:
    """Second moments about 0 and means [M, N, 2, 12]."""
    second = state.covariance + state.mean[..., :, None] * state.mean[..., None, :]
    return np.concatenate([second.reshape(*state.mean.shape[:-1], 9), state.mean], axis=-1)


def _updated(state: Mixture, here: Floats, variance: Floats) -> Mixture:
    """The state after a detection at ``here`` [N, 2] of ``variance`` [N, 1] per axis."""
    total = state.covariance[..., 0, 0] + variance
    residual = here - state.mean[..., 0]
    log_likelihood = -0.5 * (residual**2 / total + np.log(total)).sum(axis=-1)
    weight = state.probability * np.exp(log_likelihood - log_likelihood.max(axis=0))
    gain = state.covariance[..., 0] / total[..., None]
    return Mixture(
        state.mean + gain * residual[..., None],
        state.covariance - gain[..., :, None] * state.covariance[..., None, 0, :],
        weight / weight.sum(axis=0),
    )


def _transitions(dt: float) -> Floats:
    """Matrices [M, 12, 12] that move raw moments one frame on, from the right."""
    steady = np.array([[1, dt, dt * dt / 2], [0, 1, dt], [0, 0, 1.0]])
    forgetful = np.array([[1, dt, 0], [0, 1, 0], [0, 0, 0.0]])  # its acceleration is a new one in every frame
    matrices = np.zeros((MODELS, 12, 12))
    for matrix, state in zip(matrices, (forgetful, forgetful, steady), strict=True):
        matrix[:9, :9], matrix[_MEAN, _MEAN] = np.kron(state, state).T, state.T
    return matrices


def _disturbances(noise: ImmNoise, dt: float) -> Floats:
    """What a frame adds to the covariances of each class: [M, C, 2, 3, 3]."""
    white_acceleration = np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])
    white_jerk = np.array([
        [dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]
    ])  # fmt: skip
    shape = np.stack([white_acceleration, white_acceleration, white_jerk])[:, None, None]
    disturbance = noise.jerkiness.swapaxes(0, 1)[..., None, None] ** 2 * shape
    disturbance[:2, ..., 2, 2] = noise.acceleration.swapaxes(0, 1)[:2] ** 2
    return np.asarray(disturbance)


def _prior(noise: ImmNoise) -> Floats:
    """Covariances [M, C, 2, 3, 3] of a track that was detected once."""
    prior = np.zeros((MODELS, *noise.speed.shape, 3, 3))
    prior[..., 0, 0] = noise.measurement[:, None] ** 2
    prior[..., 1, 1] = noise.speed**2
    prior[..., 2, 2] = noise.acceleration.swapaxes(0, 1) ** 2
    return prior


class ImmPredictor:
    """Samples futures from the states of three motion models, each as often as it is likely; one sample is the mean.

    ``noise``: None takes what was fitted to the task's detector. ``past``: frames of history to use, None for all that
    the task gives.

    Raises ShapeError for noise that no motion can have, and at ``reset`` for noise of another number of classes.
    """

    def __init__(self, noise: ImmNoise | None = None, past: int | None = None) -> None:
        require_past(past)
        if noise is not None:
            require_noise(noise, _AXES)
            if not (noise.stay <= 1).all():
                raise ShapeError(f"noise.stay holds {noise.stay.max()}, expected probabilities")
        self._given = noise
        self._past = past or 0  # 0: all

    def reset(self, task: Task) -> None:
        """Forget everything."""
        self._task = task
        self._noise = self._given or stored_imm_noise(task)
        require_classes(self._noise, task)
        tau = task.dt * np.arange(1, task.future + 1)
        self._powers = np.stack([np.ones_like(tau), tau, tau**2 / 2])  # [3, T]
        self._frame = 0

    def begin(self, tracks: Tracks) -> None:
        """Filter the distinct tracks of the next frame, once for all their samples."""
        self._frame += 1
        position = heading_frame(tracks.past[:, -self._past :], tracks.box[:, 3])
        valid = tracks.past_valid[:, -self._past :]
        self._state = mixture(position, valid, tracks.class_id, self._noise, self._task.dt)
        # Rounding must not make a covariance indefinite: 1e-6 m is nothing.
        self._factor = np.linalg.cholesky(self._state.covariance + 1e-12 * np.eye(3))

    def sample(self, tracks: Tracks, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2] in absolute x y of the tracks ``leaf`` [Q], with the draws ``draw`` [Q]."""
        if len(leaf) == 0:
            return np.zeros((0, samples, self._task.future, 2))
        state = self._means(leaf) if samples == 1 else self._drawn(leaf, draw, samples)
        turned = state.swapaxes(-1, -2) @ rotation(tracks.box[leaf, 3]).swapaxes(-1, -2)[:, None]  # [Q, S, 3, 2]
        future = self._powers.T @ turned
        future += tracks.past[leaf, -1, :2][:, None, None]
        return np.asarray(future)

    def _means(self, leaf: Ints) -> Floats:
        """The mean state over the models, [Q, 1, 2, 3]."""
        weight = self._state.probability[:, leaf, None, None]
        return np.asarray((weight * self._state.mean[:, leaf]).sum(axis=0)[:, None])

    def _drawn(self, leaf: Ints, draw: Ints, samples: int) -> Floats:
        """States [Q, samples, 2, 3]: every model as often as it is likely, up to one (systematic resampling)."""
        draws = int(draw.max()) + 1  # streams of its own: not those of the sampler and of the kinematic predictor
        normal = np.random.default_rng([self._task.seed, self._frame, 2]).standard_normal((draws, samples, 2, 3))[draw]
        offset = np.random.default_rng([self._task.seed, self._frame, 3]).random(draws)[draw]
        place = (np.arange(samples) + offset[:, None]) / samples
        upto = np.cumsum(self._state.probability[:-1, leaf], axis=0)
        model = (place > upto[..., None]).sum(axis=0)  # [Q, samples]
        row = leaf[:, None]
        return np.asarray(self._state.mean[model, row] + (self._factor[model, row] @ normal[..., None])[..., 0])
