"""Training of a network: batches, schedule, early stop.

Equal plans, data and machines give equal weights.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch.optim.adamw import adamw

from ..core import MtpBenchError
from ..prediction import Arrays, Network, Sizes, Stage
from ..running import require_seed
from .losses import LOSSES, Tensors, mode_distance, vary_detections, vary_tracks

# number of an epoch, from 1 on, and its validation minADE, m
EpochCallback = Callable[[int, float], object]

WARM_UP = 0.2  # share of a stage in which the learning rate rises
_LABELS = ("future", "is_known", "present", "weight")
_STATISTICS = (".mean", ".spread")  # of the data, never trained
_VALIDATION_BATCH = 8192  # windows
_VALIDATION_BATCH_OF_FRAMES = 1024


@dataclass(frozen=True)
class TrainingPlan:
    """Length and speed of a training."""

    epochs: int = 60  # of all stages
    batch: int = 512  # windows
    rate: float = 2e-3  # highest of the schedule (one cycle: Smith, Topin 2019)
    decay: float = 1e-4  # of AdamW (Loshchilov, Hutter 2019)
    # epochs without a better validation error that stop a stage in its second half
    patience: int = 20
    seed: int = 0

    def __post_init__(self) -> None:
        for field_name in ("epochs", "batch", "patience"):
            value = getattr(self, field_name)
            if value < 1:
                raise MtpBenchError(f"{field_name} is {value}, expected at least 1")
        require_seed(self.seed)


@dataclass
class FittedNetwork:
    """The best weights of a training so far, and its errors."""

    # validation minADE, m, after each epoch
    curve: list[float] = field(default_factory=list)
    best_epoch: int = 0
    best: Arrays = field(default_factory=dict)  # weights of that epoch


class _AdamW:
    """AdamW by torch's function.

    `torch.optim.AdamW` does the same, and first loads a compiler for a second or more.
    """

    def __init__(self, weights: Sequence[torch.Tensor], decay: float) -> None:
        self.weights = weights
        self._decay = decay
        self._mean = [torch.zeros_like(weight) for weight in weights]
        self._square = [torch.zeros_like(weight) for weight in weights]
        self._steps = [torch.tensor(0.0) for _ in weights]

    @torch.no_grad()
    def step(self, rate: float) -> None:
        """Move all weights that have a gradient."""
        with_gradient = [
            number
            for number, weight in enumerate(self.weights)
            if weight.grad is not None
        ]

        def chosen(values: Sequence[Any]) -> list[Any]:
            return [values[number] for number in with_gradient]

        adamw(
            chosen(self.weights),
            [weight.grad for weight in chosen(self.weights)],
            chosen(self._mean),
            chosen(self._square),
            [],
            chosen(self._steps),
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=rate,
            weight_decay=self._decay,
            eps=1e-8,
            maximize=False,
        )


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Windows to learn from and to validate on: n in all."""

    inputs: Arrays  # of the network
    future: np.ndarray  # [n, T, 2] heading frame
    is_known: np.ndarray  # [n, T]
    present: np.ndarray  # [n, 2] heading frame
    weight: np.ndarray  # [n]
    validation: np.ndarray  # [n] bool

    def tensors(self, device: torch.device) -> Tensors:
        """Return inputs and labels as tensors."""
        arrays = dict(self.inputs)
        for name in _LABELS:
            arrays[name] = getattr(self, name).astype(np.float32)
        return {
            name: torch.from_numpy(np.ascontiguousarray(value)).to(device)
            for name, value in arrays.items()
        }


def device_of(device_name: str) -> torch.device:
    """Return the device "auto", "cpu" or "cuda".

    Raises MtpBenchError for other names and a GPU that is missing.
    """
    if device_name not in ("auto", "cpu", "cuda"):
        raise MtpBenchError(f"device is {device_name!r}, expected auto, cpu or cuda")
    has_gpu = torch.cuda.is_available()
    if device_name == "cuda" and not has_gpu:
        raise MtpBenchError(
            "device 'cuda': torch finds no GPU here; leave the option out or choose "
            "'cpu'"
        )
    if device_name == "cpu" or not has_gpu:
        return torch.device("cpu")
    return torch.device("cuda")


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit the process to one core.

    Sums then have the same order on every machine, and small batches gain nothing from
    more.
    """
    from threadpoolctl import threadpool_limits  # scikit-learn requires it

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):  # NumPy's and scikit-learn's
            yield
    finally:
        torch.set_num_threads(threads)


@_one_thread()
def fit(
    network: Network,
    sizes: Sizes,
    training_set: TrainingSet,
    plan: TrainingPlan,
    device: torch.device,
    callback: EpochCallback,
) -> FittedNetwork:
    """Train a network by its recipe.

    The result's ``best`` holds the weights of the epoch with the best validation
    minADE; every stage starts from the best of those before.
    """
    trainer = _Trainer(network, sizes, training_set, plan, device)
    fitted = FittedNetwork()
    for stage in network.recipe.stages:
        trainer.fit_stage(stage, fitted, callback)
        with torch.no_grad():
            for weight_name, weight in trainer.weights.items():
                weight.copy_(torch.from_numpy(fitted.best[weight_name]))
    return fitted


class _Trainer:
    """Network, plan, weights and data of one training run, on one device."""

    def __init__(
        self,
        network: Network,
        sizes: Sizes,
        training_set: TrainingSet,
        plan: TrainingPlan,
        device: torch.device,
    ) -> None:
        self.network = network
        self.sizes = sizes
        self.plan = plan
        learnt = ~training_set.validation
        inputs = {name: value[learnt] for name, value in training_set.inputs.items()}
        future = training_set.future[learnt]
        is_known = training_set.is_known[learnt].astype(bool)
        start = network.start(inputs, future, is_known, sizes, plan.seed)
        self.weights: Tensors = {
            name: torch.from_numpy(np.asarray(value, np.float32)).to(device)
            for name, value in start.items()
        }
        self.data = training_set.tensors(device)
        # rows of the data
        self.training_rows = torch.from_numpy(np.flatnonzero(learnt)).to(device)
        validated = training_set.validation
        if not network.recipe.by_frame:  # else windows without a weight surround others
            validated = validated & (training_set.weight > 0)
        validation_rows = np.flatnonzero(validated)
        self.validation_rows = torch.from_numpy(validation_rows).to(device)
        # the frame of each window, if batches are of whole frames
        self.moment = self.data["moment"] if network.recipe.by_frame else None

    def batch(self, rows: torch.Tensor) -> Tensors:
        """Return the data of these rows."""
        return {name: value[rows] for name, value in self.data.items()}

    def fit_stage(
        self, stage: Stage, fitted: FittedNetwork, callback: EpochCallback
    ) -> None:
        """Train a stage until its end, or until errors stop falling.

        Adds to the curve of ``fitted``, and replaces its best weights.
        """
        plan = self.plan
        first_epoch = len(fitted.curve)
        stage_epochs = max(1, round(stage.share * plan.epochs))
        trained = []
        for weight_name, weight in sorted(self.weights.items()):
            is_statistic = weight_name.endswith(_STATISTICS)
            is_trained = weight_name.startswith(stage.trains) and not is_statistic
            weight.requires_grad_(is_trained)
            if is_trained:
                trained.append(weight)
        optimizer = _AdamW(trained, plan.decay)
        for stage_epoch in range(stage_epochs):
            epoch = first_epoch + stage_epoch
            idle_epochs = epoch - max(fitted.best_epoch, first_epoch)
            if stage_epoch >= stage_epochs // 2 and idle_epochs >= plan.patience:
                break
            self._train_epoch(stage, optimizer, epoch, stage_epoch, stage_epochs)
            error_m = self._validation_error()
            if not math.isfinite(error_m):
                raise MtpBenchError(
                    f"the training of {self.network.name} broke down in epoch "
                    f"{epoch + 1}"
                )
            if error_m < min(fitted.curve, default=math.inf):
                fitted.best_epoch = epoch + 1
                fitted.best = {
                    weight_name: weight.detach().cpu().numpy().copy()
                    for weight_name, weight in self.weights.items()
                }
            fitted.curve.append(error_m)
            callback(epoch + 1, error_m)

    def _train_epoch(
        self,
        stage: Stage,
        optimizer: "_AdamW",
        epoch: int,
        stage_epoch: int,
        stage_epochs: int,
    ) -> None:
        """Train once on all data.

        The random numbers depend on seed and ``epoch``. ``stage_epoch``: epochs of the
        stage so far, of ``stage_epochs``.
        """
        plan = self.plan
        vary = vary_detections if self.network.around else vary_tracks
        # a large prime keeps the numbers of two seeds apart
        generator = torch.Generator().manual_seed(plan.seed * 100_003 + epoch)
        batches = shuffled_batches(
            self.training_rows, self.moment, plan.batch, generator
        )
        for number, rows in enumerate(batches):
            progress = (stage_epoch + number / len(batches)) / stage_epochs
            batch = vary(self.batch(rows), generator)
            loss = LOSSES[stage.loss](
                self.network, self.weights, batch, self.sizes, progress, generator
            )
            for weight in optimizer.weights:
                weight.grad = None
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step(plan.rate * one_cycle(progress))

    @torch.no_grad()
    def _validation_error(self) -> float:
        """Return the minADE, m, of the validation windows, by their weight."""
        size = _VALIDATION_BATCH
        if self.moment is not None:
            size = _VALIDATION_BATCH_OF_FRAMES
        total = 0.0
        weight = 0.0
        for rows in ordered_batches(self.validation_rows, self.moment, size):
            batch = self.batch(rows)
            modes = self.network.forward(self.weights, batch, self.sizes)["modes"]
            is_weighted = batch["weight"] > 0
            batch = {name: value[is_weighted] for name, value in batch.items()}
            distance = mode_distance(modes, batch["future"], batch["is_known"])
            total += float((distance.amin(dim=1) * batch["weight"]).sum())
            weight += float(batch["weight"].sum())
        return total / weight


def one_cycle(progress: float) -> float:
    """Return the learning rate as a share of the highest.

    It rises from 1/25 over a fifth of a stage, then falls to nearly 0, both as half a
    cosine wave. ``progress`` of the stage is from 0 to 1.
    """
    if progress < WARM_UP:
        rise = (1 - math.cos(math.pi * progress / WARM_UP)) / 2
        return 0.04 + 0.96 * rise
    fall = (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2
    return max(1e-3, fall)


def shuffled_batches(
    rows: torch.Tensor,
    moment: torch.Tensor | None,
    size: int,
    generator: torch.Generator,
) -> tuple[torch.Tensor, ...]:
    """Return the rows [n] in random batches of about ``size``.

    ``moment``: number of the frame of each window of the data. Windows of one frame
    stay together; with None each window is drawn alone.
    """
    if moment is None:
        order = torch.randperm(len(rows), generator=generator).to(rows.device)
        return torch.split(rows[order], size)
    frames, frame = torch.unique(moment[rows], return_inverse=True)
    order = torch.randperm(len(frames), generator=generator).to(rows.device)
    return _split_by_rank(rows, order[frame], size)


def ordered_batches(
    rows: torch.Tensor, moment: torch.Tensor | None, size: int
) -> tuple[torch.Tensor, ...]:
    """Return the rows [n] in batches as `shuffled_batches`, but in order."""
    if moment is None:
        return torch.split(rows, size)
    return _split_by_rank(rows, moment[rows], size)


def _split_by_rank(
    rows: torch.Tensor, rank: torch.Tensor, size: int
) -> tuple[torch.Tensor, ...]:
    """Sort rows by the ``rank`` [n] of their frame, and split between frames."""
    order = torch.argsort(rank, stable=True)
    sorted_rank = rank[order]
    first_row = torch.searchsorted(sorted_rank, sorted_rank)  # of the row's frame
    # the whole frame is in the batch of its first row
    _, count = torch.unique_consecutive(first_row // size, return_counts=True)
    return torch.split(rows[order], count.tolist())
