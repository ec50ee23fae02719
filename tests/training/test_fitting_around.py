"""The training of networks that see the detections around an object, and of one of which nothing is trained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mtp_bench.prediction.learned.affinity import Affinity
from mtp_bench.prediction.learned.codebook import Codebook
from mtp_bench.prediction.learned.network import Network
from mtp_bench.prediction.learned.tracking_free import TrackingFree
from mtp_bench.prediction.windows import Surroundings
from mtp_bench.training.fitting import Lesson, Plan, State, fit
from mtp_bench.types import starts_of
from tests.support.random_windows import SIZES, random_lesson, random_windows

CPU = torch.device("cpu")
FRAMES, TRACKS = 16, 3


def lesson_around(network: Network) -> Lesson:
    """Tracks of which every place is detected; each frame of windows ends a scene of P frames."""
    windows, moment = random_windows([TRACKS] * FRAMES)
    box = np.swapaxes(windows.box.reshape(FRAMES, TRACKS, SIZES.past, 7), 1, 2).reshape(-1, 7)
    class_id = np.repeat(windows.class_id.reshape(FRAMES, 1, TRACKS), SIZES.past, axis=1).ravel()
    before = np.tile(np.arange(SIZES.past), FRAMES)
    start = starts_of(np.full(FRAMES * SIZES.past, TRACKS))
    seen = Surroundings(start, box, np.zeros((len(box), 2)), class_id, np.ones(len(box)), before)
    inputs = network.inputs(windows, moment * SIZES.past + SIZES.past - 1, seen, SIZES)
    return replace(random_lesson(Codebook(), FRAMES), inputs=inputs)


def trained(network: Network, lesson: Lesson, folder: Path, epochs: int) -> State:
    return fit(network, SIZES, lesson, Plan(epochs=epochs, batch=8), CPU, lambda *_: None, folder / "checkpoint")


@pytest.mark.parametrize("network", [TrackingFree(), Affinity()], ids=lambda network: network.name)
def test_it_learns(network: Network, tmp_path: Path) -> None:
    curve = trained(network, lesson_around(network), tmp_path, 20).curve
    assert min(curve) < 0.7 * curve[0]


def test_a_network_without_stages_is_what_it_starts_as(tmp_path: Path) -> None:
    network, lesson = Codebook(), random_lesson(Codebook(), frames=60)
    learnt = ~lesson.validation
    inputs = {name: value[learnt] for name, value in lesson.inputs.items()}
    start = network.start(inputs, lesson.future[learnt], lesson.known[learnt], SIZES, 0)
    state = trained(network, lesson, tmp_path, 5)
    assert {name: value.tolist() for name, value in state.best.items()} == {n: v.tolist() for n, v in start.items()}
    assert len(state.curve) == 1
    assert np.isfinite(state.curve[0])
