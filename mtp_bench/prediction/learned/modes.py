"""Modes: a perceptron that gives k futures with weights, each a correction of constant velocity.

One future of several must be right, so the modes divide the possibilities among them (multiple choice learning:
Guzman-Rivera et al. 2012; for trajectories Cui et al. 2019).
"""

import numpy as np

from ...core import Ints
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights, initial, linear_shapes, mlp, namespace
from .local import PER_FRAME, Arrays, history, local_inputs, mean_velocity, one_hot
from .network import Recipe, Sizes

HIDDEN = 256
LAYERS = 3
PER_STATIC = 4  # features of a window beside its past; they come twice, the second time 0 unless the track coasts
LEAST_SPREAD = 1e-3  # of a feature that is standardised


class Modes:
    """Network "modes"."""

    name = "modes"
    around = False
    recipe = Recipe()

    def inputs(
        self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes
    ) -> Arrays:
        """The past of each window alone: tracks that share a window share its forecasts."""
        return local_inputs(windows)

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """A perceptron from the past to all modes, and statistics of inputs and outputs."""
        inputs = self.features(sizes)
        outputs = sizes.modes * (2 * sizes.future + 1) + 2
        trained = linear_shapes("net", inputs, *[HIDDEN] * (LAYERS - 1), outputs)
        return {
            **trained,
            "input.mean": (inputs,),
            "input.spread": (inputs,),
            "output.spread": (sizes.future, 1),
        }

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Random layers; inputs are standardised, and outputs are in units of the error of constant velocity."""
        seen = self.encoded(inputs, sizes)
        error = np.linalg.norm(future - straight(inputs, sizes), axis=-1)
        trained = {
            name: shape
            for name, shape in self.shapes(sizes).items()
            if name.startswith("net.")
        }
        weights = initial(trained, np.random.default_rng(seed))
        weights |= {
            "input.mean": seen.mean(axis=0),
            "input.spread": np.maximum(seen.std(axis=0), LEAST_SPREAD),
        }
        return {**weights, "output.spread": spread_of(error, known)}

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """Modes, their log-weights (not normalised) and the present position."""
        xp = namespace(inputs["position"])
        x = (self.encoded(inputs, sizes) - weights["input.mean"]) / weights[
            "input.spread"
        ]
        out = mlp(weights, "net", xp.clip(x, -10, 10), LAYERS)
        split = sizes.modes * 2 * sizes.future
        residual = (
            out[:, :split].reshape(-1, sizes.modes, sizes.future, 2)
            * weights["output.spread"]
        )
        return {
            "modes": self.moved(inputs, residual, sizes),
            "log_weight": out[:, split : split + sizes.modes],
            "present": out[:, split + sizes.modes :] * weights["output.spread"][0],
        }

    def features(self, sizes: Sizes) -> int:
        """Number of features of `encoded`."""
        return sizes.past * PER_FRAME + 2 * PER_STATIC + len(sizes.classes)

    def encoded(self, inputs: dict[str, Array], sizes: Sizes) -> Array:
        """Features of n windows, one row each."""
        xp = namespace(inputs["position"])
        past = history(inputs).reshape(len(inputs["position"]), -1)
        static = xp.concatenate([inputs["size"][:, :2], inputs["counts"]], 1)
        coasting = 1 - inputs["taken"][:, -1:]
        classes = one_hot(inputs["class_id"], len(sizes.classes), inputs["size"])
        return xp.concatenate([past, static, static * coasting, classes], 1)

    def moved(self, inputs: dict[str, Array], residual: Array, sizes: Sizes) -> Array:
        """Futures [n, S, T, 2] m of corrections ``residual`` of constant velocity."""
        return straight(inputs, sizes)[:, None] + residual


NETWORK = Modes()


def straight(inputs: dict[str, Array], sizes: Sizes) -> Array:
    """Constant velocity: [n, T, 2] m."""
    xp = namespace(inputs["position"])
    velocity = mean_velocity(inputs, sizes.dt)
    return xp.cumsum(xp.stack([velocity * sizes.dt] * sizes.future, 1), 1)


def spread_of(value: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Root mean square [T, 1] of each step, over the rows of ``value`` [n, T, ...] that are ``known`` [n, T]."""
    steps = range(value.shape[1])
    spread = np.array(
        [
            np.sqrt(np.mean(value[known[:, t], t] ** 2)) if known[:, t].any() else 0.0
            for t in steps
        ]
    )
    return np.asarray(np.maximum(spread, LEAST_SPREAD)[:, None], dtype=np.float32)
