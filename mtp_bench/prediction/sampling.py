"""Reducing a pool of samples to k that stand for it (paper, "Trajectory Sampling")."""

from __future__ import annotations

import numpy as np

from ..types import Floats
from .k_means import k_means


class KMeansSampler:
    """Centres of weighted k-means++ clusters, for all objects of a frame at once (Arthur, Vassilvitskii 2007).

    ``iterations`` of Lloyd's algorithm follow the seeding; 0 returns the seeds, which are samples of the pool.
    """

    def __init__(self, iterations: int = 3) -> None:
        self._iterations = iterations

    def reduce(self, pool: Floats, log_weight: Floats, k: int, rng: np.random.Generator) -> tuple[Floats, Floats]:
        """``k`` centres [O, k, T, 2] and log-weights [O, k] for the pool [O, S, T, 2] weighted ``log_weight`` [O, S].

        A sample with log-weight -inf does not exist. A pool that has at most k samples is returned as it is. Objects
        may come in one call or in several: the random numbers are drawn object by object.
        """
        objects, _, future, _ = pool.shape
        exists = np.isfinite(log_weight)
        order = np.argsort(~exists, axis=1, kind="stable")[:, :k]  # those that exist come first
        centre = np.zeros((objects, k, future, 2))
        weight = np.full((objects, k), -np.inf)
        centre[:, : order.shape[1]] = np.take_along_axis(pool, order[:, :, None, None], axis=1)
        weight[:, : order.shape[1]] = np.take_along_axis(log_weight, order, axis=1)
        for o in np.flatnonzero(exists.sum(axis=1) > k):
            # Relative to the heaviest: an object that only unlikely hypotheses hold must not vanish by underflow.
            here = log_weight[o, exists[o]]
            mass = np.exp(here - here.max())
            points = (pool[o] if len(here) == pool.shape[1] else pool[o, exists[o]]).reshape(-1, future * 2)
            found, held = k_means(points, mass / mass.sum(), rng.random(k), self._iterations)
            centre[o] = found.reshape(k, future, 2)
            with np.errstate(divide="ignore"):
                weight[o] = np.log(held)
        return centre, weight
