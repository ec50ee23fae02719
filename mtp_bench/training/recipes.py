"""How each network is trained: plan, stages with their losses, how its batches are made and varied."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from ..errors import MtpBenchError
from ..prediction.learned.network import Network, Sizes
from ..running.options import require_seed
from . import ptp_losses
from .around import varied_around
from .losses import Tensors, gaussian_path, varied, winner_takes_all

# mean loss of a batch: network, weights, batch, sizes, progress of the stage from 0 to 1, random numbers
Loss = Callable[[Network, Tensors, Tensors, Sizes, float, torch.Generator], torch.Tensor]
Vary = Callable[[Tensors, torch.Generator], Tensors]


@dataclass(frozen=True)
class Plan:
    """How long and how fast a network is trained."""

    epochs: int = 60  # of all stages
    batch: int = 512  # windows
    rate: float = 2e-3  # highest of the schedule (one cycle: Smith, Topin 2019)
    decay: float = 1e-4  # of AdamW (Loshchilov, Hutter 2019)
    patience: int = 20  # epochs without a better validation error, in a stage's second half, after which it stops
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "patience"):
            if getattr(self, name) < 1:
                raise MtpBenchError(f"{name} is {getattr(self, name)}, expected at least 1")
        require_seed(self.seed)


@dataclass(frozen=True)
class Stage:
    """A part of a training, which begins with the best weights of the one before."""

    loss: Loss
    trains: str = ""  # the weights whose names begin so; the others stay as they are
    share: float = 1.0  # of the epochs

    def epochs(self, plan: Plan) -> int:
        """How many epochs of a plan are its own, at least one."""
        return max(1, round(self.share * plan.epochs))


@dataclass(frozen=True)
class Recipe:
    """How a network is trained."""

    stages: tuple[Stage, ...]
    plan: Plan = Plan()  # unless another one is asked for
    on: str = "truth"  # the pasts that its baselines learn from, unless others are asked for
    vary: Vary = varied
    by_frame: bool = False  # batches hold whole frames, for networks whose inputs tell the ``moment``


RECIPES = {
    "ptp": Recipe(
        (Stage(ptp_losses.autoencoder, "cvae.", 0.6), Stage(ptp_losses.diverse, "sampler.", 0.4)),
        Plan(epochs=80),
        by_frame=True,
    ),
    "tracking_free": Recipe((Stage(winner_takes_all),), Plan(epochs=40), "tracklets", varied_around),
    "affinity": Recipe((Stage(winner_takes_all),), on="tracklets", vary=varied_around),
    "social_lstm": Recipe((Stage(gaussian_path),), Plan(epochs=40, batch=128), by_frame=True),
}


def recipe_of(network: str) -> Recipe:
    """The recipe of a network; of one that has none of its own, that of winner-takes-all modes."""
    return RECIPES.get(network, Recipe((Stage(winner_takes_all),)))
