"""Affinity: a past of soft assignments, found backwards from the present box, in place of a track.

Every earlier detection is the object's with a learned probability (after Weng, Ivanovic, Kitani, Pavone 2022,
AffiniPred: prediction from detections and affinities, without association). The soft past then goes where `modes` puts
that of a track.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...types import Ints
from ..windows import Surroundings, TrackWindows
from .around import FINE, around_inputs, fitted_velocity, shares
from .layers import Array, Weights, initial, linear_shapes, mlp, namespace
from .local import Arrays, one_hot
from .modes import Modes
from .network import Sizes

HIDDEN = 32
PAIR = 18  # numbers that `_pairs` gives
GATE = 0.5  # m: before training a detection so far from where it is expected is as likely the object's as not ...
SPEED = 6.0  # m/s: ... and farther, as long as little is known of the velocity
FADE = 2.0  # log-odds that are lost with each such distance
DOUBT = 0.1  # what a share of none counts where the object was, beside one of a detection
MODES = Modes()  # what comes after the soft past


class Affinity:
    """The network ``affinity``."""

    name = "affinity"

    def inputs(self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes) -> Arrays:
        """The detections around each window's present box; of the track nothing."""
        return around_inputs(windows, moment, seen, sizes)

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """The weights of `modes`, a perceptron for pairs of object and detection, and statistics of scores."""
        return {**MODES.shapes(sizes), **_trained(sizes), "score.mean": (1,), "score.spread": (1,)}

    def start(self, inputs: Arrays, future: np.ndarray, known: np.ndarray, sizes: Sizes, seed: int) -> Arrays:
        """Random layers; before training an affinity is little more than a distance."""
        score = np.append(inputs["score"][inputs["near"] > 0], np.array([0, 1], dtype=np.float32))  # never all alike
        weights = initial(_trained(sizes), np.random.default_rng([seed, 1]))
        weights |= {"score.mean": score.mean(keepdims=True), "score.spread": score.std(keepdims=True)}
        return {**weights, **MODES.start(soft_past(weights, inputs, sizes), future, known, sizes, seed)}

    def forward(self, weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> dict[str, Array]:
        """Modes, their log-weights (not normalised) and the present position."""
        return MODES.forward(weights, soft_past(weights, inputs, sizes), sizes)


class _Object(NamedTuple):
    """What is known of n objects in the frame that is looked at, on the way back."""

    last: Array  # [n, 2] m, where they were a frame later
    expected: Array  # [n, 2] m
    velocity: Array  # [n, 2] m/s
    found: Array  # [n] detections found in later frames
    age: float  # s, of the frame
    given: Array  # [n, 2 + C] size and class


class _Soft(NamedTuple):
    """What is found in a frame: means over the detections by their shares."""

    position: Array  # [n, 2] m; where nothing is found, where it is expected
    velocity: Array  # [n, 2] m/s
    yaw: Array  # [n] rad
    score: Array  # [n]
    found: Array  # [n] share of all detections


def soft_past(weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> dict[str, Array]:
    """The past of n objects as `local_inputs` gives that of tracks; alive and taken are probabilities."""
    xp, origin = namespace(inputs["near"]), inputs["position"][:, -1, 0] * 0
    given = xp.concatenate([inputs["size"][:, :2] / 5, one_hot(inputs["class_id"], len(sizes.classes), origin)], 1)
    now = _Object(origin, origin, origin, origin[:, 0], 0.0, given)
    back: list[_Soft] = []
    for frame in range(sizes.past):
        back.append(_found(weights, {name: inputs[name][:, -1 - frame] for name in FRAME}, now))
        now = _earlier(now, back, sizes.dt)
    soft = {name: xp.stack([getattr(step, name) for step in reversed(back)], 1) for name in _Soft._fields}
    found = soft.pop("found")
    age = xp.flip(xp.cumsum(xp.ones_like(found), 1), (1,))  # frames, this one included
    counts = [xp.log(xp.clip(found.sum(1), 1, None)), xp.log(xp.clip(xp.amax(age * found, 1), 1, None))]
    alive = xp.concatenate([found[:, :-1], xp.ones_like(found[:, -1:])], 1)  # now it is where it is said to be
    rest = {"alive": alive, "taken": found, "counts": xp.stack(counts, 1)}
    return {**soft, **rest, "size": inputs["size"], "class_id": inputs["class_id"]}


FRAME = ("near", "position", "velocity", "yaw", "score", "same", "ratio")  # of each detection


def _found(weights: Weights, seen: dict[str, Array], now: _Object) -> _Soft:
    """What is found among the detections ``seen`` [n, M, ...] of a frame."""
    far = seen["position"] - now.expected[:, None]
    gate = GATE + SPEED * now.age / (1 + now.found)
    distance = namespace(far).sqrt((far**2).sum(2) + 1e-6)
    learned = mlp(weights, "pair", _pairs(weights, seen, now), 3)[..., 0]
    share = shares(FADE * (1 - distance / gate[:, None]) + learned, seen["near"])
    found = share.sum(1)
    doubt = DOUBT * (1 - found)
    share, doubt = share / (found + doubt)[:, None], doubt / (found + doubt)
    mean = {name: (share[..., None] * seen[name]).sum(1) for name in ("position", "velocity")}
    position = mean["position"] + doubt[:, None] * now.expected
    return _Soft(position, mean["velocity"], (share * seen["yaw"]).sum(1), (share * seen["score"]).sum(1), found)


def _pairs(weights: Weights, seen: dict[str, Array], now: _Object) -> Array:
    """Each object beside each detection near it, as numbers [n, M, PAIR + 2 + C]."""
    xp = namespace(seen["near"])
    off = seen["position"] - now.expected[:, None]
    moved = seen["position"] - now.last[:, None]
    score = (seen["score"] - weights["score.mean"]) / weights["score.spread"]
    columns = [xp.arcsinh(off / FINE), xp.arcsinh(moved / FINE), (seen["velocity"] - now.velocity[:, None]) / 10]
    columns += [seen["velocity"] / 10, seen["ratio"]]
    scalars = [xp.sin(seen["yaw"]), xp.cos(seen["yaw"]) - 1, xp.clip(score, -5, 5), seen["same"]]
    of_object = xp.concatenate([now.velocity / 10, xp.log(1 + now.found)[:, None], now.given], 1)
    of_object = xp.concatenate([of_object, xp.ones_like(of_object[:, :1]) * now.age], 1)
    repeated = of_object[:, None] + xp.zeros_like(seen["near"])[:, :, None]
    return xp.concatenate([*columns, xp.stack(scalars, 2), repeated], 2)


def _earlier(now: _Object, back: list[_Soft], dt: float) -> _Object:
    """The objects a frame earlier; the velocity is of all that was found ``back`` to here, the latest first."""
    xp, last = namespace(now.last), back[-1]
    found = xp.stack([step.found for step in back], 1)
    measured = (found[:, :, None] * xp.stack([step.velocity for step in back], 1)).sum(1)
    measured = measured / xp.clip(found.sum(1), 1, None)[:, None]
    age = (xp.cumsum(xp.ones_like(found), 1) - 1) * dt
    position = xp.stack([step.position for step in back], 1)
    velocity = fitted_velocity(age, position, found, measured, dt)
    count = found[:, 1:].sum(1)  # what is found now says nothing of the velocity
    return now._replace(
        last=last.position, expected=last.position - velocity * dt, velocity=velocity, found=count, age=now.age + dt
    )


def _trained(sizes: Sizes) -> dict[str, tuple[int, ...]]:
    return linear_shapes("pair", PAIR + 2 + len(sizes.classes), HIDDEN, HIDDEN, 1)
