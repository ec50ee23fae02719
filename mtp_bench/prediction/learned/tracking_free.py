"""Tracking-free: futures of an object from all detections around it.

Detections are not associated. A set encoder stands in place of a track (after Trabelsi
et al. 2021, "Drowned out by the noise"). Every detection of the last frames is
described relative to the object's present box, and pooled by attention.
"""

import numpy as np

from ..windows import Arrays, one_hot
from .around import (
    FINE,
    SIZE_SCALE,
    VELOCITY_SCALE,
    ages,
    around_inputs,
    fitted_velocity,
    shares,
)
from .layers import (
    Array,
    Inputs,
    Shapes,
    Weights,
    initial,
    linear,
    linear_shapes,
    mlp,
    namespace,
    relu,
    sigmoid,
    standardised,
)
from .modes import at_velocity, outputs_of, split_output, spread_of, statistics
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
LEAST_VOTES = 1e-3  # added to the sum of votes, which may be 0
PER_FIT = 3  # more features: the fit of a detection to a velocity


class TrackingFree:
    """Network "tracking_free"."""

    name = "tracking_free"
    around = True
    inputs = staticmethod(around_inputs)
    recipe = Recipe(epochs=40, on="tracklets")

    def shapes(self, sizes: Sizes) -> Shapes:
        """Return shapes of perceptrons and of statistics of inputs and outputs.

        The perceptrons are for detections, their attention and all modes.
        """
        return {
            **_trained(sizes),
            "around.mean": (PER_DETECTION,),
            "around.spread": (PER_DETECTION,),
            "output.spread": (sizes.future, 1),
        }

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        is_known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Return random layers and the statistics of the training data.

        Detections are standardised; outputs are in units of the error of standing
        still.
        """
        features = described(inputs, sizes)[inputs["near"] > 0]
        if not len(features):
            features = np.zeros((1, PER_DETECTION), np.float32)
        return {
            **initial(_trained(sizes), np.random.default_rng(seed)),
            **statistics("around", features),
            "output.spread": spread_of(np.linalg.norm(future, axis=-1), is_known),
        }

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return modes, their log-weights (not normalised) and the present position."""
        velocity, pooled = encoded(weights, inputs, sizes)
        output = mlp(weights, "net", pooled, 3)
        residual, log_weight, present = split_output(output, sizes)
        spread = weights["output.spread"]
        correction = residual * spread * RESIDUAL
        return {
            "modes": at_velocity(velocity, sizes)[:, None] + correction,
            "log_weight": log_weight,
            "present": present * spread[0] * RESIDUAL,
        }


NETWORK = TrackingFree()


def _trained(sizes: Sizes) -> Shapes:
    of_object = 2 + len(sizes.classes)
    pooled = sizes.past * (VALUES + 3) + HIDDEN + 4 + of_object
    return {
        **linear_shapes("token", PER_DETECTION + of_object, HIDDEN, HIDDEN),
        **linear_shapes("first", HIDDEN, 1),
        **linear_shapes("fit", HIDDEN + PER_FIT, HIDDEN, HIDDEN),
        **linear_shapes("second", HIDDEN, 2 + VALUES),
        **linear_shapes("net", pooled, DECODER, DECODER, outputs_of(sizes)),
    }


def encoded(weights: Weights, inputs: Inputs, sizes: Sizes) -> tuple[Array, Array]:
    """Return the agreed velocities [n, 2] m/s and features of n objects.

    Detections vote for a velocity, are compared with it, vote again, and are pooled,
    frame by frame and altogether.
    """
    near = inputs["near"]
    xp = namespace(near)
    age = ages(near, sizes.dt)
    classes = one_hot(inputs["class_id"], len(sizes.classes), near[:, 0])
    of_object = xp.concatenate([inputs["size"][:, :2] / SIZE_SCALE, classes], 1)
    features = standardised(weights, "around", described(inputs, sizes))
    repeated = of_object[:, None, None] + xp.zeros_like(near)[..., None]
    columns = xp.concatenate([features, repeated], 3)
    token = relu(mlp(weights, "token", columns, 2))

    vote = sigmoid(linear(weights, "first.0", token)[..., 0]) * near
    offset = off_line(inputs, voted(inputs, vote, sizes.dt), age)
    columns = xp.concatenate([token, offset, vote[..., None]], 3)
    token = relu(mlp(weights, "fit", columns, 2))

    output = linear(weights, "second.0", token)
    vote = sigmoid(output[..., 0]) * near
    velocity = voted(inputs, vote, sizes.dt)
    offset = off_line(inputs, velocity, age)
    ones = xp.ones_like(near)[..., None]
    value = xp.concatenate([offset, output[..., 2:], ones], 3)

    slots = near.shape[2]
    logit = output[..., 1].reshape(-1, slots)
    # shares within each frame
    share = shares(logit, near.reshape(-1, slots)).reshape(near.shape)
    by_frame = (share[..., None] * value).sum(2).reshape(len(near), -1)
    highest = xp.amax(xp.amax(token * near[..., None], 1), 1)
    log_count = xp.log(1 + xp.stack([near.sum((1, 2)), vote.sum((1, 2))], 1))
    pooled = [by_frame, highest, velocity / VELOCITY_SCALE, log_count, of_object]
    return velocity, xp.concatenate(pooled, 1)


def off_line(inputs: Inputs, velocity: Array, age: Array) -> Array:
    """Return offsets [n, P, M, 2] of detections from a constant velocity.

    An object with ``velocity`` [n, 2] was at -velocity x age. Offsets are in units of
    FINE, logarithmic beyond.
    """
    offset = inputs["position"] + velocity[:, None, None] * age[..., None]
    return namespace(offset).arcsinh(offset * inputs["near"][..., None] / FINE)


def voted(inputs: Inputs, vote: Array, dt: float) -> Array:
    """Return the velocity [n, 2] m/s that detections agree on.

    ``vote`` [n, P, M]: weight of each detection.
    """
    count = len(vote)
    slots = vote.shape[1] * vote.shape[2]
    position = inputs["position"].reshape(count, slots, 2)
    measured = inputs["velocity"].reshape(count, slots, 2)
    age = ages(vote, dt).reshape(count, slots)
    weight = vote.reshape(count, slots)
    prior = (weight[:, :, None] * measured).sum(1) / (weight.sum(1) + LEAST_VOTES)[
        :, None
    ]
    return fitted_velocity(age, position, weight, prior, dt)


def described(inputs: Inputs, sizes: Sizes) -> Array:
    """Return features [n, P, M, PER_DETECTION] of the detections."""
    near = inputs["near"]
    xp = namespace(near)
    age = ages(near, sizes.dt)
    # velocity that the object needs, if the detection is of it
    needed = -inputs["position"] / xp.clip(age, sizes.dt, None)[..., None]
    scalars = [
        xp.sin(inputs["yaw"]),
        xp.cos(inputs["yaw"]) - 1,
        inputs["score"],
        inputs["same"],
        age,
        support(needed, inputs["position"], near, sizes.dt),
    ]
    columns = [
        inputs["position"],
        xp.clip(needed, -FASTEST, FASTEST),
        inputs["velocity"],
        inputs["ratio"],
        xp.stack(scalars, 3),
    ]
    return xp.concatenate(columns, 3)


def support(velocity: Array, position: Array, near: Array, dt: float) -> Array:
    """Return how many frames [n, P, M] agree with each detection's ``velocity``.

    Of n objects, P frames and M detections in each: ``velocity`` [n, P, M, 2] leads a
    detection to the object's place now, the origin of ``position`` [n, P, M, 2];
    ``near`` is 1 for a detection, 0 for an empty place. The numbers are from 0 to
    P - 1. A frame agrees by its detection that is nearest to where an object of that
    velocity was: 1 there, less with its distance in units of the noise of both
    positions and of possible acceleration. The last frame is left out: all lines end
    there.
    """
    xp = namespace(near)
    frames = near.shape[1]
    age = (frames - xp.cumsum(xp.ones_like(near[0, :, 0]), 0)) * dt
    total = xp.zeros_like(near)
    for frame in range(frames - 1):
        frame_age = age[frame]
        shift = velocity * frame_age
        x = position[:, None, None, frame, :, 0] + shift[..., 0, None]
        y = position[:, None, None, frame, :, 1] + shift[..., 1, None]
        distance2 = x * x + y * y + FAR * (1 - near[:, None, None, frame])
        # the error of a velocity grows with the time that it is followed
        noise = NOISE * (1 + frame_age / xp.clip(age, dt, None))
        width = noise + ACCELERATION / 2 * frame_age * xp.abs(frame_age - age)
        gap = xp.amin(distance2, 3) / (2 * width**2)[None, :, None]
        total = total + xp.exp(-gap)
    return total * near * (age > 0)[None, :, None]
