"""Tracking-free: futures of an object from all detections around it, without association.

A set encoder in place of a track (after Trabelsi et al. 2021, "Drowned out by the noise"): every detection of the last
frames is described relative to the object's present box, and pooled by attention.
"""

import numpy as np

from .around import FINE, ages, around_inputs, fitted_velocity, shares
from .layers import (
    Array,
    Weights,
    initial,
    linear,
    linear_shapes,
    mlp,
    namespace,
    relu,
    sigmoid,
)
from .local import Arrays, one_hot
from .modes import LEAST_SPREAD, spread_of
from .network import Recipe, Sizes

HIDDEN = 48  # features per detection
VALUES = 16  # features that are pooled from each frame
DECODER = 256
FASTEST = 40.0  # m/s
NOISE = 0.3  # m, of a detected position
ACCELERATION = 1.5  # m/s2 by which objects deviate from constant velocity
PER_DETECTION = 14  # features of `described`
RESIDUAL = 0.2  # size of corrections of a constant velocity, beside standing still
FAR = 1e6  # m2, of an empty place
PER_FIT = 3  # more features: the fit of a detection to a velocity


class TrackingFree:
    """Network "tracking_free"."""

    name = "tracking_free"
    around = True
    inputs = staticmethod(around_inputs)
    recipe = Recipe(epochs=40, on="tracklets")

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Perceptrons for detections, their attention and all modes, and statistics of inputs and outputs."""
        spread = {"around.mean": (PER_DETECTION,), "around.spread": (PER_DETECTION,)}
        return {**_trained(sizes), **spread, "output.spread": (sizes.future, 1)}

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Random layers; detections are standardised, and outputs are in units of the error of standing still."""
        seen = described(inputs, sizes)[inputs["near"] > 0]
        seen = seen if len(seen) else np.zeros((1, PER_DETECTION), np.float32)
        weights = initial(_trained(sizes), np.random.default_rng(seed))
        weights |= {
            "around.mean": seen.mean(axis=0),
            "around.spread": np.maximum(seen.std(axis=0), LEAST_SPREAD),
        }
        return {
            **weights,
            "output.spread": spread_of(np.linalg.norm(future, axis=-1), known),
        }

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """Modes, their log-weights (not normalised) and the present position."""
        xp = namespace(inputs["position"])
        velocity, pooled = encoded(weights, inputs, sizes)
        out = mlp(weights, "net", pooled, 3)
        split = sizes.modes * 2 * sizes.future
        residual = (
            out[:, :split].reshape(-1, sizes.modes, sizes.future, 2)
            * weights["output.spread"]
            * RESIDUAL
        )
        straight = xp.cumsum(xp.stack([velocity * sizes.dt] * sizes.future, 1), 1)
        return {
            "modes": straight[:, None] + residual,
            "log_weight": out[:, split : split + sizes.modes],
            "present": out[:, split + sizes.modes :]
            * weights["output.spread"][0]
            * RESIDUAL,
        }


NETWORK = TrackingFree()


def _trained(sizes: Sizes) -> dict[str, tuple[int, ...]]:
    of_object = 2 + len(sizes.classes)
    outputs = sizes.modes * (2 * sizes.future + 1) + 2
    pooled = sizes.past * (VALUES + 3) + HIDDEN + 4 + of_object
    return {
        **linear_shapes("token", PER_DETECTION + of_object, HIDDEN, HIDDEN),
        **linear_shapes("first", HIDDEN, 1),
        **linear_shapes("fit", HIDDEN + PER_FIT, HIDDEN, HIDDEN),
        **linear_shapes("second", HIDDEN, 2 + VALUES),
        **linear_shapes("net", pooled, DECODER, DECODER, outputs),
    }


def encoded(
    weights: Weights, inputs: dict[str, Array], sizes: Sizes
) -> tuple[Array, Array]:
    """The velocity [n, 2] m/s that the detections agree on, and features of n objects, one row each.

    Detections vote for a velocity, are compared with it, vote again, and are pooled, frame by frame and altogether.
    """
    xp, near, age = (
        namespace(inputs["near"]),
        inputs["near"],
        ages(inputs["near"], sizes.dt),
    )
    classes = one_hot(inputs["class_id"], len(sizes.classes), near[:, 0])
    of_object = xp.concatenate([inputs["size"][:, :2] / 5, classes], 1)
    seen = (described(inputs, sizes) - weights["around.mean"]) / weights[
        "around.spread"
    ]
    repeated = of_object[:, None, None] + xp.zeros_like(near)[..., None]
    token = relu(
        mlp(weights, "token", xp.concatenate([xp.clip(seen, -10, 10), repeated], 3), 2)
    )
    vote = sigmoid(linear(weights, "first.0", token)[..., 0]) * near
    velocity = voted(inputs, vote, sizes.dt)
    token = relu(
        mlp(
            weights,
            "fit",
            xp.concatenate(
                [token, off_line(inputs, velocity, age), vote[..., None]], 3
            ),
            2,
        )
    )
    output = linear(weights, "second.0", token)
    vote = sigmoid(output[..., 0]) * near
    velocity = voted(inputs, vote, sizes.dt)
    value = xp.concatenate(
        [
            off_line(inputs, velocity, age),
            output[..., 2:],
            xp.ones_like(near)[..., None],
        ],
        3,
    )
    share = shares(
        output[..., 1].reshape(-1, near.shape[2]), near.reshape(-1, near.shape[2])
    ).reshape(near.shape)
    by_frame = (
        (share[..., None] * value).sum(2).reshape(len(near), -1)
    )  # shares within each frame
    highest = xp.amax(xp.amax(token * near[..., None], 1), 1)
    count = xp.log(1 + xp.stack([near.sum((1, 2)), vote.sum((1, 2))], 1))
    return velocity, xp.concatenate(
        [by_frame, highest, velocity / 10, count, of_object], 1
    )


def off_line(inputs: dict[str, Array], velocity: Array, age: Array) -> Array:
    """Distance [n, P, M, 2] of detections from where an object of a ``velocity`` [n, 2] was; see FINE."""
    off = inputs["position"] + velocity[:, None, None] * age[..., None]
    return namespace(off).arcsinh(off * inputs["near"][..., None] / FINE)


def voted(inputs: dict[str, Array], vote: Array, dt: float) -> Array:
    """Velocity [n, 2] m/s from positions and measured velocities of detections, by votes [n, P, M]."""
    n, slots = len(vote), vote.shape[1] * vote.shape[2]
    position, measured = (
        inputs[name].reshape(n, slots, 2) for name in ("position", "velocity")
    )
    age, vote = ages(vote, dt).reshape(n, slots), vote.reshape(n, slots)
    prior = (vote[:, :, None] * measured).sum(1) / (vote.sum(1) + 1e-3)[:, None]
    return fitted_velocity(age, position, vote, prior, dt)


def described(inputs: dict[str, Array], sizes: Sizes) -> Array:
    """Features [n, P, M, PER_DETECTION] of the detections."""
    xp, near = namespace(inputs["near"]), inputs["near"]
    age = ages(near, sizes.dt)
    needed = (
        -inputs["position"] / xp.clip(age, sizes.dt, None)[..., None]
    )  # velocity, if it is of the object
    columns = [
        inputs["position"],
        xp.clip(needed, -FASTEST, FASTEST),
        inputs["velocity"],
        inputs["ratio"],
    ]
    scalars = [
        xp.sin(inputs["yaw"]),
        xp.cos(inputs["yaw"]) - 1,
        inputs["score"],
        inputs["same"],
        age,
    ]
    scalars += [support(needed, inputs["position"], near, sizes.dt)]
    return xp.concatenate([*columns, xp.stack(scalars, 3)], 3)


def support(velocity: Array, position: Array, near: Array, dt: float) -> Array:
    """Frames that agree with each detection's ``velocity`` [n, P, M, 2], as a number [n, P, M] from 0 to P - 1.

    A frame agrees by its detection that is nearest to where an object of that velocity was: 1 there, less with its
    distance in units of the noise of both positions and of possible acceleration.
    """
    xp, frames = namespace(near), near.shape[1]
    age = (frames - xp.cumsum(xp.ones_like(near[0, :, 0]), 0)) * dt
    total = xp.zeros_like(near)
    for frame in range(frames - 1):
        then = age[frame]
        x, y = (
            position[:, None, None, frame, :, i] + (velocity[..., i] * then)[..., None]
            for i in range(2)
        )
        off2 = x * x + y * y + FAR * (1 - near[:, None, None, frame])
        width = NOISE * (
            1 + then / xp.clip(age, dt, None)
        ) + ACCELERATION / 2 * then * xp.abs(then - age)
        total = total + xp.exp(-xp.amin(off2, 3) / (2 * width**2)[None, :, None])
    return total * near * (age > 0)[None, :, None]
