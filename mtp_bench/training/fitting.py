"""The training of a network: batches, schedule, early stop; deterministic, and it goes on where it was interrupted."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..errors import MtpBenchError
from ..prediction.learned.local import Arrays
from ..prediction.learned.network import Network, Sizes
from .losses import Tensors, mode_distance, varied, winner_takes_all

Told = Callable[[int, float], object]  # is told every epoch's number, from 1 on, and its validation minADE


@dataclass(frozen=True)
class Plan:
    """How a network is trained."""

    epochs: int = 60
    batch: int = 512
    rate: float = 2e-3  # highest of the schedule (one cycle: Smith, Topin 2019)
    decay: float = 1e-4  # of AdamW (Loshchilov, Hutter 2019)
    patience: int = 20  # epochs without a better validation error, in the second half, after which it stops
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("epochs", "batch", "patience"):
            if getattr(self, name) < 1:
                raise MtpBenchError(f"{name} is {getattr(self, name)}, expected at least 1")


@dataclass(frozen=True, eq=False)
class Lesson:
    """What is learnt from: n windows."""

    inputs: Arrays  # of the network
    future: np.ndarray  # [n, T, 2] heading frame
    known: np.ndarray  # [n, T]
    present: np.ndarray  # [n, 2] heading frame
    weight: np.ndarray  # [n]
    validation: np.ndarray  # [n] bool: it is not learnt from

    def tensors(self, device: torch.device) -> Tensors:
        """Everything as tensors."""
        rest = {name: getattr(self, name) for name in ("future", "known", "present", "weight")}
        arrays = {**self.inputs, **{name: value.astype(np.float32) for name, value in rest.items()}}
        return {name: torch.from_numpy(np.ascontiguousarray(value)).to(device) for name, value in arrays.items()}


@dataclass
class State:
    """Where a training is."""

    epoch: int = 0  # that are done
    best_epoch: int = 0
    curve: list[float] = field(default_factory=list)  # validation minADE, m, after each epoch
    best: Arrays = field(default_factory=dict)  # weights of the best epoch


def device_of(name: str) -> torch.device:
    """The device that is meant by "auto", "cpu" or "cuda"; raises MtpBenchError for a GPU that is not there."""
    if name == "cuda" and not torch.cuda.is_available():
        raise MtpBenchError("device 'cuda': torch finds no GPU here; leave the option out or choose 'cpu'")
    return torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)


def fit(
    network: Network, sizes: Sizes, lesson: Lesson, plan: Plan, device: torch.device, told: Told, checkpoint: Path
) -> State:
    """Train a network; the weights of the epoch with the best validation minADE count.

    After each epoch ``checkpoint`` holds where it is; a training with the same plan and data goes on from there, and
    ends with the same weights as one that was never interrupted.
    """
    learnt = ~lesson.validation
    start = network.start(
        {name: value[learnt] for name, value in lesson.inputs.items()},
        lesson.future[learnt], lesson.known[learnt].astype(bool), sizes, plan.seed,
    )  # fmt: skip
    weights = {name: torch.from_numpy(np.asarray(value, np.float32)).to(device) for name, value in start.items()}
    trained = [value.requires_grad_() for name, value in sorted(weights.items()) if is_trained(name)]
    optimizer = torch.optim.AdamW(trained, lr=plan.rate, weight_decay=plan.decay)
    data = lesson.tensors(device)
    rows, held = (torch.from_numpy(np.flatnonzero(part)).to(device) for part in (learnt, lesson.validation))
    kept = _Checkpoint(checkpoint, _digest(network, sizes, lesson, plan))
    state = kept.read(weights, optimizer)
    while state.epoch < plan.epochs and not _over(state, plan):
        _epoch(network, sizes, weights, optimizer, data, rows, plan, state.epoch)
        error = validation_error(network, sizes, weights, data, held)
        if not math.isfinite(error):
            raise MtpBenchError(
                f"the training of {network.name} broke down in epoch {state.epoch + 1}: try a lower rate"
            )
        if not state.curve or error < min(state.curve):
            state.best_epoch = state.epoch + 1
            state.best = {name: value.detach().cpu().numpy().copy() for name, value in weights.items()}
        state.curve.append(error)
        state.epoch += 1
        kept.write(state, weights, optimizer)
        told(state.epoch, error)
    return state


def is_trained(name: str) -> bool:
    """Statistics of the data, ``*.mean`` and ``*.spread``, are not trained."""
    return not name.endswith((".mean", ".spread"))


def _over(state: State, plan: Plan) -> bool:
    return state.epoch >= plan.epochs // 2 and state.epoch - state.best_epoch >= plan.patience


def _epoch(
    network: Network,
    sizes: Sizes,
    weights: Tensors,
    optimizer: torch.optim.Optimizer,
    data: Tensors,
    rows: torch.Tensor,
    plan: Plan,
    epoch: int,
) -> None:
    """One pass over the data; the random numbers depend on seed and epoch alone."""
    generator = torch.Generator().manual_seed(plan.seed * 100_003 + epoch)
    order = rows[torch.randperm(len(rows), generator=generator).to(rows.device)]
    batches = torch.split(order, plan.batch)
    for number, part in enumerate(batches):
        progress = (epoch + number / len(batches)) / plan.epochs
        for group in optimizer.param_groups:
            group["lr"] = plan.rate * one_cycle(progress)
        batch = varied({name: value[part] for name, value in data.items()}, generator)
        loss = winner_takes_all(network.forward(weights, batch, sizes), batch, progress)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()


def one_cycle(progress: float, warm: float = 0.2) -> float:
    """Learning rate as a share of the highest: up from 1/25 over ``warm`` of the training, then down to nearly 0."""
    if progress < warm:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * progress / warm)) / 2
    return max(1e-3, (1 + math.cos(math.pi * (progress - warm) / (1 - warm))) / 2)


@torch.no_grad()
def validation_error(network: Network, sizes: Sizes, weights: Tensors, data: Tensors, rows: torch.Tensor) -> float:
    """minADE, m, of the windows ``rows``, by their weight."""
    total, weight = 0.0, 0.0
    for part in torch.split(rows, 8192):
        batch = {name: value[part] for name, value in data.items()}
        said = network.forward(weights, batch, sizes)
        least = mode_distance(said["modes"], batch["future"], batch["known"]).amin(dim=1)
        total += float((least * batch["weight"]).sum())
        weight += float(batch["weight"].sum())
    return total / weight


def _digest(network: Network, sizes: Sizes, lesson: Lesson, plan: Plan) -> str:
    """What a checkpoint is of: another plan or other data begins anew."""
    from ..sources.cache import content_hash

    rest = {name: getattr(lesson, name) for name in ("future", "known", "present", "weight", "validation")}
    return f"{network.name} {asdict(sizes)} {asdict(plan)} {content_hash({**lesson.inputs, **rest})}"


class _Checkpoint:
    """The file that a training goes on from: safetensors, nothing in it is run."""

    def __init__(self, path: Path, digest: str) -> None:
        self._path, self._digest = path, digest

    def read(self, weights: Tensors, optimizer: torch.optim.Optimizer) -> State:
        """Put ``weights`` and the optimizer where they were; a new state where there is no file of this training."""
        from safetensors import SafetensorError, safe_open

        if not self._path.is_file():
            return State()
        try:
            with safe_open(self._path, framework="pt") as file:
                said = json.loads((file.metadata() or {}).get("state", "{}"))
                if said.get("digest") != self._digest:
                    return State()
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError, ValueError):
            return State()
        with torch.no_grad():
            for name, value in weights.items():
                value.copy_(tensors[f"now/{name}"])
        for number, parameter in enumerate(optimizer.param_groups[0]["params"]):
            optimizer.state[parameter] = {
                key: tensors[f"{key}/{number}"].to("cpu" if key == "step" else parameter.device) for key in _ADAM
            }
        best = {name: tensors[f"best/{name}"].numpy() for name in weights}
        return State(said["epoch"], said["best_epoch"], said["curve"], best)

    def write(self, state: State, weights: Tensors, optimizer: torch.optim.Optimizer) -> None:
        """Store where the training is, as a whole or not at all."""
        from safetensors.torch import save_file

        from ..files import whole_file

        tensors = {f"now/{name}": value.detach().cpu().contiguous() for name, value in weights.items()}
        tensors |= {f"best/{name}": torch.from_numpy(value) for name, value in state.best.items()}
        for number, parameter in enumerate(optimizer.param_groups[0]["params"]):
            tensors |= {f"{key}/{number}": optimizer.state[parameter][key].cpu() for key in _ADAM}
        said: dict[str, Any] = {
            "digest": self._digest, "epoch": state.epoch, "best_epoch": state.best_epoch, "curve": state.curve,
        }  # fmt: skip
        with whole_file(self._path) as part:
            save_file(tensors, part, {"state": json.dumps(said)})


_ADAM = ("step", "exp_avg", "exp_avg_sq")  # what AdamW remembers of each parameter
