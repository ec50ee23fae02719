"""Losses of networks, in torch, and random variation of the batches.

A loss is the mean over the windows of a batch, by their weight. Variation: mirrored
windows, turned headings, missing frames and detections.
"""

from collections.abc import Callable, Sequence

import torch

from ..prediction import (
    Network,
    Sizes,
    code_posterior,
    context_of,
    decode_futures,
    sample_codes,
    straight_future,
)

Tensors = dict[str, torch.Tensor]
# Network, weights, batch, sizes, progress of the stage from 0 to 1, random numbers.
Loss = Callable[
    [Network, Tensors, Tensors, Sizes, float, torch.Generator], torch.Tensor
]

# a square root at 0 has no finite slope
_MIN_SQUARE_M2 = 1e-9
_MIN_PRESENT_SQUARE_M2 = 1e-6
RELAXED_SHARE = 0.3  # of the mean distance of all modes, at the start
MODE_WEIGHT = 0.2  # of the log-likelihood of the best mode, beside metres
PRESENT_WEIGHT = 0.5  # of the error of the present position
# Of PTP, beside errors in units of their scale:
DIVERGENCE_WEIGHT = 0.02  # of a code from the prior
PRIOR_WEIGHT = 0.0005  # of the negative log-density of the k codes under the prior
SIMILARITY_WEIGHT = 0.02  # of the k futures
SHORTENED_SHARE = 0.3  # of the windows: their past is cut short
TURN_RAD = 0.05  # standard deviation of a turn of the heading frame
MISSING_SHARE = 0.05  # of the detections: they are taken away
_VECTORS = ("position", "velocity", "future", "present")
_OF_DETECTIONS = ("position", "velocity", "yaw", "score", "same", "ratio", "near")


def mode_distance(
    modes: torch.Tensor, future: torch.Tensor, is_known: torch.Tensor
) -> torch.Tensor:
    """Return mean distances [n, S] m of modes to futures, over known frames.

    ``modes`` [n, S, T, 2], ``future`` [n, T, 2], ``is_known`` [n, T].
    """
    square = ((modes - future[:, None]) ** 2).sum(-1)
    distance = torch.sqrt(square + _MIN_SQUARE_M2)
    total = (distance * is_known[:, None]).sum(-1)
    return total / is_known.sum(-1).clip(1)[:, None]


def winner_takes_all(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return the loss of best mode and present position.

    It is the distance of the best mode, the negative log-likelihood of that mode, and
    the error of the present position. In the first half of the stage a shrinking share
    (from `RELAXED_SHARE`) of the mean distance of all modes keeps every mode alive.
    """
    output = network.forward(weights, batch, sizes)
    distance = mode_distance(output["modes"], batch["future"], batch["is_known"])
    relaxed = RELAXED_SHARE * max(0.0, 1 - 2 * progress)
    best, winner = distance.min(dim=1)
    likelihood = torch.nn.functional.cross_entropy(
        output["log_weight"], winner, reduction="none"
    )
    present = _present_error(output["present"], batch)
    loss = (1 - relaxed) * best + relaxed * distance.mean(dim=1)
    loss = loss + MODE_WEIGHT * likelihood + PRESENT_WEIGHT * present
    return _weighted_mean(loss, batch)


def autoencoder(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return the loss of futures decoded from their codes (PTP).

    It is the squared error, the divergence of the codes from the prior, and the error
    of the present position.
    """
    context = context_of(weights, batch, sizes)
    residual = batch["future"] - straight_future(batch, sizes)
    is_known = batch["is_known"]
    # steps of corrections in units of their spread, where both ends are known
    start = torch.zeros_like(residual[:, :1])
    steps = torch.diff(residual, dim=1, prepend=start) / weights["step.spread"]
    has_step = is_known * torch.cat([is_known[:, :1], is_known[:, :-1]], 1)
    mean, log_variance = code_posterior(
        weights, context, steps * has_step[:, :, None], has_step
    )
    noise = torch.randn(mean.shape, generator=generator).to(mean.device)
    code = mean + (0.5 * log_variance).exp() * noise
    decoded = decode_futures(weights, context, code[:, None], sizes)[:, 0]
    error = (((decoded - residual) / _scale(weights)) ** 2).sum(-1)
    error = (error * is_known).sum(-1) / is_known.sum(-1).clip(1)
    # Kullback-Leibler
    divergence = 0.5 * (log_variance.exp() + mean**2 - 1 - log_variance).sum(-1)
    present = torch.matmul(context, weights["cvae.present.weight"])
    present_error = _present_error(present + weights["cvae.present.bias"], batch)
    loss = error + DIVERGENCE_WEIGHT * divergence + PRESENT_WEIGHT * present_error
    return _weighted_mean(loss, batch)


def diverse(
    network: Network,
    weights: Tensors,
    batch: Tensors,
    sizes: Sizes,
    progress: float,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return DLow's loss of k futures (PTP).

    It is the distance of the best one, their similarity, and how unlikely their codes
    are.
    """
    context = context_of(weights, batch, sizes)
    code = sample_codes(weights, context, sizes)
    modes = decode_futures(weights, context, code, sizes)
    residual = batch["future"] - straight_future(batch, sizes)
    distance = mode_distance(modes, residual, batch["is_known"])
    best = distance.amin(dim=1) / _scale(weights)
    unlikely = 0.5 * (code**2).sum(-1).mean(dim=1)
    similar = _similarity(modes / _scale(weights))
    loss = best + SIMILARITY_WEIGHT * similar + PRIOR_WEIGHT * unlikely
    return _weighted_mean(loss, batch)


def _present_error(present: torch.Tensor, batch: Tensors) -> torch.Tensor:
    """Return errors [n] m of the present positions [n, 2]."""
    square = ((present - batch["present"]) ** 2).sum(-1)
    return torch.sqrt(square + _MIN_PRESENT_SQUARE_M2)


def _weighted_mean(loss: torch.Tensor, batch: Tensors) -> torch.Tensor:
    return (loss * batch["weight"]).sum() / batch["weight"].sum().clip(1e-9)


def _scale(weights: Tensors) -> torch.Tensor:
    """Return the mean error of constant velocity over the horizon, m."""
    return weights["step.spread"].cumsum(0).mean()


def _similarity(modes: torch.Tensor) -> torch.Tensor:
    """Return mean similarities [n] of pairs of modes.

    Similarity is exp(-mean squared distance). ``modes`` [n, S, T, 2].
    """
    # |a - b|^2 = |a|^2 + |b|^2 - 2 a b, of modes as vectors; the mean is over frames
    flat = modes.flatten(2) / modes.shape[2] ** 0.5
    square = (flat**2).sum(-1)
    product = 2 * flat @ flat.transpose(1, 2)
    distance = (square[:, :, None] + square[:, None] - product).clip(0)
    samples = modes.shape[1]
    similar: torch.Tensor = (-distance).exp().sum((1, 2))
    # without each mode's similarity to itself
    return (similar - samples) / max(1, samples * (samples - 1))


# By name, as a `mtp_bench.prediction.learned.network.Stage` states it.
LOSSES: dict[str, Loss] = {
    loss.__name__: loss for loss in (winner_takes_all, autoencoder, diverse)
}


def vary_tracks(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary windows of tracks: mirrors, shorter pasts and small turns.

    Half of the windows are mirrored, those of the same frame together where the batch
    states it.
    """
    windows, past = batch["alive"].shape
    draw = torch.rand(windows, generator=generator)
    if "moment" in batch:
        draw = draw[torch.unique(batch["moment"].cpu(), return_inverse=True)[1]]
    names = [name for name in (*_VECTORS, "path") if name in batch]
    varied, mirror, angle = _mirrored_and_turned(batch, names, draw, generator)
    varied["yaw"] = batch["yaw"] * mirror[:, None]
    if "place" in batch:  # x, y and yaw of the track
        signs = torch.stack([torch.ones_like(mirror), mirror, mirror], -1)
        place = signs * batch["place"]
        # the heading frame turns, so the track has turned the other way
        varied["place"] = torch.cat([place[:, :2], place[:, 2:] - angle[:, None]], 1)
    device = batch["position"].device
    first = _first_frames(windows, past, generator)
    is_shown = (torch.arange(past)[None] >= first[:, None]).to(device)
    varied["alive"] = batch["alive"] * is_shown
    varied["taken"] = batch["taken"] * is_shown
    shorter = torch.log((past - first).to(torch.float32)).to(device)[:, None]
    is_cut = (first > 0).to(device)[:, None]
    counts = batch["counts"]
    varied["counts"] = torch.where(is_cut, torch.minimum(counts, shorter), counts)
    return varied


def vary_detections(batch: Tensors, generator: torch.Generator) -> Tensors:
    """Vary detections around objects: mirrors, small turns and missing ones.

    Half of the windows are mirrored; frames and single detections are taken away.
    """
    near = batch["near"]
    windows, past, _ = near.shape
    draw = torch.rand(windows, generator=generator)
    varied, mirror, angle = _mirrored_and_turned(batch, _VECTORS, draw, generator)
    yaw = batch["yaw"] * mirror[:, None, None] + angle[:, None, None]
    varied["yaw"] = yaw * near
    is_late = torch.arange(past) >= _first_frames(windows, past, generator)[:, None]
    is_found = torch.rand(near.shape, generator=generator) >= MISSING_SHARE
    is_shown = (is_late[..., None] & is_found).to(near.device)
    for name in _OF_DETECTIONS:
        mask = is_shown
        if varied[name].ndim > mask.ndim:
            mask = mask[..., None]
        varied[name] = varied[name] * mask
    return varied


def _mirrored_and_turned(
    batch: Tensors, names: Sequence[str], draw: torch.Tensor, generator: torch.Generator
) -> tuple[Tensors, torch.Tensor, torch.Tensor]:
    """Mirror and turn the vectors ``names`` of a batch.

    Also returns the signs [n], -1 where ``draw`` [n] is below a half, and the turns
    [n], rad.
    """
    mirror = torch.where(draw < 0.5, -1.0, 1.0)
    angle = TURN_RAD * torch.randn(len(draw), generator=generator)
    columns = [angle.cos(), -angle.sin(), angle.sin(), angle.cos()]
    turn = torch.stack(columns, -1).reshape(-1, 2, 2)
    signs = torch.stack([torch.ones_like(mirror), mirror], -1)
    device = batch["position"].device
    matrix = (turn * signs[:, None]).to(device)  # mirrors y, then turns
    varied = dict(batch)
    for name in names:
        varied[name] = torch.einsum("n...i,nji->n...j", batch[name], matrix)
    return varied, mirror.to(device), angle.to(device)


def _first_frames(windows: int, past: int, generator: torch.Generator) -> torch.Tensor:
    """Draw the first frame [windows] of each past that is kept.

    It is 0, so that all of ``past`` frames are kept, but in `SHORTENED_SHARE` of them.
    """
    is_cut = torch.rand(windows, generator=generator) < SHORTENED_SHARE
    first = torch.randint(0, past, (windows,), generator=generator)
    return torch.where(is_cut, first, 0)
