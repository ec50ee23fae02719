"""Layers of networks as functions of NumPy arrays and of torch tensors alike.

A network is written once: torch differentiates it in training, NumPy runs it in agents,
which need no torch.
"""

import itertools
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

Array = Any  # an array of NumPy or a tensor of torch
Weights = Mapping[str, Array]
Inputs = Mapping[str, Array]  # arrays [n, ...] by name
Shapes = dict[str, tuple[int, ...]]  # of weights by name

INPUT_LIMIT = 10  # of standardised inputs


def namespace(x: Array) -> Any:
    """Return numpy, or torch if ``x`` is a tensor.

    Both have all functions that layers use.
    """
    return np if isinstance(x, np.ndarray) else sys.modules["torch"]


def relu(x: Array) -> Array:
    """Return max(x, 0)."""
    return namespace(x).clip(x, 0, None)


def sigmoid(x: Array) -> Array:
    """Return 1 / (1 + exp(-x)), without overflow."""
    xp = namespace(x)
    return 0.5 * (1 + np.tanh(0.5 * x)) if xp is np else xp.sigmoid(x)


def tanh(x: Array) -> Array:
    """Return the hyperbolic tangent, in torch by its sigmoid, which is faster."""
    xp = namespace(x)
    return np.tanh(x) if xp is np else 2 * xp.sigmoid(2 * x) - 1


def standardised(weights: Weights, name: str, x: Array) -> Array:
    """Return ``x`` less ``name.mean`` in units of ``name.spread``, clipped."""
    units = (x - weights[f"{name}.mean"]) / weights[f"{name}.spread"]
    return namespace(units).clip(units, -INPUT_LIMIT, INPUT_LIMIT)


def linear(weights: Weights, name: str, x: Array) -> Array:
    """Return X W + b with ``name.weight`` [in, out] and ``name.bias`` [out]."""
    return x @ weights[f"{name}.weight"] + weights[f"{name}.bias"]


def mlp(weights: Weights, name: str, x: Array, layers: int) -> Array:
    """Apply as many linear layers, ``name.0`` ..., with `relu` between them."""
    for layer in range(layers):
        x = linear(weights, f"{name}.{layer}", x)
        if layer < layers - 1:
            x = relu(x)
    return x


def lstm(weights: Weights, name: str, steps: Array, mask: Array) -> Array:
    """Return the last hidden state [n, h] of an LSTM, see `lstm_states`."""
    return lstm_states(weights, name, steps, mask)[:, -1]


def lstm_states(weights: Weights, name: str, steps: Array, mask: Array) -> Array:
    """Return hidden states [n, P, h] of an LSTM over ``steps`` [n, P, in].

    A step with ``mask`` [n, P] 0 changes nothing. ``name.weight`` [in + h, 4 h] and
    ``name.bias`` [4 h] are in the order input, forget, cell, output (Hochreiter,
    Schmidhuber 1997; Gers et al. 2000).
    """
    xp = namespace(steps)
    bias = weights[f"{name}.bias"]
    no_state = xp.zeros_like(bias[: len(bias) // 4])
    hidden = xp.zeros_like(steps[:, 0, :1]) + no_state  # [n, h]
    cell = hidden
    states = []
    for step in range(steps.shape[1]):
        new_hidden, new_cell = lstm_cell(weights, name, steps[:, step], hidden, cell)
        alive = mask[:, step, None]
        hidden = alive * new_hidden + (1 - alive) * hidden
        cell = alive * new_cell + (1 - alive) * cell
        states.append(hidden)
    return xp.stack(states, 1)


def lstm_cell(
    weights: Weights, name: str, x: Array, hidden: Array, cell: Array
) -> tuple[Array, Array]:
    """Return hidden state and cell [n, h] after an input [n, in]."""
    xp = namespace(x)
    size = hidden.shape[1]
    gates = linear(weights, name, xp.concatenate([x, hidden], 1))
    parts = [gates[:, i * size : (i + 1) * size] for i in range(4)]
    if xp is not np:
        parts = gates.chunk(4, 1)  # a quicker gradient than that of slices
    input_gate, forget_gate, new_cell, output_gate = parts
    cell = sigmoid(forget_gate) * cell + sigmoid(input_gate) * tanh(new_cell)
    return sigmoid(output_gate) * tanh(cell), cell


def layer_shapes(name: str, inputs: int, outputs: int) -> Shapes:
    """Return the shapes of the weights of `linear`."""
    return {f"{name}.weight": (inputs, outputs), f"{name}.bias": (outputs,)}


def linear_shapes(name: str, *sizes: int) -> Shapes:
    """Return the shapes of the weights of `mlp`.

    ``sizes``: of its layers, that of the input first.
    """
    shapes: Shapes = {}
    for layer, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        shapes |= layer_shapes(f"{name}.{layer}", inputs, outputs)
    return shapes


def lstm_shapes(name: str, inputs: int, hidden: int) -> Shapes:
    """Return the shapes of the weights of `lstm`."""
    return layer_shapes(name, inputs + hidden, 4 * hidden)


def initial(shapes: Shapes, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Draw initial weights, uniform in +-1 / sqrt(inputs) as in torch.

    Biases are 0.
    """
    weights = {}
    for name, shape in shapes.items():
        if len(shape) == 1:
            weights[name] = np.zeros(shape, np.float32)
        else:
            root = np.float32(np.sqrt(shape[0]))
            weights[name] = rng.uniform(-1, 1, shape).astype(np.float32) / root
    return weights
