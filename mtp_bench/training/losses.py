"""Losses of networks and how their training data is varied; all in torch."""

from __future__ import annotations

from typing import Any

import torch

Tensors = dict[str, torch.Tensor]

WEIGHING = 0.2  # of the log-likelihood of the right mode beside metres
PRESENT = 0.5  # of the error of the present position
CUT = 0.3  # share of the windows whose past is cut short
TURN = 0.05  # rad, deviation of a turn of the heading frame


def mode_distance(modes: torch.Tensor, future: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Mean distance [n, S] m of modes [n, S, T, 2] to futures [n, T, 2] over the frames that are ``known`` [n, T]."""
    distance = torch.sqrt(((modes - future[:, None]) ** 2).sum(-1) + 1e-9)
    return (distance * known[:, None]).sum(-1) / known.sum(-1).clip(1)[:, None]


def winner_takes_all(said: Tensors, batch: Tensors, progress: float) -> torch.Tensor:
    """Mean loss of a batch: distance of the best mode, whether it was given the weight, and the present position.

    In the first half of the training a shrinking part (from .3) of all modes' mean distance keeps every mode alive.
    """
    distance = mode_distance(said["modes"], batch["future"], batch["known"])
    relaxed = 0.3 * max(0.0, 1 - 2 * progress)
    best, winner = distance.min(dim=1)
    weight = torch.nn.functional.cross_entropy(said["log_weight"], winner, reduction="none")
    here = torch.sqrt(((said["present"] - batch["present"]) ** 2).sum(-1) + 1e-6)
    loss = (1 - relaxed) * best + relaxed * distance.mean(dim=1) + WEIGHING * weight + PRESENT * here
    return (loss * batch["weight"]).sum() / batch["weight"].sum()


def varied(batch: Tensors, generator: torch.Generator) -> Tensors:
    """The batch with half of the windows mirrored, some pasts cut short, and the heading a little off."""
    n, past = batch["alive"].shape
    made: Any = {"generator": generator}
    mirror = torch.where(torch.rand(n, **made) < 0.5, -1.0, 1.0)
    angle = TURN * torch.randn(n, **made)
    device = batch["position"].device
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(n, 2, 2)
    turn = (turn * torch.stack([torch.ones(n), mirror], -1)[:, None]).to(device)
    out = dict(batch)
    for name in ("position", "velocity", "future"):
        out[name] = torch.einsum("nti,nji->ntj", batch[name], turn)
    out["present"] = torch.einsum("ni,nji->nj", batch["present"], turn)
    out["yaw"] = batch["yaw"] * mirror.to(device)[:, None]
    first = torch.where(torch.rand(n, **made) < CUT, torch.randint(0, past, (n,), **made), 0)
    kept = (torch.arange(past)[None] >= first[:, None]).to(device)
    out["alive"], out["taken"] = batch["alive"] * kept, batch["taken"] * kept
    shorter = torch.log((past - first).to(torch.float32)).to(device)[:, None]
    out["counts"] = torch.where(
        (first > 0).to(device)[:, None], torch.minimum(batch["counts"], shorter), batch["counts"]
    )
    return out
