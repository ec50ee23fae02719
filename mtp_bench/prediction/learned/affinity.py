"""Prediction from detections with soft assignments in place of a track.

The past of an object is built frame by frame, from its present box backwards. Each
earlier detection belongs to the object with a learned probability, its affinity. The
soft past is the mean of the detections, weighted by affinity. The network `modes`
predicts from it as from the past of a track.

After AffiniPred (Weng, Ivanovic, Kitani, Pavone 2022).
"""

from typing import NamedTuple

import numpy as np

from ..windows import Arrays, one_hot
from .around import (
    FINE,
    SIZE_SCALE,
    VELOCITY_SCALE,
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
    linear_shapes,
    mlp,
    namespace,
    standardised,
)
from .modes import NETWORK as MODES
from .network import Recipe, Sizes

HIDDEN = 32
PAIR = 18  # features of `_pairs` without those of the object
# m, distance from the expected position at which a detection has the affinity 1/2
# before training
GATE = 0.5
# m/s by which this distance grows with age, while few detections determine the velocity
SPEED = 6.0
FADE = 2.0  # log-odds lost per such distance
# weight of the expected position where no detection belongs to the object; a detection
# has weight 1
DOUBT = 0.1
LEAST_SQUARE = 1e-6  # m2, added to the square of a distance
SCORE_LIMIT = 5  # of a standardised score
# inputs of each detection
FRAME_INPUTS = ("near", "position", "velocity", "yaw", "score", "same", "ratio")


class AffinityNetwork:
    """Network "affinity"."""

    name = "affinity"
    around = True
    inputs = staticmethod(around_inputs)
    recipe = Recipe(on="tracklets")

    def shapes(self, sizes: Sizes) -> Shapes:
        """Return shapes of `modes`, of a perceptron for pairs, and of statistics.

        A pair is one object and one detection near it.
        """
        score_shapes = {"score.mean": (1,), "score.spread": (1,)}
        return {**MODES.shapes(sizes), **_pair_shapes(sizes), **score_shapes}

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        is_known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Return random layers and the statistics of the training data.

        With these layers an affinity depends mostly on the distance.
        """
        # two scores more, so that the spread is above 0
        two_scores = np.array([0, 1], dtype=np.float32)
        score = np.append(inputs["score"][inputs["near"] > 0], two_scores)
        weights = initial(_pair_shapes(sizes), np.random.default_rng([seed, 1]))
        weights["score.mean"] = score.mean(keepdims=True)
        weights["score.spread"] = score.std(keepdims=True)
        past = soft_past(weights, inputs, sizes)
        return {**weights, **MODES.start(past, future, is_known, sizes, seed)}

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return modes, their log-weights (not normalised) and the present position."""
        return MODES.forward(weights, soft_past(weights, inputs, sizes), sizes)


NETWORK = AffinityNetwork()


class _Backward(NamedTuple):
    """State of the backward pass over frames: n objects."""

    last: Array  # [n, 2] m, where they were a frame later
    expected: Array  # [n, 2] m
    velocity: Array  # [n, 2] m/s
    count: Array  # [n] detections of the object in later frames
    age: float  # s, of the frame
    size_class: Array  # [n, 2 + C] size and class


class _SoftDetection(NamedTuple):
    """Means over the detections of a frame by their shares."""

    position: Array  # [n, 2] m; without a detection, the expected one
    velocity: Array  # [n, 2] m/s
    yaw: Array  # [n] rad
    score: Array  # [n]
    share: Array  # [n] of all detections together


def soft_past(weights: Weights, inputs: Inputs, sizes: Sizes) -> dict[str, Array]:
    """Return the past of n objects in the form of `local_inputs`.

    alive and taken are probabilities.
    """
    xp = namespace(inputs["near"])
    origin = inputs["position"][:, -1, 0] * 0  # zeros [n, 2]
    classes = one_hot(inputs["class_id"], len(sizes.classes), origin)
    size_class = xp.concatenate([inputs["size"][:, :2] / SIZE_SCALE, classes], 1)
    state = _Backward(origin, origin, origin, origin[:, 0], 0.0, size_class)
    steps: list[_SoftDetection] = []  # the latest first
    for frame in range(sizes.past):
        detections = {name: inputs[name][:, -1 - frame] for name in FRAME_INPUTS}
        steps.append(_soft_detection(weights, detections, state))
        state = _earlier_state(state, steps, sizes.dt)
    soft = {
        name: xp.stack([getattr(step, name) for step in reversed(steps)], 1)
        for name in _SoftDetection._fields
    }
    share = soft.pop("share")
    age = xp.flip(xp.cumsum(xp.ones_like(share), 1), (1,))  # frames, this one included
    hits = xp.log(xp.clip(share.sum(1), 1, None))
    oldest = xp.log(xp.clip(xp.amax(age * share, 1), 1, None))
    return {
        **soft,
        # the present box is given
        "alive": xp.concatenate([share[:, :-1], xp.ones_like(share[:, -1:])], 1),
        "taken": share,
        "counts": xp.stack([hits, oldest], 1),
        "size": inputs["size"],
        "class_id": inputs["class_id"],
    }


def _soft_detection(
    weights: Weights, detections: Inputs, state: _Backward
) -> _SoftDetection:
    """Return the soft detection of each object in a frame.

    ``detections``: arrays [n, M, ...] of the frame.
    """
    offset = detections["position"] - state.expected[:, None]
    gate = GATE + SPEED * state.age / (1 + state.count)
    # the root has a derivative at 0, too
    distance = namespace(offset).sqrt((offset**2).sum(2) + LEAST_SQUARE)
    learned = mlp(weights, "pair", _pairs(weights, detections, state), 3)[..., 0]
    share = shares(FADE * (1 - distance / gate[:, None]) + learned, detections["near"])
    total = share.sum(1)
    # the rest of the shares stands for the expected position
    doubt = DOUBT * (1 - total)
    share = share / (total + doubt)[:, None]
    doubt = doubt / (total + doubt)
    position = (share[..., None] * detections["position"]).sum(1)
    return _SoftDetection(
        position=position + doubt[:, None] * state.expected,
        velocity=(share[..., None] * detections["velocity"]).sum(1),
        yaw=(share * detections["yaw"]).sum(1),
        score=(share * detections["score"]).sum(1),
        share=total,
    )


def _pairs(weights: Weights, detections: Inputs, state: _Backward) -> Array:
    """Return features of objects with the detections near them.

    They are [n, M, PAIR + 2 + C].
    """
    xp = namespace(detections["near"])
    offset = detections["position"] - state.expected[:, None]
    moved = detections["position"] - state.last[:, None]
    score = standardised(weights, "score", detections["score"])
    scalars = [
        xp.sin(detections["yaw"]),
        xp.cos(detections["yaw"]) - 1,
        xp.clip(score, -SCORE_LIMIT, SCORE_LIMIT),
        detections["same"],
    ]
    of_object = [
        state.velocity / VELOCITY_SCALE,
        xp.log(1 + state.count)[:, None],
        state.size_class,
    ]
    row = xp.concatenate(of_object, 1)
    row = xp.concatenate([row, xp.ones_like(row[:, :1]) * state.age], 1)
    columns = [
        xp.arcsinh(offset / FINE),
        xp.arcsinh(moved / FINE),
        (detections["velocity"] - state.velocity[:, None]) / VELOCITY_SCALE,
        detections["velocity"] / VELOCITY_SCALE,
        detections["ratio"],
        xp.stack(scalars, 2),
        row[:, None] + xp.zeros_like(detections["near"])[:, :, None],
    ]
    return xp.concatenate(columns, 2)


def _earlier_state(
    state: _Backward, steps: list[_SoftDetection], dt: float
) -> _Backward:
    """Return the state a frame earlier.

    The velocity is fitted to all soft detections ``steps`` to here, the latest first.
    """
    xp = namespace(state.last)
    position = xp.stack([step.position for step in steps], 1)
    velocity = xp.stack([step.velocity for step in steps], 1)
    share = xp.stack([step.share for step in steps], 1)
    measured = (share[:, :, None] * velocity).sum(1)
    measured = measured / xp.clip(share.sum(1), 1, None)[:, None]
    age = (xp.cumsum(xp.ones_like(share), 1) - 1) * dt
    fitted = fitted_velocity(age, position, share, measured, dt)
    last = steps[-1].position
    return state._replace(
        last=last,
        expected=last - fitted * dt,
        velocity=fitted,
        count=share[:, 1:].sum(1),  # the present one does not determine the velocity
        age=state.age + dt,
    )


def _pair_shapes(sizes: Sizes) -> Shapes:
    return linear_shapes("pair", PAIR + 2 + len(sizes.classes), HIDDEN, HIDDEN, 1)
