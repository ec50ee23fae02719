"""Affinity: a past of soft assignments, found backwards from the present box, in place of a track.

Every earlier detection is of the object with a learned probability (after Weng, Ivanovic, Kitani, Pavone 2022,
AffiniPred: prediction from detections and affinities, without association). `modes` then takes the soft past as that
of a track.
"""

from typing import NamedTuple

import numpy as np

from .around import FINE, around_inputs, fitted_velocity, shares
from .layers import Array, Weights, initial, linear_shapes, mlp, namespace
from .local import Arrays, one_hot
from .modes import NETWORK as MODES
from .network import Recipe, Sizes

HIDDEN = 32
PAIR = 18  # features of `_pairs` without those of the object
GATE = 0.5  # m from the expected position: before training, a detection there is of the object with probability 1/2 ...
SPEED = 6.0  # m/s by which this distance grows with age, while few detections determine the velocity
FADE = 2.0  # log-odds lost per such distance
DOUBT = 0.1  # weight of the expected position for the share of "none", beside that of a detection


class AffinityNetwork:
    """Network "affinity"."""

    name = "affinity"
    around = True
    inputs = staticmethod(around_inputs)
    recipe = Recipe(on="tracklets")

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """The weights of `modes`, a perceptron for pairs of object and detection, and statistics of scores."""
        return {
            **MODES.shapes(sizes),
            **_trained(sizes),
            "score.mean": (1,),
            "score.spread": (1,),
        }

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Random layers; before training an affinity is mostly a distance."""
        score = np.append(
            inputs["score"][inputs["near"] > 0], np.array([0, 1], dtype=np.float32)
        )  # never all alike
        weights = initial(_trained(sizes), np.random.default_rng([seed, 1]))
        weights |= {
            "score.mean": score.mean(keepdims=True),
            "score.spread": score.std(keepdims=True),
        }
        return {
            **weights,
            **MODES.start(
                soft_past(weights, inputs, sizes), future, known, sizes, seed
            ),
        }

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """Modes, their log-weights (not normalised) and the present position."""
        return MODES.forward(weights, soft_past(weights, inputs, sizes), sizes)


NETWORK = AffinityNetwork()


class _Backward(NamedTuple):
    """State of the backward pass over frames: n objects."""

    last: Array  # [n, 2] m, where they were a frame later
    expected: Array  # [n, 2] m
    velocity: Array  # [n, 2] m/s
    found: Array  # [n] detections found in later frames
    age: float  # s, of the frame
    given: Array  # [n, 2 + C] size and class


class _SoftDetection(NamedTuple):
    """Means over the detections of a frame by their shares."""

    position: Array  # [n, 2] m; without a detection, the expected one
    velocity: Array  # [n, 2] m/s
    yaw: Array  # [n] rad
    score: Array  # [n]
    found: Array  # [n] share of all detections


def soft_past(
    weights: Weights, inputs: dict[str, Array], sizes: Sizes
) -> dict[str, Array]:
    """The past of n objects in the form of `local_inputs`; alive and taken are probabilities."""
    xp, origin = namespace(inputs["near"]), inputs["position"][:, -1, 0] * 0
    given = xp.concatenate(
        [
            inputs["size"][:, :2] / 5,
            one_hot(inputs["class_id"], len(sizes.classes), origin),
        ],
        1,
    )
    now = _Backward(origin, origin, origin, origin[:, 0], 0.0, given)
    back: list[_SoftDetection] = []
    for frame in range(sizes.past):
        back.append(
            _found(weights, {name: inputs[name][:, -1 - frame] for name in FRAME}, now)
        )
        now = _earlier(now, back, sizes.dt)
    soft = {
        name: xp.stack([getattr(step, name) for step in reversed(back)], 1)
        for name in _SoftDetection._fields
    }
    found = soft.pop("found")
    age = xp.flip(xp.cumsum(xp.ones_like(found), 1), (1,))  # frames, this one included
    counts = [
        xp.log(xp.clip(found.sum(1), 1, None)),
        xp.log(xp.clip(xp.amax(age * found, 1), 1, None)),
    ]
    alive = xp.concatenate(
        [found[:, :-1], xp.ones_like(found[:, -1:])], 1
    )  # the present box is given
    rest = {"alive": alive, "taken": found, "counts": xp.stack(counts, 1)}
    return {**soft, **rest, "size": inputs["size"], "class_id": inputs["class_id"]}


FRAME = (
    "near",
    "position",
    "velocity",
    "yaw",
    "score",
    "same",
    "ratio",
)  # of each detection


def _found(weights: Weights, seen: dict[str, Array], now: _Backward) -> _SoftDetection:
    """The soft detection of each object among the detections ``seen`` [n, M, ...] of a frame."""
    far = seen["position"] - now.expected[:, None]
    gate = GATE + SPEED * now.age / (1 + now.found)
    distance = namespace(far).sqrt((far**2).sum(2) + 1e-6)
    learned = mlp(weights, "pair", _pairs(weights, seen, now), 3)[..., 0]
    share = shares(FADE * (1 - distance / gate[:, None]) + learned, seen["near"])
    found = share.sum(1)
    doubt = DOUBT * (1 - found)
    share, doubt = share / (found + doubt)[:, None], doubt / (found + doubt)
    mean = {
        name: (share[..., None] * seen[name]).sum(1)
        for name in ("position", "velocity")
    }
    position = mean["position"] + doubt[:, None] * now.expected
    yaw, score = ((share * seen[name]).sum(1) for name in ("yaw", "score"))
    return _SoftDetection(position, mean["velocity"], yaw, score, found)


def _pairs(weights: Weights, seen: dict[str, Array], now: _Backward) -> Array:
    """Features [n, M, PAIR + 2 + C] of each object with each detection near it."""
    xp = namespace(seen["near"])
    off = seen["position"] - now.expected[:, None]
    moved = seen["position"] - now.last[:, None]
    score = (seen["score"] - weights["score.mean"]) / weights["score.spread"]
    columns = [
        xp.arcsinh(off / FINE),
        xp.arcsinh(moved / FINE),
        (seen["velocity"] - now.velocity[:, None]) / 10,
    ]
    columns += [seen["velocity"] / 10, seen["ratio"]]
    scalars = [
        xp.sin(seen["yaw"]),
        xp.cos(seen["yaw"]) - 1,
        xp.clip(score, -5, 5),
        seen["same"],
    ]
    of_object = xp.concatenate(
        [now.velocity / 10, xp.log(1 + now.found)[:, None], now.given], 1
    )
    of_object = xp.concatenate([of_object, xp.ones_like(of_object[:, :1]) * now.age], 1)
    repeated = of_object[:, None] + xp.zeros_like(seen["near"])[:, :, None]
    return xp.concatenate([*columns, xp.stack(scalars, 2), repeated], 2)


def _earlier(now: _Backward, back: list[_SoftDetection], dt: float) -> _Backward:
    """The state a frame earlier; the velocity is fitted to all soft detections ``back`` to here, the latest first."""
    xp, last = namespace(now.last), back[-1]
    found = xp.stack([step.found for step in back], 1)
    measured = (found[:, :, None] * xp.stack([step.velocity for step in back], 1)).sum(
        1
    )
    measured = measured / xp.clip(found.sum(1), 1, None)[:, None]
    age = (xp.cumsum(xp.ones_like(found), 1) - 1) * dt
    velocity = fitted_velocity(
        age, xp.stack([step.position for step in back], 1), found, measured, dt
    )
    count = found[:, 1:].sum(1)  # the present one does not determine the velocity
    return now._replace(
        last=last.position,
        expected=last.position - velocity * dt,
        velocity=velocity,
        found=count,
        age=now.age + dt,
    )


def _trained(sizes: Sizes) -> dict[str, tuple[int, ...]]:
    return linear_shapes("pair", PAIR + 2 + len(sizes.classes), HIDDEN, HIDDEN, 1)
