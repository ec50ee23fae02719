"""Batches: every window once, frames whole, the same for the same seed."""

from __future__ import annotations

import pytest
import torch

from mtp_bench.training.batches import in_order, shuffled

MOMENT = torch.tensor([5, 5, 1, 1, 1, 7, 5, 2, 9, 9])
ROWS = torch.tensor([0, 1, 2, 4, 5, 6, 7, 8, 9])  # without row 3


@pytest.mark.parametrize("moment", [None, MOMENT], ids=["windows", "frames"])
@pytest.mark.parametrize("size", [1, 3, 4, 100])
def test_every_window_once(moment: torch.Tensor | None, size: int) -> None:
    for batches in (in_order(ROWS, moment, size), shuffled(ROWS, moment, size, torch.Generator().manual_seed(0))):
        assert sorted(torch.cat(batches).tolist()) == ROWS.tolist()


@pytest.mark.parametrize("size", [1, 3, 4])
@pytest.mark.parametrize("seed", range(5))
def test_frames_stay_whole_and_batches_small(size: int, seed: int) -> None:
    batches = shuffled(ROWS, MOMENT, size, torch.Generator().manual_seed(seed))
    frames = [set(MOMENT[part].tolist()) for part in batches]
    assert sum(map(len, frames)) == 5  # no frame in two batches
    assert all(len(part) < size + 3 for part in batches)  # the largest frame has 3 windows


def test_the_same_seed_gives_the_same_batches() -> None:
    made = [torch.cat(shuffled(ROWS, MOMENT, 3, torch.Generator().manual_seed(seed))) for seed in (1, 1, 2)]
    assert torch.equal(made[0], made[1])
    assert not torch.equal(made[0], made[2])
