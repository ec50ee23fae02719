"""The training of networks that see the detections around an object."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mtp_bench.prediction.learned.affinity import Affinity
from mtp_bench.prediction.learned.modes import Modes
from mtp_bench.prediction.learned.network import Network
from mtp_bench.prediction.learned.tracking_free import TrackingFree
from mtp_bench.prediction.windows import Surroundings
from mtp_bench.training.checkpoint import Checkpoint
from mtp_bench.training.fitting import TrainingSet, fit
from mtp_bench.training.recipes import TrainingPlan
from mtp_bench.types import starts_of
from tests.support.random_windows import SIZES, random_training_set, random_windows

CPU = torch.device("cpu")
FRAMES, TRACKS = 16, 3


def training_set_around(network: Network) -> TrainingSet:
    """Tracks of which every place is detected; each frame of windows ends a scene of P frames."""
    windows, moment = random_windows([TRACKS] * FRAMES)
    box = np.swapaxes(windows.box.reshape(FRAMES, TRACKS, SIZES.past, 7), 1, 2).reshape(-1, 7)
    class_id = np.repeat(windows.class_id.reshape(FRAMES, 1, TRACKS), SIZES.past, axis=1).ravel()
    before = np.tile(np.arange(SIZES.past), FRAMES)
    start = starts_of(np.full(FRAMES * SIZES.past, TRACKS))
    seen = Surroundings(start, box, np.zeros((len(box), 2)), class_id, np.ones(len(box)), before)
    inputs = network.inputs(windows, moment * SIZES.past + SIZES.past - 1, seen, SIZES)
    return replace(random_training_set(Modes(), FRAMES), inputs=inputs)


def trained(network: Network, data: TrainingSet, folder: Path, epochs: int) -> Checkpoint:
    return fit(network, SIZES, data, TrainingPlan(epochs=epochs, batch=8), CPU, lambda *_: None, folder / "checkpoint")


@pytest.mark.parametrize("network", [TrackingFree(), Affinity()], ids=lambda network: network.name)
def test_it_learns(network: Network, tmp_path: Path) -> None:
    curve = trained(network, training_set_around(network), tmp_path, 20).curve
    assert min(curve) < 0.7 * curve[0]
