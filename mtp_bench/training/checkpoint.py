"""Checkpoint of a training, and the file from which an interrupted training goes on."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import torch

from ..files import whole_file
from ..prediction.learned.local import Arrays
from .losses import Tensors


@dataclass
class Checkpoint:
    """State of a training after an epoch, without the weights that are being trained."""

    epoch: int = 0  # epochs done
    stage: int = 0
    first: int = 0  # epochs that were done when the stage began
    best_epoch: int = 0
    curve: list[float] = field(default_factory=list)  # validation minADE, m, after each epoch
    best: Arrays = field(default_factory=dict)  # weights of the best epoch
    optimizer: Tensors = field(default_factory=dict)  # state by parameter, as "number/name"


class CheckpointFile:
    """A safetensors file; nothing in it is executed. ``digest``: of plan, data and code that it belongs to."""

    def __init__(self, path: Path, digest: str) -> None:
        self._path, self._digest = path, digest

    def read(self, weights: Tensors) -> Checkpoint:
        """The stored checkpoint, with ``weights`` set to the stored ones; a new one without a file of this training."""
        from safetensors import SafetensorError, safe_open

        if not self._path.is_file():
            return Checkpoint()
        try:
            with safe_open(self._path, framework="pt") as file:
                content = json.loads((file.metadata() or {}).get("state", "{}"))
                if content.pop("digest", None) != self._digest:
                    return Checkpoint()
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (SafetensorError, OSError, ValueError):
            return Checkpoint()
        with torch.no_grad():
            for name, value in weights.items():
                value.copy_(tensors[f"now/{name}"])
        best = {name: tensors[f"best/{name}"].numpy() for name in weights}
        prefix = "optimizer/"
        state = {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
        return Checkpoint(**content, best=best, optimizer=state)

    def write(self, checkpoint: Checkpoint, weights: Tensors) -> None:
        """Store a checkpoint and the weights, as a whole or not at all."""
        from safetensors.torch import save_file

        tensors = {f"now/{name}": value.detach().cpu().contiguous() for name, value in weights.items()}
        tensors |= {f"best/{name}": torch.from_numpy(value) for name, value in checkpoint.best.items()}
        tensors |= {f"optimizer/{name}": value for name, value in checkpoint.optimizer.items()}
        content = {name: value for name, value in vars(checkpoint).items() if name not in ("best", "optimizer")}
        with whole_file(self._path) as part:
            save_file(tensors, part, {"state": json.dumps({**content, "digest": self._digest})})


def optimizer_state(optimizer: torch.optim.Optimizer) -> Tensors:
    """State of an optimizer by parameter, as "number/name"."""
    parameters = optimizer.param_groups[0]["params"]
    return {
        f"{number}/{name}": value.cpu()
        for number, parameter in enumerate(parameters)
        for name, value in optimizer.state[parameter].items()
    }


def restore_optimizer(optimizer: torch.optim.Optimizer, state: Tensors) -> None:
    """Set the state that `optimizer_state` returned."""
    parameters = optimizer.param_groups[0]["params"]
    for key, value in state.items():
        number, name = key.split("/")
        parameter = parameters[int(number)]
        optimizer.state[parameter][name] = value.to("cpu" if name == "step" else parameter.device)
