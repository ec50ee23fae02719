"""PTP: the forecasting branch of Weng, Yuan, Kitani 2021, the predictor of the paper.

It has a recurrent encoder of each tracklet, a graph network over the objects of the
frame, and a conditional variational autoencoder with recurrent encoder and decoder. On
top of it a diversity sampling function maps the context of an object to k codes (Yuan,
Kitani 2019). It is trained with the losses of its successor DLow (Yuan, Kitani 2020),
whose codes are z_k = A_k eps + b_k; here eps is 0, in training as at work, so that
forecasts are deterministic. All k futures have the same weight. Before the sampling
function is trained, its codes are k fixed draws of the prior.

Neither code nor weights of PTP are public. What differs: all is in the heading frame of
the object, the decoder gives corrections of constant velocity, and messages between
objects hold the position of the other one.
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
    INPUT_LIMIT,
    Array,
    Inputs,
    Shapes,
    Weights,
    initial,
    layer_shapes,
    linear,
    lstm,
    lstm_cell,
    lstm_shapes,
    lstm_states,
    mlp,
    namespace,
    relu,
    standardised,
)
from .modes import LEAST_SPREAD, spread_of, statistics, straight_future
from .network import Recipe, Sizes, Stage

TRACKLET = 64  # size of the state of a tracklet, and of an object in the graph
ROUNDS = 2  # of messages
REACH = 20.0  # m, between objects that are joined by an edge
CODE = 16  # size of a latent code
DECODER = 64  # hidden state of the recurrent decoder
SAMPLER = 128  # hidden layer of the sampling function
PER_STEP = PER_FRAME + 2  # features of a frame of a tracklet
PER_OBJECT = 7  # features of a tracklet beside its frames and class
# features of a message: position, velocity and existence of the other object
PER_MESSAGE = 5
CROWD = 10  # objects in reach, a scale of their number
MOST_LOG_VARIANCE = 8  # of a code, in both directions


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
        self,
        windows: TrackWindows,
        moment: Ints,
        surroundings: Surroundings,
        sizes: Sizes,
    ) -> Arrays:
        """Return `local_inputs`, and where and when each window is.

        place [n, 3] x y m, yaw rad of its heading frame, in the frame of the
        observations · best [n] · moment [n], equal in the same frame.
        """
        return {
            **local_inputs(windows),
            "place": windows.box[:, -1, [0, 1, 3]].astype(np.float32),
            "best": windows.best.astype(np.float32),
            "moment": moment,
        }

    def shapes(self, sizes: Sizes) -> Shapes:
        """Return shapes of the autoencoder, the sampling function and statistics.

        Their names begin with ``cvae.`` and ``sampler.``.
        """
        return {
            **_trained_shapes(sizes),
            "past.spread": (PER_STEP,),
            "object.mean": (PER_OBJECT,),
            "object.spread": (PER_OBJECT,),
            "step.spread": (sizes.future, 1),
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

        At first the sampling function returns almost the same k draws of the prior for
        every object.
        """
        rng = np.random.default_rng(seed)
        weights = initial(_trained_shapes(sizes), rng)
        codes = rng.standard_normal(sizes.modes * CODE)
        weights["sampler.1.bias"] = codes.astype(np.float32)
        weights["sampler.1.weight"] *= np.float32(0.1)
        past = _steps(inputs, sizes)[inputs["alive"] > 0]
        past_spread = np.sqrt((past**2).mean(axis=0))
        # the network predicts steps of the correction to constant velocity
        step = np.diff(future - straight_future(inputs, sizes), axis=1, prepend=0)
        known_before = np.concatenate([is_known[:, :1], is_known[:, :-1]], axis=1)
        return {
            **weights,
            "past.spread": np.maximum(past_spread, LEAST_SPREAD),
            **statistics("object", _object(inputs, sizes)),
            "step.spread": spread_of(step, is_known & known_before),
        }

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return the futures of the k codes of the sampling function.

        In training they are those of windows with a weight, the others surround them.
        """
        context = context_of(weights, inputs, sizes)
        if "weight" in inputs:
            is_weighted = inputs["weight"] > 0
            context = context[is_weighted]
            inputs = {name: value[is_weighted] for name, value in inputs.items()}
        code = sample_codes(weights, context, sizes)
        correction = decode_futures(weights, context, code, sizes)
        return {
            "modes": straight_future(inputs, sizes)[:, None] + correction,
            "log_weight": code[:, :, 0] * 0,  # all alike
            "present": linear(weights, "cvae.present", context),
        }


NETWORK = Ptp()


def _trained_shapes(sizes: Sizes) -> Shapes:
    context = 2 * TRACKLET
    object_features = TRACKLET + PER_OBJECT + len(sizes.classes)
    shapes = {
        **lstm_shapes("cvae.past.0", PER_STEP, TRACKLET),
        **lstm_shapes("cvae.past.1", TRACKLET, TRACKLET),
        **layer_shapes("cvae.object", object_features, TRACKLET),
    }
    for i in range(ROUNDS):
        name = f"cvae.graph.{i}"
        shapes |= layer_shapes(f"{name}.own", TRACKLET, TRACKLET)
        shapes |= layer_shapes(f"{name}.other", TRACKLET + PER_MESSAGE, TRACKLET)
    return {
        **shapes,
        **lstm_shapes("cvae.future", 2, DECODER),
        **layer_shapes("cvae.code", DECODER + context, 2 * CODE),
        **layer_shapes("cvae.begin", context + CODE, 2 * DECODER),
        **lstm_shapes("cvae.decoder", 2, DECODER),
        **layer_shapes("cvae.step", DECODER, 2),
        **layer_shapes("cvae.present", context, 2),
        **layer_shapes("sampler.0", context, SAMPLER),
        **layer_shapes("sampler.1", SAMPLER, sizes.modes * CODE),
    }


def _steps(inputs: Inputs, sizes: Sizes) -> Array:
    """Return features [n, P, PER_STEP] of each past frame.

    The features are `history` and the offset from a motion of constant velocity.
    """
    xp = namespace(inputs["position"])
    alive = inputs["alive"]
    time = (xp.cumsum(xp.ones_like(alive), 1) - alive.shape[1]) * sizes.dt
    line = mean_velocity(inputs, sizes.dt)[:, None] * time[:, :, None]
    offset = (inputs["position"] - line) * alive[:, :, None]
    return xp.concatenate([history(inputs), offset], 2)


def _object(inputs: Inputs, sizes: Sizes) -> Array:
    """Return features [n, PER_OBJECT] of a tracklet as a whole."""
    velocity = mean_velocity(inputs, sizes.dt)
    coasting = 1 - inputs["taken"][:, -1:]
    columns = [inputs["size"][:, :2], inputs["counts"], velocity, coasting]
    return namespace(velocity).concatenate(columns, 1)


def context_of(weights: Weights, inputs: Inputs, sizes: Sizes) -> Array:
    """Return the context [n, 2 TRACKLET] of each object.

    The context encodes the object's own past, and the pasts of the objects around it.
    """
    xp = namespace(inputs["position"])
    alive = inputs["alive"]
    steps = _steps(inputs, sizes) / weights["past.spread"]
    steps = xp.clip(steps, -INPUT_LIMIT, INPUT_LIMIT)
    states = lstm_states(weights, "cvae.past.0", steps, alive)
    past = lstm(weights, "cvae.past.1", states, alive)
    features = standardised(weights, "object", _object(inputs, sizes))
    classes = one_hot(inputs["class_id"], len(sizes.classes), past)
    columns = xp.concatenate([past, features, classes], 1)
    own = relu(linear(weights, "cvae.object", columns))
    return xp.concatenate([own, _among_others(weights, inputs, own, sizes)], 1)


def _among_others(weights: Weights, inputs: Inputs, node: Array, sizes: Sizes) -> Array:
    """Return the states [n, TRACKLET] of objects after ROUNDS of messages.

    Graph network: u' = relu(W1 u + sum over the others in reach of W2 v). v is the
    other's u with its position and velocity in the heading frame of u. The sum of
    products is computed as the product of sums, without an array [n, n, TRACKLET].
    """
    xp = namespace(node)
    near, geometry = _messages(inputs, sizes, node)
    for i in range(ROUNDS):
        name = f"cvae.graph.{i}"
        messages = xp.concatenate([near @ node, geometry], 1)
        other = messages @ weights[f"{name}.other.weight"]
        own = linear(weights, f"{name}.own", node)
        node = relu(own + other + weights[f"{name}.other.bias"])
    return node


def _messages(inputs: Inputs, sizes: Sizes, like: Array) -> tuple[Array, Array]:
    """Return the mask [n, n] of others in reach, and sums [n, PER_MESSAGE].

    The mask is 1 or 0. The sums are over the others in reach: position and velocity in
    units of REACH, and their number.
    """
    xp = namespace(like)
    xy = inputs["place"][:, :2]
    # [n, n, 2] m from i to j, in the heading frame of i
    between = turned(inputs, xy[None] - xy[:, None], -1)
    near = in_view(inputs) & ((between**2).sum(-1) <= REACH**2)
    near = near + xp.zeros_like(like[:, :1])
    velocity = turned(inputs, mean_velocity(inputs, sizes.dt)[:, None], 1)[:, 0]
    velocity_sum = turned(inputs, (near @ velocity)[:, None], -1)[:, 0]
    place_sum = (near[:, :, None] * between).sum(1)
    count = near.sum(1)[:, None]
    sums = [place_sum / REACH, velocity_sum / REACH, count / CROWD]
    return near, xp.concatenate(sums, 1)


def sample_codes(weights: Weights, context: Array, sizes: Sizes) -> Array:
    """Return the codes [n, k, CODE] of the sampling function."""
    return mlp(weights, "sampler", context, 2).reshape(-1, sizes.modes, CODE)


def decode_futures(
    weights: Weights, context: Array, code: Array, sizes: Sizes
) -> Array:
    """Return corrections [n, S, T, 2] m of constant velocity.

    ``code``: [n, S, CODE]. Each step depends on the one before.
    """
    xp = namespace(context)
    count, samples = code.shape[:2]
    split = context.shape[1]
    # the layer "begin" in two parts: the context's is the same for all codes
    begin = weights["cvae.begin.weight"]
    start = (context @ begin[:split] + weights["cvae.begin.bias"])[:, None]
    start = start + code @ begin[split:]
    start = xp.tanh(start.reshape(count * samples, 2 * DECODER))
    hidden = start[:, :DECODER]
    cell = start[:, DECODER:]
    step = hidden[:, :2] * 0  # zeros
    steps = []
    for _ in range(sizes.future):
        hidden, cell = lstm_cell(weights, "cvae.decoder", step, hidden, cell)
        step = linear(weights, "cvae.step", hidden)
        steps.append(step)
    correction = xp.cumsum(xp.stack(steps, 1) * weights["step.spread"], 1)
    return correction.reshape(count, samples, sizes.future, 2)


def code_posterior(
    weights: Weights, context: Array, steps: Array, is_known: Array
) -> tuple[Array, Array]:
    """Return mean and log-variance of a true future's code.

    They are [n, CODE] each, for training. ``steps`` [n, T, 2]: the steps that
    `decode_futures` should make, in units of their spread; ``is_known`` [n, T].
    """
    xp = namespace(context)
    steps = xp.clip(steps, -INPUT_LIMIT, INPUT_LIMIT)
    future = lstm(weights, "cvae.future", steps, is_known)
    output = linear(weights, "cvae.code", xp.concatenate([future, context], 1))
    log_variance = xp.clip(output[:, CODE:], -MOST_LOG_VARIANCE, MOST_LOG_VARIANCE)
    return output[:, :CODE], log_variance


def in_view(inputs: Inputs) -> Array:
    """Return the mask [n, n]: window i sees window j.

    A window sees the objects of the same frame that the heaviest hypothesis holds,
    other than its own. A window that ends in exactly the same place is of the same
    object, in another hypothesis.
    """
    xy = inputs["place"][:, :2]
    moment = inputs["moment"]
    is_elsewhere = (xy[:, None] != xy[None]).any(-1)
    same_frame = moment[:, None] == moment[None]
    return same_frame & (inputs["best"][None] > 0) & is_elsewhere


def turned(inputs: Inputs, vectors: Array, sense: int) -> Array:
    """Turn vectors [n, S, 2] out of heading frames, or into them.

    Each window has a heading frame. ``sense`` is 1 for out of it, -1 for into it.
    """
    xp = namespace(vectors)
    yaw = inputs["place"][:, 2]
    cos = xp.cos(yaw)[:, None]
    sin = sense * xp.sin(yaw)[:, None]
    x = vectors[:, :, 0]
    y = vectors[:, :, 1]
    return xp.stack([cos * x - sin * y, sin * x + cos * y], -1)
