"""Training of a network: batches, schedule, early stop. It is deterministic, and goes on where it was interrupted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from ..errors import MtpBenchError
from ..prediction.learned.local import Arrays
from ..prediction.learned.network import Network, Sizes
from .checkpoint import Checkpoint, CheckpointFile, optimizer_state, restore_optimizer
from .losses import Tensors, mode_distance
from .recipes import NetworkRecipe, Stage, TrainingPlan, recipe_of
from .window_cache import code_digest

EpochCallback = Callable[[int, float], object]  # number of an epoch, from 1 on, and its validation minADE, m

_CODE = ("training", "prediction/learned")  # a training does not go on under other code
WARM_UP = 0.2  # share of a training in which the learning rate rises
_LABELS = ("future", "known", "present", "weight")


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
        arrays = {**self.inputs, **{name: getattr(self, name).astype(np.float32) for name in _LABELS}}
        return {name: torch.from_numpy(np.ascontiguousarray(value)).to(device) for name, value in arrays.items()}


def device_of(name: str) -> torch.device:
    """The device "auto", "cpu" or "cuda"; raises MtpBenchError for other names and a GPU that is missing."""
    if name not in ("auto", "cpu", "cuda"):
        raise MtpBenchError(f"device is {name!r}, expected auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise MtpBenchError("device 'cuda': torch finds no GPU here; leave the option out or choose 'cpu'")
    return torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)


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
    checkpoint_path: Path,
) -> Checkpoint:
    """Train a network by its recipe; ``best`` holds the weights of the epoch with the best validation minADE.

    After each epoch ``checkpoint_path`` holds a checkpoint. A training with the same plan, data and code goes on from
    it, and ends with the same weights as one that was never interrupted.
    """
    inputs = _TrainingInputs.of(network, sizes, training_set, plan, device)
    file = CheckpointFile(checkpoint_path, _digest(network, sizes, training_set, plan, device))
    checkpoint = file.read(inputs.weights)
    while checkpoint.stage < len(inputs.recipe.stages):
        _fit_stage(inputs, checkpoint, file, callback)
        with torch.no_grad():
            for name, value in inputs.weights.items():
                value.copy_(torch.from_numpy(checkpoint.best[name]))
        checkpoint.stage, checkpoint.first, checkpoint.optimizer = checkpoint.stage + 1, checkpoint.epoch, {}
    return checkpoint


@dataclass(frozen=True, eq=False)
class _TrainingInputs:
    """Network, recipe, weights and data of one training."""

    network: Network
    sizes: Sizes
    recipe: NetworkRecipe
    plan: TrainingPlan
    weights: Tensors
    data: Tensors
    training_rows: torch.Tensor  # rows of the data
    validation_rows: torch.Tensor

    @classmethod
    def of(
        cls, network: Network, sizes: Sizes, training_set: TrainingSet, plan: TrainingPlan, device: torch.device
    ) -> _TrainingInputs:
        learnt = ~training_set.validation
        own = {name: value[learnt] for name, value in training_set.inputs.items()}
        known = training_set.known[learnt].astype(bool)
        start = network.start(own, training_set.future[learnt], known, sizes, plan.seed)
        weights = {name: torch.from_numpy(np.asarray(value, np.float32)).to(device) for name, value in start.items()}
        rows = [torch.from_numpy(np.flatnonzero(part)).to(device) for part in (learnt, training_set.validation)]
        data = training_set.tensors(device)
        return cls(network, sizes, recipe_of(network.name), plan, weights, data, *rows)

    @property
    def moment(self) -> torch.Tensor | None:
        """The frame of each window, if batches are of whole frames."""
        return self.data["moment"] if self.recipe.by_frame else None

    def batch(self, rows: torch.Tensor) -> Tensors:
        """The data of these rows."""
        return {name: value[rows] for name, value in self.data.items()}

    def trained_weights(self, stage: Stage) -> list[torch.Tensor]:
        """The weights that a stage trains; only these require gradients."""
        statistics = (".mean", ".spread")  # of the data
        names = [n for n in sorted(self.weights) if n.startswith(stage.trains) and not n.endswith(statistics)]
        for name, value in self.weights.items():
            value.requires_grad_(name in names)
        return [self.weights[name] for name in names]


def _fit_stage(inputs: _TrainingInputs, checkpoint: Checkpoint, file: CheckpointFile, callback: EpochCallback) -> None:
    """Train the stage of ``checkpoint`` to its end."""
    stage, plan = inputs.recipe.stages[checkpoint.stage], inputs.plan
    optimizer = torch.optim.AdamW(inputs.trained_weights(stage), lr=plan.rate, weight_decay=plan.decay)
    restore_optimizer(optimizer, checkpoint.optimizer)
    while not _stage_is_over(checkpoint, plan, stage.epochs(plan)):
        _train_epoch(inputs, stage, optimizer, checkpoint)
        error = _end_epoch(inputs, checkpoint)
        checkpoint.optimizer = optimizer_state(optimizer)
        file.write(checkpoint, inputs.weights)
        callback(checkpoint.epoch, error)


def _stage_is_over(checkpoint: Checkpoint, plan: TrainingPlan, epochs: int) -> bool:
    """True after all ``epochs``, or if the error has not fallen for long."""
    done = checkpoint.epoch - checkpoint.first
    idle = checkpoint.epoch - max(checkpoint.best_epoch, checkpoint.first)
    return done >= epochs or (done >= epochs // 2 and idle >= plan.patience)


def _train_epoch(
    inputs: _TrainingInputs, stage: Stage, optimizer: torch.optim.Optimizer, checkpoint: Checkpoint
) -> None:
    """One pass over the data; the random numbers depend on seed and epoch alone."""
    plan = inputs.plan
    generator = torch.Generator().manual_seed(plan.seed * 100_003 + checkpoint.epoch)
    batches = shuffled_batches(inputs.training_rows, inputs.moment, plan.batch, generator)
    for number, rows in enumerate(batches):
        progress = (checkpoint.epoch - checkpoint.first + number / len(batches)) / stage.epochs(plan)
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * one_cycle(progress)
        batch = inputs.recipe.vary(inputs.batch(rows), generator)
        loss = stage.loss(inputs.network, inputs.weights, batch, inputs.sizes, progress, generator)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()


def _end_epoch(inputs: _TrainingInputs, checkpoint: Checkpoint) -> float:
    """The validation error, m, of an epoch; its weights are kept if they are the best."""
    error = _validation_error(inputs)
    if not math.isfinite(error):
        raise MtpBenchError(f"the training of {inputs.network.name} broke down in epoch {checkpoint.epoch + 1}")
    checkpoint.epoch += 1
    if not checkpoint.curve or error < min(checkpoint.curve):
        checkpoint.best_epoch = checkpoint.epoch
        checkpoint.best = {name: value.detach().cpu().numpy().copy() for name, value in inputs.weights.items()}
    checkpoint.curve.append(error)
    return error


@torch.no_grad()
def _validation_error(inputs: _TrainingInputs) -> float:
    """minADE, m, of the windows that are held out, by their weight."""
    total, weight = 0.0, 0.0
    for rows in ordered_batches(inputs.validation_rows, inputs.moment, 8192 if inputs.moment is None else 1024):
        batch = inputs.batch(rows)
        output = inputs.network.forward(inputs.weights, batch, inputs.sizes)
        least = mode_distance(output["modes"], batch["future"], batch["known"]).amin(dim=1)
        total += float((least * batch["weight"]).sum())
        weight += float(batch["weight"].sum())
    return total / weight


def one_cycle(progress: float) -> float:
    """Learning rate as a share of the highest: up from 1/25 over a fifth of the training, then down to nearly 0."""
    if progress < WARM_UP:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * progress / WARM_UP)) / 2
    return max(1e-3, (1 + math.cos(math.pi * (progress - WARM_UP) / (1 - WARM_UP))) / 2)


def shuffled_batches(
    rows: torch.Tensor, moment: torch.Tensor | None, size: int, generator: torch.Generator
) -> tuple[torch.Tensor, ...]:
    """The rows [n] in random batches of about ``size``.

    ``moment`` [all rows]: the frame of each; windows of one frame stay together. None: each window alone.
    """
    if moment is None:
        return torch.split(rows[torch.randperm(len(rows), generator=generator).to(rows.device)], size)
    frames, frame = torch.unique(moment[rows], return_inverse=True)
    return _split_by_rank(rows, torch.randperm(len(frames), generator=generator).to(rows.device)[frame], size)


def ordered_batches(rows: torch.Tensor, moment: torch.Tensor | None, size: int) -> tuple[torch.Tensor, ...]:
    """The rows [n] in batches of about ``size``, of whole frames if ``moment`` is given."""
    return torch.split(rows, size) if moment is None else _split_by_rank(rows, moment[rows], size)


def _split_by_rank(rows: torch.Tensor, rank: torch.Tensor, size: int) -> tuple[torch.Tensor, ...]:
    """The rows sorted by ``rank`` [n], in pieces that begin where a rank begins."""
    order = torch.argsort(rank, stable=True)
    first = torch.searchsorted(rank[order], rank[order])  # the row at which each one's frame begins
    _, count = torch.unique_consecutive(first // size, return_counts=True)
    return torch.split(rows[order], count.tolist())


def _digest(network: Network, sizes: Sizes, training_set: TrainingSet, plan: TrainingPlan, device: torch.device) -> str:
    """Digest that invalidates a checkpoint: another plan, other data and other code start again."""
    from ..sources.cache import content_hash

    labels = {name: getattr(training_set, name) for name in (*_LABELS, "validation")}
    data = content_hash({**training_set.inputs, **labels})
    return f"{network.name} {asdict(sizes)} {asdict(plan)} {data} {device.type} {code_digest(_CODE)}"
