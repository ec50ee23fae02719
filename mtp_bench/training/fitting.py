"""The training of a network: batches, schedule, early stop; deterministic, and it goes on where it was interrupted."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch

from ..errors import MtpBenchError
from ..prediction.learned.local import Arrays
from ..prediction.learned.network import Network, Sizes
from .batches import in_order, shuffled
from .losses import Tensors, mode_distance
from .recipes import Plan as Plan
from .recipes import Recipe, Stage, recipe_of
from .window_cache import code_digest

Told = Callable[[int, float], object]  # is told every epoch's number, from 1 on, and its validation minADE

_CODE = ("training", "prediction/learned")  # a training that goes on under other code would be half of each
WARM = 0.2  # of a training: the learning rate rises


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
    stage: int = 0
    first: int = 0  # epochs that were done when the stage began
    best_epoch: int = 0
    curve: list[float] = field(default_factory=list)  # validation minADE, m, after each epoch
    best: Arrays = field(default_factory=dict)  # weights of the best epoch
    memory: Tensors = field(default_factory=dict)  # of the optimizer, see `_memory`


def device_of(name: str) -> torch.device:
    """The device meant by "auto", "cpu" or "cuda"; raises MtpBenchError for other names and a GPU that is not there."""
    if name not in ("auto", "cpu", "cuda"):
        raise MtpBenchError(f"device is {name!r}, expected auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise MtpBenchError("device 'cuda': torch finds no GPU here; leave the option out or choose 'cpu'")
    return torch.device(("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One core: sums are made in the same order on every machine, and small batches gain nothing from more."""
    from threadpoolctl import threadpool_limits  # scikit-learn needs it, so it is there

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(1):  # what scikit-learn uses
            yield
    finally:
        torch.set_num_threads(before)


@_one_thread()
def fit(
    network: Network, sizes: Sizes, lesson: Lesson, plan: Plan, device: torch.device, told: Told, checkpoint: Path
) -> State:
    """Train a network by its recipe; the weights of the epoch with the best validation minADE count.

    After each epoch ``checkpoint`` holds where it is; a training with the same plan, data and code goes on from there,
    and ends with the same weights as one that was never interrupted.
    """
    work = _Work.of(network, sizes, lesson, plan, device)
    kept = _Checkpoint(checkpoint, _digest(network, sizes, lesson, plan, device))
    state = kept.read(work.weights)
    while state.stage < len(work.recipe.stages):
        _fit_stage(work, state, kept, told)
        with torch.no_grad():
            for name, value in work.weights.items():
                value.copy_(torch.from_numpy(state.best[name]))
        state.stage, state.first, state.memory = state.stage + 1, state.epoch, {}
    return state


@dataclass(frozen=True, eq=False)
class _Work:
    """What a training works on."""

    network: Network
    sizes: Sizes
    recipe: Recipe
    plan: Plan
    weights: Tensors
    data: Tensors
    learnt: torch.Tensor  # rows of the data
    held: torch.Tensor  # rows that tell when to stop

    @classmethod
    def of(cls, network: Network, sizes: Sizes, lesson: Lesson, plan: Plan, device: torch.device) -> _Work:
        learnt = ~lesson.validation
        start = network.start(
            {name: value[learnt] for name, value in lesson.inputs.items()},
            lesson.future[learnt], lesson.known[learnt].astype(bool), sizes, plan.seed,
        )  # fmt: skip
        weights = {name: torch.from_numpy(np.asarray(value, np.float32)).to(device) for name, value in start.items()}
        rows, held = (torch.from_numpy(np.flatnonzero(part)).to(device) for part in (learnt, lesson.validation))
        return cls(network, sizes, recipe_of(network.name), plan, weights, lesson.tensors(device), rows, held)

    @property
    def moment(self) -> torch.Tensor | None:
        """The frame of each window, where batches are of whole frames."""
        return self.data["moment"] if self.recipe.by_frame else None

    def trained(self, stage: Stage) -> list[torch.Tensor]:
        """The weights that a stage trains; only these ask for gradients."""
        statistics = (".mean", ".spread")  # of the data, which are not trained
        names = [n for n in sorted(self.weights) if n.startswith(stage.trains) and not n.endswith(statistics)]
        for name, value in self.weights.items():
            value.requires_grad_(name in names)
        return [self.weights[name] for name in names]


def _judge(work: _Work, state: State) -> float:
    """The validation error, m, at the end of an epoch; the weights are kept if none were better."""
    error = _validation_error(work)
    if not math.isfinite(error):
        raise MtpBenchError(f"the training of {work.network.name} broke down in epoch {state.epoch + 1}")
    state.epoch += 1
    if not state.curve or error < min(state.curve):
        state.best_epoch = state.epoch
        state.best = {name: value.detach().cpu().numpy().copy() for name, value in work.weights.items()}
    state.curve.append(error)
    return error


def _fit_stage(work: _Work, state: State, kept: _Checkpoint, told: Told) -> None:
    """Train the stage in which ``state`` is, to its end."""
    stage = work.recipe.stages[state.stage]
    optimizer = torch.optim.AdamW(work.trained(stage), lr=work.plan.rate, weight_decay=work.plan.decay)
    _remember(optimizer, state.memory)
    while not _over(state, work.plan, stage.epochs(work.plan)):
        _epoch(work, stage, optimizer, state)
        error = _judge(work, state)
        state.memory = _memory(optimizer)
        kept.write(state, work.weights)
        told(state.epoch, error)


def _over(state: State, plan: Plan, epochs: int) -> bool:
    """The stage had its ``epochs``, or has not become better for long."""
    done, idle = state.epoch - state.first, state.epoch - max(state.best_epoch, state.first)
    return done >= epochs or (done >= epochs // 2 and idle >= plan.patience)


def _epoch(work: _Work, stage: Stage, optimizer: torch.optim.Optimizer, state: State) -> None:
    """One pass over the data; the random numbers depend on seed and epoch alone."""
    generator = torch.Generator().manual_seed(work.plan.seed * 100_003 + state.epoch)
    batches = shuffled(work.learnt, work.moment, work.plan.batch, generator)
    for number, part in enumerate(batches):
        progress = (state.epoch - state.first + number / len(batches)) / stage.epochs(work.plan)
        for group in optimizer.param_groups:
            group["lr"] = work.plan.rate * one_cycle(progress)
        batch = work.recipe.vary({name: value[part] for name, value in work.data.items()}, generator)
        loss = stage.loss(work.network, work.weights, batch, work.sizes, progress, generator)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()


def one_cycle(progress: float) -> float:
    """Learning rate as a share of the highest: up from 1/25 over a fifth of the training, then down to nearly 0."""
    if progress < WARM:
        return 0.04 + 0.96 * (1 - math.cos(math.pi * progress / WARM)) / 2
    return max(1e-3, (1 + math.cos(math.pi * (progress - WARM) / (1 - WARM))) / 2)


@torch.no_grad()
def _validation_error(work: _Work) -> float:
    """minADE, m, of the windows that are held out, by their weight."""
    total, weight = 0.0, 0.0
    for part in in_order(work.held, work.moment, 8192 if work.moment is None else 1024):
        batch = {name: value[part] for name, value in work.data.items()}
        said = work.network.forward(work.weights, batch, work.sizes)
        least = mode_distance(said["modes"], batch["future"], batch["known"]).amin(dim=1)
        total += float((least * batch["weight"]).sum())
        weight += float(batch["weight"].sum())
    return total / weight


def _digest(network: Network, sizes: Sizes, lesson: Lesson, plan: Plan, device: torch.device) -> str:
    """What a checkpoint is of: another plan, other data and other code begin anew."""
    from ..sources.cache import content_hash

    rest = {name: getattr(lesson, name) for name in ("future", "known", "present", "weight", "validation")}
    data = content_hash({**lesson.inputs, **rest})
    return f"{network.name} {asdict(sizes)} {asdict(plan)} {data} {device.type} {code_digest(_CODE)}"


def _memory(optimizer: torch.optim.Optimizer) -> Tensors:
    """What an optimizer remembers of each parameter, as "number/name"."""
    parameters = optimizer.param_groups[0]["params"]
    return {
        f"{number}/{name}": value.cpu()
        for number, parameter in enumerate(parameters)
        for name, value in optimizer.state[parameter].items()
    }


def _remember(optimizer: torch.optim.Optimizer, memory: Tensors) -> None:
    """Give an optimizer back what `_memory` said."""
    parameters = optimizer.param_groups[0]["params"]
    for place, value in memory.items():
        number, name = place.split("/")
        parameter = parameters[int(number)]
        optimizer.state[parameter][name] = value.to("cpu" if name == "step" else parameter.device)


class _Checkpoint:
    """The file that a training goes on from: safetensors, nothing in it is run."""

    def __init__(self, path: Path, digest: str) -> None:
        self._path, self._digest = path, digest

    def read(self, weights: Tensors) -> State:
        """Put ``weights`` where they were; a new state where there is no file of this training."""
        from safetensors import SafetensorError, safe_open

        if not self._path.is_file():
            return State()
        try:
            with safe_open(self._path, framework="pt") as file:
                said = json.loads((file.metadata() or {}).get("state", "{}"))
                if said.pop("digest", None) != self._digest:
                    return State()
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError, ValueError):
            return State()
        with torch.no_grad():
            for name, value in weights.items():
                value.copy_(tensors[f"now/{name}"])
        best = {name: tensors[f"best/{name}"].numpy() for name in weights}
        memory = {name.removeprefix("memory/"): value for name, value in tensors.items() if name.startswith("memory/")}
        return State(**said, best=best, memory=memory)

    def write(self, state: State, weights: Tensors) -> None:
        """Store where the training is, as a whole or not at all."""
        from safetensors.torch import save_file

        from ..files import whole_file

        tensors = {f"now/{name}": value.detach().cpu().contiguous() for name, value in weights.items()}
        tensors |= {f"best/{name}": torch.from_numpy(value) for name, value in state.best.items()}
        tensors |= {f"memory/{name}": value for name, value in state.memory.items()}
        said = {name: value for name, value in vars(state).items() if name not in ("best", "memory")}
        with whole_file(self._path) as part:
            save_file(tensors, part, {"state": json.dumps({**said, "digest": self._digest})})
