"""PTP: the forecasting branch of Weng, Yuan, Kitani 2021, the predictor of the MTP paper.

A recurrent encoder of each tracklet, a graph network over the objects of the frame, a conditional variational
autoencoder with recurrent encoder and decoder, and on top of it a diversity sampling function, which maps the context
of an object to k codes (Yuan, Kitani 2019). It is trained with the losses of its successor DLow (Yuan, Kitani 2020),
whose codes are z_k = A_k eps + b_k; here eps is 0, in training as at work, so that forecasts are deterministic. All k
futures have the same weight. Before the sampling function is trained, its codes are k fixed draws of the prior.

Neither code nor weights of PTP are public. What differs: all is in the heading frame of the object, the decoder gives
corrections of constant velocity, and messages between objects hold the position of the other one.
"""

import numpy as np

from ...core import Ints
from ..windows import Surroundings, TrackWindows
from .layers import (
    Array,
    Weights,
    initial,
    linear,
    lstm,
    lstm_cell,
    lstm_shapes,
    lstm_states,
    mlp,
    namespace,
    relu,
)
from .local import PER_FRAME, Arrays, history, local_inputs, mean_velocity, one_hot
from .modes import LEAST_SPREAD, spread_of, straight
from .network import Recipe, Sizes, Stage

TRACKLET = 64  # size of the state of a tracklet, and of an object in the graph
ROUNDS = 2  # of messages
REACH = 20.0  # m, between objects that are joined by an edge
CODE = 16  # size of a latent code
DECODER = 64  # hidden state of the recurrent decoder
SAMPLER = 128  # hidden layer of the sampling function
PER_STEP = PER_FRAME + 2  # features of a frame of a tracklet
PER_OBJECT = 7  # features of a tracklet beside its frames and class
PER_MESSAGE = (
    5  # features of a message: position, velocity and existence of the other object
)


class Ptp:
    """Network "ptp"."""

    name = "ptp"
    around = False
    recipe = Recipe(
        (Stage("autoencoder", "cvae.", 0.6), Stage("diverse", "sampler.", 0.4)),
        epochs=80,
        by_frame=True,
    )

    def inputs(
        self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes
    ) -> Arrays:
        """`local_inputs`, and of each window the place of its heading frame and the number of its frame.

        place [n, 3] x y m, yaw rad, in the frame of the observations · best [n] · moment [n], equal in the same frame.
        """
        place = windows.box[:, -1, [0, 1, 3]].astype(np.float32)
        return {
            **local_inputs(windows),
            "place": place,
            "best": windows.best.astype(np.float32),
            "moment": moment,
        }

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Autoencoder ``cvae.*``, sampling function ``sampler.*``, and statistics."""
        statistics = {
            "past.spread": (PER_STEP,),
            "object.mean": (PER_OBJECT,),
            "object.spread": (PER_OBJECT,),
        }
        return {
            **_trained_shapes(sizes),
            **statistics,
            "step.spread": (sizes.future, 1),
        }

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Random layers; the sampling function starts as k draws of the prior, for every context."""
        rng = np.random.default_rng(seed)
        weights = initial(_trained_shapes(sizes), rng)
        weights["sampler.1.bias"] = rng.standard_normal(sizes.modes * CODE).astype(
            np.float32
        )
        weights["sampler.1.weight"] *= np.float32(0.1)
        past, rest = _steps(inputs, sizes)[inputs["alive"] > 0], _object(inputs, sizes)
        weights |= {
            "past.spread": np.maximum(np.sqrt((past**2).mean(axis=0)), LEAST_SPREAD)
        }
        weights |= {
            "object.mean": rest.mean(axis=0),
            "object.spread": np.maximum(rest.std(axis=0), LEAST_SPREAD),
        }
        step = np.diff(
            future - straight(inputs, sizes), axis=1, prepend=0
        )  # of corrections of constant velocity
        both = known & np.concatenate([known[:, :1], known[:, :-1]], axis=1)
        return {**weights, "step.spread": spread_of(step, both)}

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """Futures of the k codes of the sampling function."""
        context = context_of(weights, inputs, sizes)
        code = sample_codes(weights, context, sizes)
        return {
            "modes": straight(inputs, sizes)[:, None]
            + decode(weights, context, code, sizes),
            "log_weight": code[:, :, 0] * 0,
            "present": linear(weights, "cvae.present", context),
        }


NETWORK = Ptp()


def _trained_shapes(sizes: Sizes) -> dict[str, tuple[int, ...]]:
    context = 2 * TRACKLET
    shapes = lstm_shapes("cvae.past.0", PER_STEP, TRACKLET) | lstm_shapes(
        "cvae.past.1", TRACKLET, TRACKLET
    )
    shapes |= _layer(
        "cvae.object", TRACKLET + PER_OBJECT + len(sizes.classes), TRACKLET
    )
    for i in range(ROUNDS):
        shapes |= _layer(f"cvae.graph.{i}.own", TRACKLET, TRACKLET)
        shapes |= _layer(f"cvae.graph.{i}.other", TRACKLET + PER_MESSAGE, TRACKLET)
    shapes |= lstm_shapes("cvae.future", 2, DECODER) | _layer(
        "cvae.code", DECODER + context, 2 * CODE
    )
    shapes |= _layer("cvae.begin", context + CODE, 2 * DECODER)
    shapes |= lstm_shapes("cvae.decoder", 2, DECODER) | _layer("cvae.step", DECODER, 2)
    shapes |= _layer("cvae.present", context, 2)
    return (
        shapes
        | _layer("sampler.0", context, SAMPLER)
        | _layer("sampler.1", SAMPLER, sizes.modes * CODE)
    )


def _layer(name: str, inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.weight": (inputs, outputs), f"{name}.bias": (outputs,)}


def _steps(inputs: dict[str, Array], sizes: Sizes) -> Array:
    """Features [n, P, PER_STEP] of each past frame: `history`, and the offset from a motion of constant velocity."""
    xp, alive = namespace(inputs["position"]), inputs["alive"]
    time = (xp.cumsum(xp.ones_like(alive), 1) - alive.shape[1]) * sizes.dt
    line = mean_velocity(inputs, sizes.dt)[:, None] * time[:, :, None]
    return xp.concatenate(
        [history(inputs), (inputs["position"] - line) * alive[:, :, None]], 2
    )


def _object(inputs: dict[str, Array], sizes: Sizes) -> Array:
    """Features [n, PER_OBJECT] of a tracklet as a whole."""
    xp = namespace(inputs["position"])
    velocity, coasting = mean_velocity(inputs, sizes.dt), 1 - inputs["taken"][:, -1:]
    return xp.concatenate(
        [inputs["size"][:, :2], inputs["counts"], velocity, coasting], 1
    )


def context_of(weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> Array:
    """Context [n, 2 TRACKLET] of each object: its own past, and its past among the others."""
    xp, alive = namespace(inputs["position"]), inputs["alive"]
    steps = xp.clip(_steps(inputs, sizes) / weights["past.spread"], -10, 10)
    past = lstm(
        weights, "cvae.past.1", lstm_states(weights, "cvae.past.0", steps, alive), alive
    )
    rest = (_object(inputs, sizes) - weights["object.mean"]) / weights["object.spread"]
    classes = one_hot(inputs["class_id"], len(sizes.classes), past)
    own = relu(
        linear(
            weights,
            "cvae.object",
            xp.concatenate([past, xp.clip(rest, -10, 10), classes], 1),
        )
    )
    return xp.concatenate([own, _among_others(weights, inputs, own, sizes)], 1)


def _among_others(
    weights: Weights, inputs: dict[str, Array], node: Array, sizes: Sizes
) -> Array:
    """Graph network: u' = relu(W1 u + sum over the others in reach of W2 v), ROUNDS times; [n, TRACKLET].

    v is the other's u with its position and velocity in the heading frame of u. The sum of products is computed as the
    product of sums, without an array [n, n, TRACKLET].
    """
    xp = namespace(node)
    near, geometry = _messages(inputs, sizes, node)
    for i in range(ROUNDS):
        other = (
            xp.concatenate([near @ node, geometry], 1)
            @ weights[f"cvae.graph.{i}.other.weight"]
        )
        node = relu(
            linear(weights, f"cvae.graph.{i}.own", node)
            + other
            + weights[f"cvae.graph.{i}.other.bias"]
        )
    return node


def _messages(
    inputs: dict[str, Array], sizes: Sizes, like: Array
) -> tuple[Array, Array]:
    """Reachability [n, n] as 1 and 0, and sums [n, PER_MESSAGE] over the objects in reach, in units of REACH."""
    xp = namespace(like)
    xy = inputs["place"][:, :2]
    between = turned(
        inputs, xy[None] - xy[:, None], -1
    )  # [n, n, 2] m from i to j, in the heading frame of i
    near = in_view(inputs) & ((between**2).sum(-1) <= REACH**2)
    near = near + xp.zeros_like(like[:, :1])
    velocity = turned(inputs, mean_velocity(inputs, sizes.dt)[:, None], 1)[:, 0]
    relative = turned(inputs, (near @ velocity)[:, None], -1)[:, 0]
    place = (near[:, :, None] * between).sum(1)
    return near, xp.concatenate(
        [place / REACH, relative / REACH, near.sum(1)[:, None] / 10], 1
    )


def sample_codes(weights: Weights, context: Array, sizes: Sizes) -> Array:
    """The sampling function: codes [n, k, CODE]."""
    return mlp(weights, "sampler", context, 2).reshape(-1, sizes.modes, CODE)


def decode(weights: Weights, context: Array, code: Array, sizes: Sizes) -> Array:
    """Corrections [n, S, T, 2] m of constant velocity for codes [n, S, CODE]; each step depends on the one before."""
    xp = namespace(context)
    n, samples = code.shape[:2]
    split = context.shape[1]
    begin = weights["cvae.begin.weight"]
    start = (context @ begin[:split] + weights["cvae.begin.bias"])[
        :, None
    ] + code @ begin[split:]
    start = xp.tanh(start.reshape(n * samples, 2 * DECODER))
    hidden, cell = start[:, :DECODER], start[:, DECODER:]
    step, steps = hidden[:, :2] * 0, []
    for _ in range(sizes.future):
        hidden, cell = lstm_cell(weights, "cvae.decoder", step, hidden, cell)
        step = linear(weights, "cvae.step", hidden)
        steps.append(step)
    return xp.cumsum(xp.stack(steps, 1) * weights["step.spread"], 1).reshape(
        n, samples, sizes.future, 2
    )


def posterior(
    weights: Weights, context: Array, steps: Array, known: Array
) -> tuple[Array, Array]:
    """Mean and log of the variance, [n, CODE] each, of the code of a true future; for training.

    ``steps`` [n, T, 2]: the steps that `decode` should make, in units of their spread; ``known`` [n, T].
    """
    xp = namespace(context)
    future = lstm(weights, "cvae.future", xp.clip(steps, -10, 10), known)
    out = linear(weights, "cvae.code", xp.concatenate([future, context], 1))
    return out[:, :CODE], xp.clip(out[:, CODE:], -8, 8)


def in_view(inputs: dict[str, Array]) -> Array:
    """Mask [n, n]: window i sees window j.

    A window sees the objects of the same frame that the heaviest hypothesis holds, other than its own: a window that
    ends in exactly the same place is of the same object, in another hypothesis.
    """
    xy, moment = inputs["place"][:, :2], inputs["moment"]
    elsewhere = (xy[:, None] != xy[None]).any(-1)
    return (moment[:, None] == moment[None]) & (inputs["best"][None] > 0) & elsewhere


def turned(inputs: dict[str, Array], vectors: Array, sense: int) -> Array:
    """Vectors [n, S, 2] out of the heading frame of each window (``sense`` 1) or into it (-1)."""
    xp, yaw = namespace(vectors), inputs["place"][:, 2]
    cos, sin = xp.cos(yaw)[:, None], sense * xp.sin(yaw)[:, None]
    x, y = vectors[:, :, 0], vectors[:, :, 1]
    return xp.stack([cos * x - sin * y, sin * x + cos * y], -1)
