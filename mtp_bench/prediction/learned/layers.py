"""Layers of networks as functions of NumPy arrays and of torch tensors alike.

A network is written once: torch differentiates it in training, NumPy runs it in agents, which need no torch.
"""

import itertools
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

Array = Any  # an array of NumPy or a tensor of torch
Weights = Mapping[str, Array]


def namespace(x: Array) -> Any:
    """The module of functions for ``x``: numpy, or torch for a tensor. Both have all functions that layers use."""
    return np if isinstance(x, np.ndarray) else sys.modules["torch"]


def relu(x: Array) -> Array:
    """max(x, 0)."""
    return namespace(x).clip(x, 0, None)


def sigmoid(x: Array) -> Array:
    """1 / (1 + exp(-x)), without overflow."""
    xp = namespace(x)
    return 0.5 * (1 + np.tanh(0.5 * x)) if xp is np else xp.sigmoid(x)


def linear(weights: Weights, name: str, x: Array) -> Array:
    """X W + b with ``name.weight`` [in, out] and ``name.bias`` [out]."""
    return x @ weights[f"{name}.weight"] + weights[f"{name}.bias"]


def mlp(weights: Weights, name: str, x: Array, layers: int) -> Array:
    """``layers`` linear layers ``name.0`` ...; between them, and not after the last, `relu`."""
    for i in range(layers):
        x = linear(weights, f"{name}.{i}", x)
        x = relu(x) if i < layers - 1 else x
    return x


def lstm(weights: Weights, name: str, steps: Array, mask: Array) -> Array:
    """Last hidden state [n, h] of an LSTM over ``steps``, see `lstm_states`."""
    return lstm_states(weights, name, steps, mask)[:, -1]


def lstm_states(weights: Weights, name: str, steps: Array, mask: Array) -> Array:
    """Hidden states [n, P, h] of an LSTM over ``steps`` [n, P, in]; a step with ``mask`` [n, P] 0 changes nothing.

    ``name.weight`` [in + h, 4 h] and ``name.bias`` [4 h], in the order input, forget, cell, output (Hochreiter,
    Schmidhuber 1997; Gers et al. 2000).
    """
    xp, bias = namespace(steps), weights[f"{name}.bias"]
    hidden = cell = xp.zeros_like(steps[:, 0, :1]) + xp.zeros_like(
        bias[: len(bias) // 4]
    )  # [n, h]
    states = []
    for step in range(steps.shape[1]):
        new = lstm_cell(weights, name, steps[:, step], hidden, cell)
        alive = mask[:, step, None]
        hidden, cell = (
            alive * now + (1 - alive) * old
            for now, old in zip(new, (hidden, cell), strict=True)
        )
        states.append(hidden)
    return xp.stack(states, 1)


def lstm_cell(
    weights: Weights, name: str, x: Array, hidden: Array, cell: Array
) -> tuple[Array, Array]:
    """Hidden state and cell [n, h] after the input ``x`` [n, in]."""
    xp, size = namespace(x), hidden.shape[1]
    gates = linear(weights, name, xp.concatenate([x, hidden], 1))
    taken, kept, new, shown = (gates[:, i * size : (i + 1) * size] for i in range(4))
    cell = sigmoid(kept) * cell + sigmoid(taken) * xp.tanh(new)
    return sigmoid(shown) * xp.tanh(cell), cell


def linear_shapes(name: str, *sizes: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the weights of `mlp` (several layers) for these sizes, the input's first."""
    shapes: dict[str, tuple[int, ...]] = {}
    for i, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        shapes |= {
            f"{name}.{i}.weight": (inputs, outputs),
            f"{name}.{i}.bias": (outputs,),
        }
    return shapes


def lstm_shapes(name: str, inputs: int, hidden: int) -> dict[str, tuple[int, ...]]:
    """Shapes of the weights of `lstm`."""
    return {
        f"{name}.weight": (inputs + hidden, 4 * hidden),
        f"{name}.bias": (4 * hidden,),
    }


def initial(
    shapes: Mapping[str, tuple[int, ...]], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Initial weights: uniform in +-1 / sqrt(inputs) as in torch's linear layers; biases are 0."""
    return {
        name: np.zeros(shape, np.float32)
        if len(shape) == 1
        else rng.uniform(-1, 1, shape).astype(np.float32)
        / np.float32(np.sqrt(shape[0]))
        for name, shape in shapes.items()
    }
