"""Training recipes of networks: plan, stages with their losses, batches and their variation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch

from ..errors import MtpBenchError
from ..running.options import require_seed
from .augmentation import vary_detections, vary_tracks
from .losses import Loss, Tensors, autoencoder, diverse, winner_takes_all


@dataclass(frozen=True)
class TrainingPlan:
    """Length and speed of a training."""

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
    """A part of a training, which begins with the best weights of the stage before."""

    loss: Loss
    trains: str = ""  # prefix of the names of the weights that are trained; the others stay as they are
    share: float = 1.0  # of the epochs

    def epochs(self, plan: TrainingPlan) -> int:
        """Epochs of a plan that are of this stage, at least one."""
        return max(1, round(self.share * plan.epochs))


@dataclass(frozen=True)
class NetworkRecipe:
    """Recipe of one network."""

    stages: tuple[Stage, ...] = (Stage(winner_takes_all),)
    plan: TrainingPlan = TrainingPlan()  # unless another one is given
    on: str = "truth"  # the pasts that its baselines learn from, unless others are given
    vary: Callable[[Tensors, torch.Generator], Tensors] = vary_tracks
    by_frame: bool = False  # batches hold whole frames, for networks whose inputs state the ``moment``


RECIPES = {
    "ptp": NetworkRecipe(
        (Stage(autoencoder, "cvae.", 0.6), Stage(diverse, "sampler.", 0.4)), TrainingPlan(epochs=80), by_frame=True
    ),
    "tracking_free": NetworkRecipe(plan=TrainingPlan(epochs=40), on="tracklets", vary=vary_detections),
    "affinity": NetworkRecipe(on="tracklets", vary=vary_detections),
}


def recipe_of(network: str) -> NetworkRecipe:
    """The recipe of a network; without an entry of its own, winner-takes-all modes on tracks."""
    return RECIPES.get(network, NetworkRecipe())
