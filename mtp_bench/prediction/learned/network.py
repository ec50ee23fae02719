"""Interface of a network, for agents and training, and this folder's networks."""

import pkgutil
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from ...core import Ints, SubmissionError, Task, require_known
from ..windows import Arrays, Surroundings, TrackWindows
from .layers import Array, Inputs, Shapes, Weights


@dataclass(frozen=True)
class Sizes:
    """Sizes of a network.

    A task may have fewer classes, in any order, and another k; the rest must agree.
    """

    classes: tuple[str, ...]
    past: int  # P frames, the current one included
    future: int  # T frames
    modes: int  # futures per track
    dt: float  # s

    @classmethod
    def of(cls, task: Task) -> Self:
        """Return the sizes for a task.

        There are as many modes as samples that are ranked.
        """
        return cls(task.classes, task.past, task.future, task.k, task.dt)


@dataclass(frozen=True)
class Stage:
    """A part of a training.

    It begins with the best weights of the stage before.
    """

    loss: str  # a function of `mtp_bench.training.losses`
    # prefix of the names of the weights that are trained; the others stay as they are
    trains: str = ""
    share: float = 1.0  # of the epochs


@dataclass(frozen=True)
class Recipe:
    """Training of a network, unless another one is asked for."""

    stages: tuple[Stage, ...] = (Stage("winner_takes_all"),)
    epochs: int = 60  # of all stages
    on: str = "truth"  # pasts to learn from: "truth" or "tracklets"
    # batches hold whole frames, for networks whose inputs state the ``moment``
    by_frame: bool = False
    lanes: bool = False  # only for envs whose observations show lanes


class Network(Protocol):
    """Function from weights and tracks to futures, for NumPy and torch alike."""

    name: str  # also of its module in this folder, which holds it as NETWORK
    around: bool  # its input is the detections around an object, not its track
    recipe: Recipe

    def inputs(
        self,
        windows: TrackWindows,
        moment: Ints,
        surroundings: Surroundings,
        sizes: Sizes,
    ) -> Arrays:
        """Return its input for n windows, each array [n, ...].

        ``moment`` [n]: the frame of each in ``surroundings``.
        """
        ...

    def shapes(self, sizes: Sizes) -> Shapes:
        """Return the shapes of its weights by name."""
        ...

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        is_known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Return weights to start from.

        Statistics of the training data (``future`` [n, T, 2], local, where ``is_known``
        [n, T]) are among them.
        """
        ...

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return the output in the heading frame.

        Its arrays: ``modes`` [n, S, T, 2] m, ``log_weight`` [n, S] and ``present`` [n,
        2] m.
        """
        ...


@cache
def networks() -> dict[str, Network]:
    """Return the networks of this folder by name."""
    by_name = {}
    for info in pkgutil.iter_modules([str(Path(__file__).parent)]):
        module = import_module(f"{__package__}.{info.name}")
        if hasattr(module, "NETWORK"):
            by_name[module.NETWORK.name] = module.NETWORK
    return by_name


def network_of(name: str) -> Network:
    """Return the network of this name.

    Raises UnknownNameError.
    """
    require_known("network", name, networks())
    return networks()[name]


def require_lanes(network: Network, env_id: str, shown: bool) -> None:
    """Raise SubmissionError if a network reads lanes and the env shows none."""
    if network.recipe.lanes and not shown:
        raise SubmissionError(
            f"{env_id} shows no lanes, which network {network.name!r} reads; choose an "
            "env that shows them, such as MTP-Intersection-Lanes-v0"
        )
