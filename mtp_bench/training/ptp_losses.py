"""The losses of `prediction.learned.ptp`: of the autoencoder, then of the diverse codes; all in torch."""

from __future__ import annotations

import torch

from ..prediction.learned.modes import straight
from ..prediction.learned.network import Network, Sizes
from ..prediction.learned.ptp import decoded, posterior, sampled, seen_of
from .losses import PRESENT, Tensors, mode_distance, present_error, weighted

CODES = 0.02  # of the divergence of a code from the prior, beside squared errors in units of their scale
LIKELY = 0.0005  # of the unlikeliness of the k codes under the prior, beside distances in units of their scale
DIVERSE = 0.02  # of the likeness of the k futures
WIDTH = 1.0  # squared distance, in units of the scale, at which two futures are alike no more


def autoencoder(
    network: Network, weights: Tensors, batch: Tensors, sizes: Sizes, progress: float, generator: torch.Generator
) -> torch.Tensor:
    """Squared error of the future that is decoded from its own code, and divergence of that code from the prior."""
    context = seen_of(weights, batch, sizes)
    wanted = batch["future"] - straight(batch, sizes)
    mean, log_variance = posterior(weights, context, *_steps(weights, wanted, batch["known"]))
    code = mean + (0.5 * log_variance).exp() * _normal(mean, generator)
    made = decoded(weights, context, code[:, None], sizes)[:, 0]
    error = (((made - wanted) / _scale(weights)) ** 2).sum(-1)
    error = (error * batch["known"]).sum(-1) / batch["known"].sum(-1).clip(1)
    here = present_error(torch.matmul(context, weights["cvae.present.weight"]) + weights["cvae.present.bias"], batch)
    return weighted(error + CODES * _divergence(mean, 0.5 * log_variance) + PRESENT * here, batch)


def diverse(
    network: Network, weights: Tensors, batch: Tensors, sizes: Sizes, progress: float, generator: torch.Generator
) -> torch.Tensor:
    """As DLow: distance of the best of k futures, their likeness to one another, how unlikely their codes are."""
    context = seen_of(weights, batch, sizes)
    code = sampled(weights, context, sizes)
    modes = decoded(weights, context, code, sizes)
    wanted = batch["future"] - straight(batch, sizes)
    best = mode_distance(modes, wanted, batch["known"]).amin(dim=1) / _scale(weights)
    unlikely = 0.5 * (code**2).sum(-1).mean(dim=1)
    return weighted(best + DIVERSE * _likeness(modes / _scale(weights)) + LIKELY * unlikely, batch)


def _steps(weights: Tensors, wanted: torch.Tensor, known: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Steps [n, T, 2] of corrections in units of their spread, and where both ends are known, [n, T]."""
    steps = torch.diff(wanted, dim=1, prepend=torch.zeros_like(wanted[:, :1])) / weights["step.spread"]
    both = known * torch.cat([known[:, :1], known[:, :-1]], 1)
    return steps * both[:, :, None], both


def _scale(weights: Tensors) -> torch.Tensor:
    """How wrong constant velocity is on the way, m."""
    return weights["step.spread"].cumsum(0).mean()


def _normal(like: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    return torch.randn(like.shape, generator=generator).to(like.device)


def _divergence(mean: torch.Tensor, log_spread: torch.Tensor) -> torch.Tensor:
    """Kullback-Leibler divergence [...] of normal codes [..., C] from the standard normal prior."""
    return 0.5 * ((2 * log_spread).exp() + mean**2 - 1 - 2 * log_spread).sum(-1)


def _likeness(modes: torch.Tensor) -> torch.Tensor:
    """Mean over all pairs of modes [n, S, T, 2] of exp(-squared distance): [n]."""
    flat = modes.flatten(2) / (WIDTH * modes.shape[2]) ** 0.5
    square = (flat**2).sum(-1)
    distance = (square[:, :, None] + square[:, None] - 2 * flat @ flat.transpose(1, 2)).clip(0)
    samples = modes.shape[1]
    alike: torch.Tensor = (-distance).exp().sum((1, 2)) - samples  # without each mode's likeness to itself
    return alike / max(1, samples * (samples - 1))
