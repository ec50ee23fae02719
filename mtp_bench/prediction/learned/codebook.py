"""Codebook: constant velocity, and k ways in which objects of that class, speed and age deviate from it.

The deviations are the centres of k-means clusters of those of the training data, in the heading frame; how many fell to
each is its weight.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from ...types import Ints
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights, namespace
from .local import Arrays, local_inputs, mean_velocity
from .modes import straight
from .network import Sizes

SPEEDS = (0.2, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0, 14.0)  # m/s, between the groups of a class
ALIKE = 2 * (len(SPEEDS) + 1)  # groups of a class: of each speed the tracks born within the past, and the others
FEW = 20  # training windows per code, below which a group is served by that of all classes, and this one by all windows
MOST = 20_000  # training windows of a group that are looked at


class Codebook:
    """The network ``codebook``: nothing of it is trained, `start` makes all of it."""

    name = "codebook"

    def inputs(self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes) -> Arrays:
        """The past of each window, by itself."""
        return local_inputs(windows)

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Codes and the logarithm of their shares, for each group; they count as statistics of the data."""
        groups = len(sizes.classes) * ALIKE
        return {"code.mean": (groups, sizes.modes, sizes.future, 2), "log_share.mean": (groups, sizes.modes)}

    def start(self, inputs: Arrays, future: np.ndarray, known: np.ndarray, sizes: Sizes, seed: int) -> Arrays:
        """The codes of each group; futures that are cut short do not count."""
        whole = known.all(axis=1)
        off = (future - straight(inputs, sizes))[whole]
        group = group_of(inputs, sizes)[whole]
        straight_on = np.zeros((sizes.modes, sizes.future, 2), np.float32)
        even = np.full(sizes.modes, -np.log(sizes.modes), np.float32)
        every = _codes(off, sizes, seed, (straight_on, even))
        found = []
        for number in range(len(sizes.classes) * ALIKE):
            alike = _codes(off[group % ALIKE == number % ALIKE], sizes, seed, every)
            found.append(_codes(off[group == number], sizes, seed, alike))
        code, share = (np.stack(part) for part in zip(*found, strict=True))
        return {"code.mean": code, "log_share.mean": share}

    def forward(self, weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> dict[str, Array]:
        """Modes, their log-weights and the present position: where the track says."""
        group = group_of(inputs, sizes)
        return {
            "modes": straight(inputs, sizes)[:, None] + weights["code.mean"][group],
            "log_weight": weights["log_share.mean"][group],
            "present": inputs["position"][:, -1] * 0,
        }


def group_of(inputs: dict[str, Array], sizes: Sizes) -> Array:
    """The group [n] of windows: by class, then by speed, then by whether the whole past is known."""
    xp = namespace(inputs["position"])
    speed = xp.sqrt((mean_velocity(inputs, sizes.dt) ** 2).sum(1))
    faster = xp.stack([speed >= least for least in SPEEDS], 1)
    return inputs["class_id"] * ALIKE + 2 * faster.sum(1) + (inputs["alive"][:, 0] > 0)


def _codes(
    off: np.ndarray, sizes: Sizes, seed: int, otherwise: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Codes [k, T, 2] m of deviations [n, T, 2] and their log-shares [k]; of too few, ``otherwise``."""
    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    if len(off) < FEW * sizes.modes:
        return otherwise
    rng = np.random.default_rng(seed)
    some = off[rng.permutation(len(off))[:MOST]].reshape(-1, 2 * sizes.future)
    with warnings.catch_warnings(action="ignore", category=ConvergenceWarning):  # objects at rest may all be alike
        found: Any = KMeans(sizes.modes, init="k-means++", n_init="auto", random_state=seed).fit(some)  # auto: once
    share = np.bincount(found.labels_, minlength=sizes.modes) + 1.0
    code = found.cluster_centers_.reshape(sizes.modes, sizes.future, 2).astype(np.float32)
    return code, np.log(share / share.sum()).astype(np.float32)
