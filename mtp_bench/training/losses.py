"""Losses of networks and how their training data is varied; all in torch."""

from __future__ import annotations

import torch

from ..prediction.learned.network import Network, Sizes

Tensors = dict[str, torch.Tensor]

WEIGHING = 0.2  # of the log-likelihood of the right mode beside metres
PATH = 2.0  # of the distance of the mean path in metres beside its log-likelihood, which objects at rest rule
PRESENT = 0.5  # of the error of the present position
CUT = 0.3  # share of the windows whose past is cut short
TURN = 0.05  # rad, deviation of a turn of the heading frame


def mode_distance(modes: torch.Tensor, future: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Mean distance [n, S] m of modes [n, S, T, 2] to futures [n, T, 2] over the frames that are ``known`` [n, T]."""
    distance = torch.sqrt(((modes - future[:, None]) ** 2).sum(-1) + 1e-9)
    return (distance * known[:, None]).sum(-1) / known.sum(-1).clip(1)[:, None]


def winner_takes_all(
    network: Network, weights: Tensors, batch: Tensors, sizes: Sizes, progress: float, generator: torch.Generator
) -> torch.Tensor:
    """Mean loss of a batch: distance of the best mode, whether it was given the weight, and the present position.

    In the first half of the training a shrinking part (from .3) of all modes' mean distance keeps every mode alive.
    """
    said = network.forward(weights, batch, sizes)
    distance = mode_distance(said["modes"], batch["future"], batch["known"])
    relaxed = 0.3 * max(0.0, 1 - 2 * progress)
    best, winner = distance.min(dim=1)
    weight = torch.nn.functional.cross_entropy(said["log_weight"], winner, reduction="none")
    here = present_error(said["present"], batch)
    return weighted((1 - relaxed) * best + relaxed * distance.mean(dim=1) + WEIGHING * weight + PRESENT * here, batch)


def gaussian_path(
    network: Network, weights: Tensors, batch: Tensors, sizes: Sizes, progress: float, generator: torch.Generator
) -> torch.Tensor:
    """Negative log-likelihood of the future under a normal distribution at each step, and distance of the means.

    The network says ``path`` [n, T, 2], the means, and ``root`` [n, T, 2, 2], lower triangular square roots of the
    covariances, m.
    """
    said = network.forward(weights, batch, sizes)
    root, error = said["root"], batch["future"] - said["path"]
    first = error[..., 0] / root[..., 0, 0]
    second = (error[..., 1] - root[..., 1, 0] * first) / root[..., 1, 1]
    loss = 0.5 * (first**2 + second**2) + root[..., 0, 0].log() + root[..., 1, 1].log()
    loss = (loss * batch["known"]).sum(-1) / batch["known"].sum(-1).clip(1)
    loss = loss + PATH * mode_distance(said["path"][:, None], batch["future"], batch["known"])[:, 0]
    return weighted(loss + PRESENT * present_error(said["present"], batch), batch)


def present_error(present: torch.Tensor, batch: Tensors) -> torch.Tensor:
    """Distance [n] m of the present positions [n, 2] to the true ones."""
    return torch.sqrt(((present - batch["present"]) ** 2).sum(-1) + 1e-6)


def weighted(loss: torch.Tensor, batch: Tensors) -> torch.Tensor:
    """Mean of the losses [n] of windows, by their weight."""
    return (loss * batch["weight"]).sum() / batch["weight"].sum().clip(1e-9)


def mirrored_and_turned(
    lot: torch.Tensor, generator: torch.Generator
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Signs [n] of half the windows, by their ``lot`` [n] in [0, 1), turns [n] rad, and both as matrices [n, 2, 2]."""
    mirror = torch.where(lot < 0.5, -1.0, 1.0)
    angle = TURN * torch.randn(len(lot), generator=generator)
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(-1, 2, 2)
    return mirror, angle, turn * torch.stack([torch.ones_like(mirror), mirror], -1)[:, None]


def first_kept(n: int, past: int, generator: torch.Generator) -> torch.Tensor:
    """The first frame [n] that is kept of ``past`` ones: of some windows it is a later one."""
    cut = torch.rand(n, generator=generator) < CUT
    return torch.where(cut, torch.randint(0, past, (n,), generator=generator), 0)


def varied(batch: Tensors, generator: torch.Generator) -> Tensors:
    """The batch with half of the windows mirrored, some pasts cut short, and the heading `TURN` rad off.

    Windows of the same frame, where the batch tells it, are mirrored together.
    """
    n, past = batch["alive"].shape
    lot = torch.rand(n, generator=generator)
    if "moment" in batch:
        lot = lot[torch.unique(batch["moment"].cpu(), return_inverse=True)[1]]
    mirror, angle, turn = mirrored_and_turned(lot, generator)
    device = batch["position"].device
    turn = turn.to(device)
    out = dict(batch)
    for name in ("position", "velocity", "future"):
        out[name] = torch.einsum("nti,nji->ntj", batch[name], turn)
    out["present"] = torch.einsum("ni,nji->nj", batch["present"], turn)
    out["yaw"] = batch["yaw"] * mirror.to(device)[:, None]
    if "place" in batch:
        there = torch.stack([torch.ones(n), mirror, mirror], -1).to(device) * batch["place"]
        out["place"] = torch.cat([there[:, :2], there[:, 2:] - angle.to(device)[:, None]], 1)
    first = first_kept(n, past, generator)
    kept = (torch.arange(past)[None] >= first[:, None]).to(device)
    out["alive"], out["taken"] = batch["alive"] * kept, batch["taken"] * kept
    shorter = torch.log((past - first).to(torch.float32)).to(device)[:, None]
    out["counts"] = torch.where(
        (first > 0).to(device)[:, None], torch.minimum(batch["counts"], shorter), batch["counts"]
    )
    return out
