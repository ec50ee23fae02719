"""Losses of networks, in torch, and random variation of the batches that they learn from.

A loss is the mean over the windows of a batch, by their weight. Variation: mirrored windows, turned headings, missing
frames and detections.
"""

from collections.abc import Callable

import torch

from ..prediction import (
    Network,
    Sizes,
    context_of,
    decode,
    posterior,
    sample_codes,
    straight,
)

Tensors = dict[str, torch.Tensor]
# Network, weights, batch, sizes, progress of the stage from 0 to 1, random numbers.
Loss = Callable[
    [Network, Tensors, Tensors, Sizes, float, torch.Generator], torch.Tensor
]

MODE_WEIGHT = 0.2  # of the log-likelihood of the best mode, beside metres
PRESENT_WEIGHT = 0.5  # of the error of the present position
# Of PTP, beside errors in units of their scale:
DIVERGENCE_WEIGHT = 0.02  # of a code from the prior
PRIOR_WEIGHT = 0.0005  # of the negative log-density of the k codes under the prior
SIMILARITY_WEIGHT = 0.02  # of the k futures
SHORTENED = 0.3  # share of the windows whose past is cut short
TURN = 0.05  # rad, standard deviation of a turn of the heading frame
MISSING = 0.05  # share of the detections that are taken away
_OF_DETECTIONS = ("position", "velocity", "yaw", "score", "same", "ratio", "near")


def mode_distance(
    modes: torch.Tensor, future: torch.Tensor, known: torch.Tensor
) -> torch.Tensor:
    """Mean distance [n, S] m of modes [n, S, T, 2] to futures [n, T, 2] over the frames that are ``known`` [n, T]."""
    distance = torch.sqrt(((modes - future[:, None]) ** 2).sum(-1) + 1e-9)
    return (distance * known[:, None]).sum(-1) / known.sum(-1).clip(1)[:, None]


def winner_takes_all(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Distance of the best mode, its log-likelihood, and the error of the present position.

    In the first half of the training a shrinking part (from .3) of all modes' mean distance keeps every mode alive.
    """
    output = network.forward(weights, batch, sizes)
    distance = mode_distance(output["modes"], batch["future"], batch["known"])
    relaxed = 0.3 * max(0.0, 1 - 2 * progress)
    best, winner = distance.min(dim=1)
    likelihood = torch.nn.functional.cross_entropy(
        output["log_weight"], winner, reduction="none"
    )
    present = _present_error(output["present"], batch)
    loss = (1 - relaxed) * best + relaxed * distance.mean(dim=1)
    return _weighted_mean(
        loss + MODE_WEIGHT * likelihood + PRESENT_WEIGHT * present, batch
    )


def autoencoder(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Squared error of the future decoded from its own code, and divergence of that code from the prior (PTP)."""
    context = context_of(weights, batch, sizes)
    residual = batch["future"] - straight(batch, sizes)
    # steps of corrections in units of their spread, where both ends are known
    steps = (
        torch.diff(residual, dim=1, prepend=torch.zeros_like(residual[:, :1]))
        / weights["step.spread"]
    )
    both = batch["known"] * torch.cat(
        [batch["known"][:, :1], batch["known"][:, :-1]], 1
    )
    mean, log_variance = posterior(weights, context, steps * both[:, :, None], both)
    noise = torch.randn(mean.shape, generator=generator).to(mean.device)
    code = mean + (0.5 * log_variance).exp() * noise
    decoded = decode(weights, context, code[:, None], sizes)[:, 0]
    error = (((decoded - residual) / _scale(weights)) ** 2).sum(-1)
    error = (error * batch["known"]).sum(-1) / batch["known"].sum(-1).clip(1)
    divergence = 0.5 * (log_variance.exp() + mean**2 - 1 - log_variance).sum(
        -1
    )  # Kullback-Leibler
    present = (
        torch.matmul(context, weights["cvae.present.weight"])
        + weights["cvae.present.bias"]
    )
    loss = (
        error
        + DIVERGENCE_WEIGHT * divergence
        + PRESENT_WEIGHT * _present_error(present, batch)
    )
    return _weighted_mean(loss, batch)


def diverse(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """DLow's loss: distance of the best of k futures, their similarity, and how unlikely their codes are (PTP)."""
    context = context_of(weights, batch, sizes)
    code = sample_codes(weights, context, sizes)
    modes = decode(weights, context, code, sizes)
    residual = batch["future"] - straight(batch, sizes)
    best = mode_distance(modes, residual, batch["known"]).amin(dim=1) / _scale(weights)
    unlikely = 0.5 * (code**2).sum(-1).mean(dim=1)
    similar = _similarity(modes / _scale(weights))
    return _weighted_mean(
        best + SIMILARITY_WEIGHT * similar + PRIOR_WEIGHT * unlikely, batch
    )


def _present_error(present: torch.Tensor, batch: Tensors) -> torch.Tensor:
    """Distance [n] m of the present positions [n, 2] to the true ones."""
    return torch.sqrt(((present - batch["present"]) ** 2).sum(-1) + 1e-6)


def _weighted_mean(loss: torch.Tensor, batch: Tensors) -> torch.Tensor:
    return (loss * batch["weight"]).sum() / batch["weight"].sum().clip(1e-9)


def _scale(weights: Tensors) -> torch.Tensor:
    """Mean error of constant velocity, m."""
    return weights["step.spread"].cumsum(0).mean()


def _similarity(modes: torch.Tensor) -> torch.Tensor:
    """Mean over all pairs of modes [n, S, T, 2] of exp(-mean squared distance): [n]."""
    flat = modes.flatten(2) / modes.shape[2] ** 0.5
    square = (flat**2).sum(-1)
    distance = (
        square[:, :, None] + square[:, None] - 2 * flat @ flat.transpose(1, 2)
    ).clip(0)
    samples = modes.shape[1]
    similar: torch.Tensor = (-distance).exp().sum(
        (1, 2)
    ) - samples  # without each mode's similarity to itself
    return similar / max(1, samples * (samples - 1))


# By name, as a `mtp_bench.prediction.learned.network.Stage` states it.
LOSSES: dict[str, Loss] = {
    loss.__name__: loss for loss in (winner_takes_all, autoencoder, diverse)
}


def vary_tracks(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary windows of tracks: half of them mirrored, some pasts cut short, headings turned a little.

    Windows of the same frame, where the batch states it, are mirrored together.
    """
    (n, past) = batch["alive"].shape
    device = batch["position"].device
    draw = torch.rand(n, generator=generator)
    if "moment" in batch:
        draw = draw[torch.unique(batch["moment"].cpu(), return_inverse=True)[1]]
    mirror, angle, turn = (
        part.to(device) for part in _mirrors_and_turns(draw, generator)
    )
    varied = dict(batch)
    for name in (
        "position",
        "velocity",
        "future",
        "present",
        *(["path"] if "path" in batch else []),
    ):
        varied[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    varied["yaw"] = batch["yaw"] * mirror[:, None]
    if "place" in batch:
        place = (
            torch.stack([torch.ones_like(mirror), mirror, mirror], -1) * batch["place"]
        )
        varied["place"] = torch.cat([place[:, :2], place[:, 2:] - angle[:, None]], 1)
    first = _first_frames(n, past, generator)
    kept = (torch.arange(past)[None] >= first[:, None]).to(device)
    varied["alive"], varied["taken"] = batch["alive"] * kept, batch["taken"] * kept
    shorter = torch.log((past - first).to(torch.float32)).to(device)[:, None]
    cut = (first > 0).to(device)[:, None]
    varied["counts"] = torch.where(
        cut, torch.minimum(batch["counts"], shorter), batch["counts"]
    )
    return varied


def vary_detections(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary the detections around objects: half of the windows mirrored, headings turned, frames, detections missing."""
    (n, past, _) = batch["near"].shape
    device = batch["near"].device
    turns = _mirrors_and_turns(torch.rand(n, generator=generator), generator)
    mirror, angle, turn = (part.to(device) for part in turns)
    varied = dict(batch)
    for name in ("position", "velocity", "future", "present"):
        varied[name] = torch.einsum("n...i,nji->n...j", batch[name], turn)
    varied["yaw"] = (
        batch["yaw"] * mirror[:, None, None] + angle[:, None, None]
    ) * batch["near"]
    late = torch.arange(past) >= _first_frames(n, past, generator)[:, None]
    found = torch.rand(batch["near"].shape, generator=generator) >= MISSING
    kept = (late[..., None] & found).to(device)
    for name in _OF_DETECTIONS:
        varied[name] = varied[name] * (
            kept if varied[name].ndim == kept.ndim else kept[..., None]
        )
    return varied


def _mirrors_and_turns(
    draw: torch.Tensor, generator: torch.Generator
) -> tuple[torch.Tensor, ...]:
    """Signs [n], -1 where ``draw`` [n] is below a half, turns [n] rad, and both as matrices [n, 2, 2]."""
    mirror = torch.where(draw < 0.5, -1.0, 1.0)
    angle = TURN * torch.randn(len(draw), generator=generator)
    turn = torch.stack(
        [angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1
    ).reshape(-1, 2, 2)
    return (
        mirror,
        angle,
        turn * torch.stack([torch.ones_like(mirror), mirror], -1)[:, None],
    )


def _first_frames(n: int, past: int, generator: torch.Generator) -> torch.Tensor:
    """The first frame [n] that is kept of ``past`` frames; later than 0 for some windows."""
    cut = torch.rand(n, generator=generator) < SHORTENED
    return torch.where(cut, torch.randint(0, past, (n,), generator=generator), 0)
