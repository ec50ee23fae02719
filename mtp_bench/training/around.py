"""How the training data of networks is varied that see the detections around an object; all in torch."""

from __future__ import annotations

import torch

from .losses import Tensors, first_kept, mirrored_and_turned

LOST = 0.05  # share of the detections that are taken away
GIVEN = ("position", "velocity", "yaw", "score", "same", "ratio")  # of each detection


def varied_around(batch: Tensors, generator: torch.Generator) -> Tensors:
    """The batch with half of the windows mirrored, the heading a little off, and frames and detections missing."""
    (n, past, _), device = batch["near"].shape, batch["near"].device
    mirror, angle, turn = mirrored_and_turned(torch.rand(n, generator=generator), generator)
    turn = turn.to(device)
    out = dict(batch)
    for name in ("position", "velocity", "future", "present"):
        out[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    shift = angle.to(device)[:, None, None]
    out["yaw"] = (batch["yaw"] * mirror.to(device)[:, None, None] + shift) * batch["near"]
    whole = torch.arange(past) >= first_kept(n, past, generator)[:, None]
    found = torch.rand(batch["near"].shape, generator=generator) >= LOST
    kept = (whole[..., None] & found).to(device)
    for name in (*GIVEN, "near"):
        out[name] = out[name] * (kept if out[name].ndim == kept.ndim else kept[..., None])
    return out
