"""Training of a network: batches, schedule, early stop. Equal plans, data and machines give equal weights."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import torch

from ..core import MtpBenchError
from ..prediction import Arrays, Network, Sizes, Stage
from ..running import require_seed
from .losses import LOSSES, Tensors, mode_distance, vary_detections, vary_tracks

EpochCallback = Callable[
    [int, float], object
]  # number of an epoch, from 1 on, and its validation minADE, m

WARM_UP = 0.2  # share of a training in which the learning rate rises
_LABELS = ("future", "known", "present", "weight")


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
                raise MtpBenchError(
                    f"{name} is {getattr(self, name)}, expected at least 1"
                )
        require_seed(self.seed)


@dataclass
class FittedNetwork:
    """The best weights of a training so far, and its errors."""

    curve: list[float] = field(
        default_factory=list
    )  # validation minADE, m, after each epoch
    best_epoch: int = 0
    best: Arrays = field(default_factory=dict)  # weights of that epoch


@dataclass(frozen=True, eq=False)
class TrainingSet:
    """Windows to learn from and to validate on: n in all."""

    inputs: Arrays  # of the network
    future: np.ndarray  # [n, T, 2] heading frame
    known: np.ndarray  # [n, T]
    present: np.ndarray  # [n, 2] heading frame
    weight: np.ndarray  # [n]
    validation: np.ndarray  # [n] bool

    def tensors(self, device: torch.device) -> Tensors:
        """Inputs and labels as tensors."""
        arrays = {
            **self.inputs,
            **{name: getattr(self, name).astype(np.float32) for name in _LABELS},
        }
        return {
            name: torch.from_numpy(np.ascontiguousarray(value)).to(device)
            for name, value in arrays.items()
        }


def device_of(name: str) -> torch.device:
    """The device "auto", "cpu" or "cuda"; raises MtpBenchError for other names and a GPU that is missing."""
    if name not in ("auto", "cpu", "cuda"):
        raise MtpBenchError(f"device is {name!r}, expected auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise MtpBenchError(
            "device 'cuda': torch finds no GPU here; leave the option out or choose 'cpu'"
        )
    return torch.device(
        ("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """One core: sums have the same order on every machine, and small batches gain nothing from more."""
    from threadpoolctl import threadpool_limits  # scikit-learn requires it

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):  # NumPy's and scikit-learn's
            yield
    finally:
        torch.set_num_threads(before)


@_one_thread()
def fit(
    network: Network,
    sizes: Sizes,
    training_set: TrainingSet,
    plan: TrainingPlan,
    device: torch.device,
    callback: EpochCallback,
) -> FittedNetwork:
    """Train a network by its recipe; ``best`` holds the weights of the epoch with the best validation minADE."""
    inputs = _TrainingInputs.of(network, sizes, training_set, plan, device)
    fitted = FittedNetwork()
    for stage in network.recipe.stages:
        _fit_stage(inputs, stage, fitted, callback)
        with torch.no_grad():
            for name, value in inputs.weights.items():
                value.copy_(torch.from_numpy(fitted.best[name]))
    return fitted


@dataclass(frozen=True, eq=False)
class _TrainingInputs:
    """Network, plan, initial weights and data of one training run, on one device."""

    network: Network
    sizes: Sizes
    plan: TrainingPlan
    weights: Tensors
    data: Tensors
    training_rows: torch.Tensor  # rows of the data
    validation_rows: torch.Tensor

    @classmethod
    def of(
        cls,
        network: Network,
        sizes: Sizes,
        training_set: TrainingSet,
        plan: TrainingPlan,
        device: torch.device,
    ) -> Self:
        learnt = ~training_set.validation
        own = {name: value[learnt] for name, value in training_set.inputs.items()}
        known = training_set.known[learnt].astype(bool)
        start = network.start(own, training_set.future[learnt], known, sizes, plan.seed)
        weights = {
            name: torch.from_numpy(np.asarray(value, np.float32)).to(device)
            for name, value in start.items()
        }
        rows = [
            torch.from_numpy(np.flatnonzero(part)).to(device)
            for part in (learnt, training_set.validation)
        ]
        return cls(network, sizes, plan, weights, training_set.tensors(device), *rows)

    @property
    def moment(self) -> torch.Tensor | None:
        """The frame of each window, if batches are of whole frames."""
        return self.data["moment"] if self.network.recipe.by_frame else None

    def batch(self, rows: torch.Tensor) -> Tensors:
        """The data of these rows."""
        return {name: value[rows] for name, value in self.data.items()}


def _fit_stage(
    inputs: _TrainingInputs,
    stage: Stage,
    fitted: FittedNetwork,
    callback: EpochCallback,
) -> None:
    """Train a stage until its epochs are over, or the error has not fallen for long."""
    plan = inputs.plan
    first = len(fitted.curve)
    epochs = max(1, round(stage.share * plan.epochs))
    statistics = (".mean", ".spread")  # of the data
    names = [
        n
        for n in sorted(inputs.weights)
        if n.startswith(stage.trains) and not n.endswith(statistics)
    ]
    for name, value in inputs.weights.items():
        value.requires_grad_(name in names)
    trained = [inputs.weights[name] for name in names]
    optimizer = torch.optim.AdamW(trained, lr=plan.rate, weight_decay=plan.decay)
    for done in range(epochs):
        idle = first + done - max(fitted.best_epoch, first)
        if done >= epochs // 2 and idle >= plan.patience:
            break
        _train_epoch(inputs, stage, optimizer, first + done, done, epochs)
        error = _validation_error(inputs)
        if not math.isfinite(error):
            raise MtpBenchError(
                f"the training of {inputs.network.name} broke down in epoch {first + done + 1}"
            )
        if not fitted.curve or error < min(fitted.curve):
            fitted.best_epoch = first + done + 1
            fitted.best = {
                name: value.detach().cpu().numpy().copy()
                for name, value in inputs.weights.items()
            }
        fitted.curve.append(error)
        callback(first + done + 1, error)


def _train_epoch(
    inputs: _TrainingInputs,
    stage: Stage,
    optimizer: torch.optim.Optimizer,
    epoch: int,
    done: int,
    epochs: int,
) -> None:
    """One pass over the data; the random numbers depend on seed and ``epoch``; ``done`` of the stage's ``epochs``."""
    network = inputs.network
    plan = inputs.plan
    vary = vary_detections if network.around else vary_tracks
    generator = torch.Generator().manual_seed(plan.seed * 100_003 + epoch)
    batches = shuffled_batches(
        inputs.training_rows, inputs.moment, plan.batch, generator
    )
    for number, rows in enumerate(batches):
        progress = (done + number / len(batches)) / epochs
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * one_cycle(progress)
        batch = vary(inputs.batch(rows), generator)
        loss = LOSSES[stage.loss](
            network, inputs.weights, batch, inputs.sizes, progress, generator
        )
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()


@torch.no_grad()
def _validation_error(inputs: _TrainingInputs) -> float:
    """minADE, m, of the windows that are held out, by their weight."""
    total = 0.0
    weight = 0.0
    for rows in ordered_batches(
        inputs.validation_rows, inputs.moment, 8192 if inputs.moment is None else 1024
    ):
        batch = inputs.batch(rows)
        output = inputs.network.forward(inputs.weights, batch, inputs.sizes)
        least = mode_distance(output["modes"], batch["future"], batch["known"]).amin(
            dim=1
        )
        total += float((least * batch["weight"]).sum())
        weight += float(batch["weight"].sum())
    return total / weight


def one_cycle(progress: float) -> float:
    """Learning rate as a share of the highest: up from 1/25 over a fifth of the training, then down to nearly 0."""
    if progress < WARM_UP:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return max(1e-3, (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2)


def shuffled_batches(
    rows: torch.Tensor,
    moment: torch.Tensor | None,
    size: int,
    generator: torch.Generator,
) -> tuple[torch.Tensor, ...]:
    """The rows [n] in random batches of about ``size``.

    ``moment`` [all rows]: the frame of each; windows of one frame stay together. None: each window alone.
    """
    if moment is None:
        return torch.split(
            rows[torch.randperm(len(rows), generator=generator).to(rows.device)], size
        )
    frames, frame = torch.unique(moment[rows], return_inverse=True)
    return _split_by_rank(
        rows,
        torch.randperm(len(frames), generator=generator).to(rows.device)[frame],
        size,
    )


def ordered_batches(
    rows: torch.Tensor, moment: torch.Tensor | None, size: int
) -> tuple[torch.Tensor, ...]:
    """The rows [n] in batches of about ``size``, of whole frames if ``moment`` is given."""
    return (
        torch.split(rows, size)
        if moment is None
        else _split_by_rank(rows, moment[rows], size)
    )


def _split_by_rank(
    rows: torch.Tensor, rank: torch.Tensor, size: int
) -> tuple[torch.Tensor, ...]:
    """The rows sorted by ``rank`` [n], in pieces that begin where a rank begins."""
    order = torch.argsort(rank, stable=True)
    first = torch.searchsorted(
        rank[order], rank[order]
    )  # the row at which each one's frame begins
    _, count = torch.unique_consecutive(first // size, return_counts=True)
    return torch.split(rows[order], count.tolist())
