"""Interface of a network, for agents and for training, and the networks of this folder."""

import pkgutil
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from ...core import Ints, SubmissionError, Task, require_known
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights
from .local import Arrays


@dataclass(frozen=True)
class Sizes:
    """Sizes of a network. A task may have fewer classes, in any order, and another k; the rest must agree."""

    classes: tuple[str, ...]
    past: int  # P frames, the current one included
    future: int  # T frames
    modes: int  # futures per track
    dt: float  # s

    @classmethod
    def of(cls, task: Task) -> Self:
        """Sizes for a task: as many modes as samples that are ranked."""
        return cls(task.classes, task.past, task.future, task.k, task.dt)


@dataclass(frozen=True)
class Stage:
    """A part of a training, which begins with the best weights of the stage before."""

    loss: str  # a function of `mtp_bench.training.losses`
    trains: str = ""  # prefix of the names of the weights that are trained; the others stay as they are
    share: float = 1.0  # of the epochs


@dataclass(frozen=True)
class Recipe:
    """Training of a network, unless another one is asked for."""

    stages: tuple[Stage, ...] = (Stage("winner_takes_all"),)
    epochs: int = 60  # of all stages
    on: str = "truth"  # pasts to learn from: "truth" or "tracklets"
    by_frame: bool = False  # batches hold whole frames, for networks whose inputs state the ``moment``
    lanes: bool = False  # only for envs whose observations show lanes


class Network(Protocol):
    """Futures of tracks as a function of weights; arrays of NumPy and tensors of torch alike."""

    name: str  # also of its module in this folder, which holds it as NETWORK
    around: bool  # its input is the detections around an object, not its track
    recipe: Recipe

    def inputs(
        self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes
    ) -> Arrays:
        """Its input for n windows, each array [n, ...]; ``moment`` [n]: the frame of each in ``seen``."""
        ...

    def shapes(self, sizes: Sizes) -> dict[str, tuple[int, ...]]:
        """Names and shapes of its weights."""
        ...

    def start(
        self,
        inputs: Arrays,
        future: np.ndarray,
        known: np.ndarray,
        sizes: Sizes,
        seed: int,
    ) -> Arrays:
        """Weights to start from; statistics of the training data (``future`` [n, T, 2], local) are among them."""
        ...

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """Output in the heading frame: ``modes`` [n, S, T, 2] m, ``log_weight`` [n, S] and ``present`` [n, 2] m."""
        ...


@cache
def networks() -> dict[str, Network]:
    """The networks by name: those of the modules of this folder that have one."""
    names = [
        module.name for module in pkgutil.iter_modules([str(Path(__file__).parent)])
    ]
    modules = [import_module(f"{__package__}.{name}") for name in names]
    return {
        module.NETWORK.name: module.NETWORK
        for module in modules
        if hasattr(module, "NETWORK")
    }


def network_of(name: str) -> Network:
    """The network of this name; raises UnknownNameError."""
    require_known("network", name, networks())
    return networks()[name]


def require_lanes(network: Network, env_id: str, shown: bool) -> None:
    """Raise SubmissionError if a network reads lanes and the observations of the env show none."""
    if network.recipe.lanes and not shown:
        raise SubmissionError(
            f"{env_id} shows no lanes, which network {network.name!r} reads; choose an env that shows them, such as "
            "MTP-Intersection-Lanes-v0"
        )
