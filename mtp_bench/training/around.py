"""How the training data of networks is varied that see the detections around an object; all in torch."""

from __future__ import annotations

from typing import Any

import torch

from .losses import TURN, Tensors

CUT = 0.3  # share of the windows whose first frames are taken away
LOST = 0.05  # share of the detections that are taken away
GIVEN = ("position", "velocity", "yaw", "score", "same", "ratio")  # of each detection


def varied_around(batch: Tensors, generator: torch.Generator) -> Tensors:
    """The batch with half of the windows mirrored, the heading a little off, and frames and detections missing."""
    n, device = len(batch["near"]), batch["near"].device
    made: Any = {"generator": generator}
    mirror = torch.where(torch.rand(n, **made) < 0.5, -1.0, 1.0)
    angle = TURN * torch.randn(n, **made)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(n, 2, 2)
    turn = (turn * torch.stack([torch.ones(n), mirror], -1)[:, None]).to(device)
    out = dict(batch)
    for name in ("position", "velocity", "future", "present"):
        out[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    shift = angle.to(device)[:, None, None]
    out["yaw"] = (batch["yaw"] * mirror.to(device)[:, None, None] + shift) * batch["near"]
    kept = (_whole_frames(batch["near"].shape, made) & _found(batch["near"].shape, made)).to(device)
    for name in (*GIVEN, "near"):
        out[name] = out[name] * (kept if out[name].ndim == kept.ndim else kept[..., None])
    return out


def _whole_frames(shape: torch.Size, made: Any) -> torch.Tensor:
    """Frames [n, P, 1] that are kept: of some windows the first ones are not."""
    n, past = shape[:2]
    first = torch.where(torch.rand(n, **made) < CUT, torch.randint(0, past, (n,), **made), 0)
    return (torch.arange(past)[None] >= first[:, None])[..., None]


def _found(shape: torch.Size, made: Any) -> torch.Tensor:
    """Detections [n, P, M] that are kept."""
    return torch.rand(shape, **made) >= LOST
