"""Random variation of training batches, in torch: mirrored windows, turned headings, missing frames and detections."""

import torch

from .losses import Tensors

SHORTENED = 0.3  # share of the windows whose past is cut short
TURN = 0.05  # rad, standard deviation of a turn of the heading frame
MISSING = 0.05  # share of the detections that are taken away
_OF_DETECTIONS = ("position", "velocity", "yaw", "score", "same", "ratio", "near")


def vary_tracks(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary windows of tracks: half of them mirrored, some pasts cut short, headings turned a little.

    Windows of the same frame, where the batch states it, are mirrored together.
    """
    (n, past), device = batch["alive"].shape, batch["position"].device
    draw = torch.rand(n, generator=generator)
    if "moment" in batch:
        draw = draw[torch.unique(batch["moment"].cpu(), return_inverse=True)[1]]
    mirror, angle, turn = (part.to(device) for part in _mirrors_and_turns(draw, generator))
    varied = dict(batch)
    for name in ("position", "velocity", "future", "present", *(["path"] if "path" in batch else [])):
        varied[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    varied["yaw"] = batch["yaw"] * mirror[:, None]
    if "place" in batch:
        place = torch.stack([torch.ones_like(mirror), mirror, mirror], -1) * batch["place"]
        varied["place"] = torch.cat([place[:, :2], place[:, 2:] - angle[:, None]], 1)
    first = _first_frames(n, past, generator)
    kept = (torch.arange(past)[None] >= first[:, None]).to(device)
    varied["alive"], varied["taken"] = batch["alive"] * kept, batch["taken"] * kept
    shorter = torch.log((past - first).to(torch.float32)).to(device)[:, None]
    cut = (first > 0).to(device)[:, None]
    varied["counts"] = torch.where(cut, torch.minimum(batch["counts"], shorter), batch["counts"])
    return varied


def vary_detections(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary the detections around objects: half of the windows mirrored, headings turned, frames, detections missing."""
    (n, past, _), device = batch["near"].shape, batch["near"].device
    turns = _mirrors_and_turns(torch.rand(n, generator=generator), generator)
    mirror, angle, turn = (part.to(device) for part in turns)
    varied = dict(batch)
    for name in ("position", "velocity", "future", "present"):
        varied[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    varied["yaw"] = (batch["yaw"] * mirror[:, None, None] + angle[:, None, None]) * batch["near"]
    late = torch.arange(past) >= _first_frames(n, past, generator)[:, None]
    found = torch.rand(batch["near"].shape, generator=generator) >= MISSING
    kept = (late[..., None] & found).to(device)
    for name in _OF_DETECTIONS:
        varied[name] = varied[name] * (kept if varied[name].ndim == kept.ndim else kept[..., None])
    return varied


def _mirrors_and_turns(
    draw: torch.Tensor, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Signs [n], -1 where ``draw`` [n] is below a half, turns [n] rad, and both as matrices [n, 2, 2]."""
    mirror = torch.where(draw < 0.5, -1.0, 1.0)
    angle = TURN * torch.randn(len(draw), generator=generator)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(-1, 2, 2)
    return mirror, angle, turn * torch.stack([torch.ones_like(mirror), mirror], -1)[:, None]


def _first_frames(n: int, past: int, generator: torch.Generator) -> torch.Tensor:
    """The first frame [n] that is kept of ``past`` frames; later than 0 for some windows."""
    cut = torch.rand(n, generator=generator) < SHORTENED
    return torch.where(cut, torch.randint(0, past, (n,), generator=generator), 0)
