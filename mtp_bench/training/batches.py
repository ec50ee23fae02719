"""The batches of a pass over the data: of single windows, or of whole frames."""

from __future__ import annotations

import torch


def shuffled(
    rows: torch.Tensor, moment: torch.Tensor | None, size: int, generator: torch.Generator
) -> tuple[torch.Tensor, ...]:
    """The rows [n] in batches of about ``size``, by lot.

    ``moment`` [all rows]: the frame of each; windows of one frame then stay together. None: each window for itself.
    """
    if moment is None:
        return torch.split(rows[torch.randperm(len(rows), generator=generator).to(rows.device)], size)
    frames, frame = torch.unique(moment[rows], return_inverse=True)
    return _cut(rows, torch.randperm(len(frames), generator=generator).to(rows.device)[frame], size)


def in_order(rows: torch.Tensor, moment: torch.Tensor | None, size: int) -> tuple[torch.Tensor, ...]:
    """The rows [n] in batches of about ``size``, whole frames where ``moment`` is given."""
    return torch.split(rows, size) if moment is None else _cut(rows, moment[rows], size)


def _cut(rows: torch.Tensor, rank: torch.Tensor, size: int) -> tuple[torch.Tensor, ...]:
    """The rows sorted by ``rank`` [n], in pieces that begin where a rank begins."""
    order = torch.argsort(rank, stable=True)
    first = torch.searchsorted(rank[order], rank[order])  # the row at which each one's frame begins
    _, count = torch.unique_consecutive(first // size, return_counts=True)
    return torch.split(rows[order], count.tolist())
