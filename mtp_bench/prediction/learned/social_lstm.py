"""Social-LSTM: Alahi et al. 2016, the predictor of people in the MTP paper's comparison.

A recurrent network per object; at each step, in the past and in the future, its input includes the sums of its
neighbours' hidden states in the cells of a grid around it. Its output is a normal distribution at each future step,
whose mean is the next input.

Differences from the paper: steps are in the heading frame of the object, as corrections of constant velocity, and in
training too the next input is the network's own mean, not the truth. With k = 1 the forecast is the path of means; with
more, fixed points of the distributions.
"""

from __future__ import annotations

import numpy as np

from ...types import Ints
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights, initial, linear, lstm_cell, lstm_shapes, namespace, relu, where_alive, zero_state
from .local import Arrays, mean_velocity, one_hot
from .modes import step_spread, straight
from .neighbours import absolute, frame_inputs, in_view, offsets
from .network import Sizes

EMBEDDING = 64  # of the own step, and of the neighbours
HIDDEN = 128
CELLS = 4  # on each side of the grid: 32 in windows of 8
CELL = 2.0  # m, side of a cell
PER_STEP = 4  # features of a step: its deviation from constant velocity, and that velocity
GOLDEN = np.pi * (3 - np.sqrt(5))  # rad, between one point and the next


class SocialLstm:
    """Network "social_lstm"."""

    name = "social_lstm"

    def inputs(self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes) -> Arrays:
        """The past of each window, and the other objects of its frame."""
        return frame_inputs(windows, moment)

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Embeddings, one recurrent layer, the distribution of a step, and the spread of steps."""
        return {**_trained_shapes(sizes), "step.spread": (sizes.future, 1)}

    def start(self, inputs: Arrays, future: np.ndarray, known: np.ndarray, sizes: Sizes, seed: int) -> Arrays:
        """Random layers; outputs are in units of the error of constant velocity per step."""
        weights = initial(_trained_shapes(sizes), np.random.default_rng(seed))
        return {**weights, "step.spread": step_spread(future - straight(inputs, sizes), known)}

    def forward(self, weights: Weights, inputs: dict[str, Array], sizes: Sizes) -> dict[str, Array]:
        """Points of the distributions; also their means ``path`` [n, T, 2] m and ``root`` [n, T, 2, 2], see `_root`."""
        xp, seen = namespace(inputs["position"]), in_view(inputs)
        state, line, moved = _past(weights, inputs, seen, sizes), straight(inputs, sizes), 0
        present, path, root = linear(weights, "present", state[0]), [], []
        for t in range(sizes.future):
            output, scale = linear(weights, "step", state[0]), weights["step.spread"][t]
            moved = moved + output[:, :2] * scale
            path.append(line[:, t] + moved)
            root.append(_root(output[:, 2:]) * (t + 1) * scale)
            xy = absolute(inputs, path[-1][:, None])[:, 0]
            state = _next(weights, inputs, sizes, output[:, :2], xy, seen, state)
        means, roots = xp.stack(path, 1), xp.stack(root, 1)
        modes = xp.stack([means + roots[..., 0] * x + roots[..., 1] * y for x, y in points(sizes.modes)], 1)
        weight = modes[:, :, 0, 0] * 0
        return {"modes": modes, "log_weight": weight, "present": present, "path": means, "root": roots}


def points(count: int) -> list[tuple[float, float]]:
    """Fixed points that represent the standard normal distribution of the plane; the first is its centre."""
    number = np.arange(count)
    radius, angle = np.sqrt(-2 * np.log1p(-number / count)), number * GOLDEN
    return list(zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True))


def _trained_shapes(sizes: Sizes) -> dict[str, tuple[int, ...]]:
    own, others = PER_STEP + len(sizes.classes), CELLS**2 * HIDDEN
    shapes = {"own.weight": (own, EMBEDDING), "own.bias": (EMBEDDING,)}
    shapes |= {"others.weight": (others, EMBEDDING), "others.bias": (EMBEDDING,)}
    shapes |= lstm_shapes("net", 2 * EMBEDDING, HIDDEN) | {"step.weight": (HIDDEN, 5), "step.bias": (5,)}
    return shapes | {"present.weight": (HIDDEN, 2), "present.bias": (2,)}


def _past(weights: Weights, inputs: dict[str, Array], seen: Array, sizes: Sizes) -> tuple[Array, Array]:
    """Hidden state and cell [n, h] after the past."""
    xp, alive, position = namespace(inputs["position"]), inputs["alive"], inputs["position"]
    first = zero_state(alive, weights["net.bias"])
    state, xy = (first, first), absolute(inputs, position)
    velocity = mean_velocity(inputs, sizes.dt) * sizes.dt
    for t in range(alive.shape[1]):
        step = xp.zeros_like(velocity) if t == 0 else position[:, t] - position[:, t - 1] - velocity
        born = alive[:, max(0, t - 1)] * alive[:, t]  # a first box has no step
        step = xp.clip(step * born[:, None] / weights["step.spread"][0], -10, 10)
        new = _next(weights, inputs, sizes, step, xy[:, t], seen & (alive[None, :, t] > 0), state)
        state = where_alive(alive[:, t], new[0], state[0]), where_alive(alive[:, t], new[1], state[1])
    return state


def _next(
    weights: Weights,
    inputs: dict[str, Array],
    sizes: Sizes,
    step: Array,
    xy: Array,
    seen: Array,
    state: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Hidden state and cell after a step [n, 2], in units of its spread, to ``xy`` [n, 2] m, absolute."""
    xp = namespace(step)
    classes = one_hot(inputs["class_id"], len(sizes.classes), step)
    constant = mean_velocity(inputs, sizes.dt) * sizes.dt
    own = relu(linear(weights, "own", xp.concatenate([step, constant, classes], 1)))
    others = relu(linear(weights, "others", _pooled(inputs, xy, seen, state[0])))
    return lstm_cell(weights, "net", xp.concatenate([own, others], 1), *state)


def _pooled(inputs: dict[str, Array], xy: Array, seen: Array, hidden: Array) -> Array:
    """Sums of the hidden states of the objects ``seen`` [n, n], per cell of the grid around each: [n, CELLS^2 h]."""
    xp = namespace(hidden)
    place = xp.floor(offsets(inputs, xy) / CELL) + CELLS // 2
    inside = seen & (place >= 0).all(-1) & (place < CELLS).all(-1)
    cell = place[:, :, 0] * CELLS + place[:, :, 1]
    there = xp.stack([inside & (cell == number) for number in range(CELLS**2)], 1)
    n, size = hidden.shape
    summed = (there + xp.zeros_like(hidden[:1, :1])).reshape(n * CELLS**2, n) @ hidden
    return summed.reshape(n, CELLS**2 * size)


def _root(numbers: Array) -> Array:
    """Lower triangular square roots [n, 2, 2] of covariances, from three numbers each."""
    xp = namespace(numbers)
    diagonal = xp.exp(xp.clip(numbers[:, :2], -5, 5))
    rows = [diagonal[:, 0], xp.zeros_like(diagonal[:, 0]), numbers[:, 2], diagonal[:, 1]]
    return xp.stack(rows, 1).reshape(-1, 2, 2)
