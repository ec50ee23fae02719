"""Modes: a perceptron that gives k futures with weights.

Each future is a correction of constant velocity. One future of several must be right,
so the modes divide the possibilities among them (multiple choice learning:
Guzman-Rivera et al. 2012; for trajectories Cui et al. 2019).
"""

import numpy as np

from ...core import Ints
from ..windows import (
    PER_FRAME,
    Arrays,
    Surroundings,
    TrackWindows,
    history,
    local_inputs,
    mean_velocity,
    one_hot,
)
from .layers import (
    Array,
    Inputs,
    Shapes,
    Weights,
    initial,
    linear_shapes,
    mlp,
    namespace,
    standardised,
)
from .network import Recipe, Sizes

HIDDEN = 256
LAYERS = 3
# features of a window beside its past; they come twice, the second time 0 unless the
# track coasts
PER_STATIC = 4
LEAST_SPREAD = 1e-3  # of a feature that is standardised


class Modes:
    """Network "modes"."""

    name = "modes"
    around = False
    recipe = Recipe()

    def inputs(
        self,
        windows: TrackWindows,
        moment: Ints,
        surroundings: Surroundings,
        sizes: Sizes,
    ) -> Arrays:
        """Return the past of each window alone.

        Tracks that share a window share its forecasts.
        """
        return local_inputs(windows)

    def shapes(self, sizes: Sizes) -> Shapes:
        """Return the shapes of a perceptron from the past to all modes.

        Shapes of statistics of inputs and outputs are among them.
        """
        inputs = self.features(sizes)
        return {
            **self._layers(sizes),
            "input.mean": (inputs,),
            "input.spread": (inputs,),
            "output.spread": (sizes.future, 1),
        }

    def _layers(self, sizes: Sizes) -> Shapes:
        hidden = [HIDDEN] * (LAYERS - 1)
        return linear_shapes("net", self.features(sizes), *hidden, outputs_of(sizes))

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        is_known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Return random layers and the statistics of the training data.

        Inputs are standardised; outputs are in units of the error of constant velocity.
        """
        features = self.encoded(inputs, sizes)
        error = np.linalg.norm(future - straight_future(inputs, sizes), axis=-1)
        return {
            **initial(self._layers(sizes), np.random.default_rng(seed)),
            **statistics("input", features),
            "output.spread": spread_of(error, is_known),
        }

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return modes, their log-weights (not normalised) and the present position."""
        x = standardised(weights, "input", self.encoded(inputs, sizes))
        output = mlp(weights, "net", x, LAYERS)
        residual, log_weight, present = split_output(output, sizes)
        spread = weights["output.spread"]
        return {
            "modes": self.moved(inputs, residual * spread, sizes),
            "log_weight": log_weight,
            "present": present * spread[0],
        }

    def features(self, sizes: Sizes) -> int:
        """Return the number of features of `encoded`."""
        return sizes.past * PER_FRAME + 2 * PER_STATIC + len(sizes.classes)

    def encoded(self, inputs: Inputs, sizes: Sizes) -> Array:
        """Return features of n windows, one row each."""
        xp = namespace(inputs["position"])
        past = history(inputs).reshape(len(inputs["position"]), -1)
        static = xp.concatenate([inputs["size"][:, :2], inputs["counts"]], 1)
        coasting = 1 - inputs["taken"][:, -1:]
        classes = one_hot(inputs["class_id"], len(sizes.classes), inputs["size"])
        return xp.concatenate([past, static, static * coasting, classes], 1)

    def moved(self, inputs: Inputs, residual: Array, sizes: Sizes) -> Array:
        """Return futures [n, S, T, 2] m: constant velocity and ``residual``."""
        return straight_future(inputs, sizes)[:, None] + residual


NETWORK = Modes()


def outputs_of(sizes: Sizes) -> int:
    """Return the number of outputs: all modes with log-weights, and the present."""
    return sizes.modes * (2 * sizes.future + 1) + 2


def split_output(output: Array, sizes: Sizes) -> tuple[Array, Array, Array]:
    """Return residuals [n, S, T, 2], log-weights [n, S] and the present [n, 2]."""
    split = sizes.modes * 2 * sizes.future
    residual = output[:, :split].reshape(-1, sizes.modes, sizes.future, 2)
    log_weight = output[:, split : split + sizes.modes]
    return residual, log_weight, output[:, split + sizes.modes :]


def statistics(name: str, features: np.ndarray) -> Arrays:
    """Return mean and spread of ``features`` [n, F], for `standardised`."""
    spread = np.maximum(features.std(axis=0), LEAST_SPREAD)
    return {f"{name}.mean": features.mean(axis=0), f"{name}.spread": spread}


def at_velocity(velocity: Array, sizes: Sizes) -> Array:
    """Return offsets [n, T, 2] m at a constant velocity [n, 2] m/s."""
    xp = namespace(velocity)
    return xp.cumsum(xp.stack([velocity * sizes.dt] * sizes.future, 1), 1)


def straight_future(inputs: Inputs, sizes: Sizes) -> Array:
    """Return the future [n, T, 2] m at constant velocity."""
    return at_velocity(mean_velocity(inputs, sizes.dt), sizes)


def spread_of(value: np.ndarray, is_known: np.ndarray) -> np.ndarray:
    """Return the root mean square [T, 1] of each step.

    The mean is over the rows of ``value`` [n, T, ...] where ``is_known`` [n, T].
    """
    spread = np.zeros(value.shape[1])
    for step in range(value.shape[1]):
        rows = is_known[:, step]
        if rows.any():
            spread[step] = np.sqrt(np.mean(value[rows, step] ** 2))
    return np.asarray(np.maximum(spread, LEAST_SPREAD)[:, None], dtype=np.float32)
