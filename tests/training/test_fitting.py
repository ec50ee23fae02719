"""The training of networks on tiny data: it learns, stages train what they say."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_info, threadpool_limits

from mtp_bench.core import starts_of
from mtp_bench.prediction.learned.affinity import AffinityNetwork
from mtp_bench.prediction.learned.modes import Modes
from mtp_bench.prediction.learned.network import Network
from mtp_bench.prediction.learned.ptp import Ptp
from mtp_bench.prediction.learned.tracking_free import TrackingFree
from mtp_bench.prediction.windows import Arrays, Surroundings
from mtp_bench.training.fitting import FittedNetwork, TrainingPlan, TrainingSet, fit, ordered_batches, shuffled_batches
from mtp_bench.training.losses import vary_tracks
from tests.support.random_windows import SIZES, random_training_set, random_windows

PLAN = TrainingPlan(epochs=6, batch=8)
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


def trained(network: Network, data: TrainingSet | None = None, plan: TrainingPlan = PLAN) -> FittedNetwork:
    return fit(network, SIZES, data or random_training_set(network), plan, CPU, lambda *_: None)


@pytest.mark.parametrize("network", [Modes(), Ptp(), TrackingFree(), AffinityNetwork()], ids=lambda n: n.name)
def test_it_learns(network: Network) -> None:
    data, share = (training_set_around(network), 0.7) if network.around else (random_training_set(network), 0.9)
    curve = trained(network, data, replace(PLAN, epochs=20)).curve
    assert min(curve) < share * curve[0]


def test_it_works_on_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums of several threads come in any order: OpenMP's too, with which scikit-learn finds codes."""
    seen: list[int] = []
    start = Modes.start

    def counted(*arguments: Any) -> Arrays:
        seen.extend(pool["num_threads"] for pool in threadpool_info())
        return start(*arguments)

    monkeypatch.setattr(Modes, "start", counted)
    with threadpool_limits(2):
        trained(Modes())
        assert {pool["num_threads"] for pool in threadpool_info()} == {2}
    assert set(seen) == {1}


def test_each_stage_of_ptp_trains_its_own_weights() -> None:
    """The first stage leaves the sampling function as k draws of the prior, the second leaves the rest as it is."""
    network, data = Ptp(), random_training_set(Ptp())
    learnt = ~data.validation
    inputs = {name: value[learnt] for name, value in data.inputs.items()}
    start = network.start(inputs, data.future[learnt], data.is_known[learnt], SIZES, PLAN.seed)
    first, last = after_stages(1), after_stages(2)
    for name in start:
        assert np.array_equal(first[name], start[name]) or name.startswith("cvae."), name
        assert np.array_equal(last[name], first[name]) or name.startswith("sampler."), name
    assert not np.array_equal(first["cvae.step.weight"], start["cvae.step.weight"])
    assert not np.array_equal(last["sampler.1.weight"], first["sampler.1.weight"])


def after_stages(count: int) -> Arrays:
    """The best weights of PTP after so many stages of three epochs."""
    network = Ptp()
    stages = tuple(replace(stage, share=0.5) for stage in network.recipe.stages[:count])
    network.recipe = replace(network.recipe, stages=stages)
    return trained(network, plan=replace(PLAN, rate=0.01)).best


def test_windows_of_a_frame_are_mirrored_together() -> None:
    batch = random_training_set(Ptp()).tensors(CPU)
    out = vary_tracks(batch, torch.Generator().manual_seed(0))
    mirrored = torch.sign(out["place"][:, 1] * batch["place"][:, 1])
    assert ({len(set(frame.tolist())) for frame in torch.split(mirrored, 3)}, len(set(mirrored.tolist()))) == ({1}, 2)


MOMENT = torch.tensor([5, 5, 1, 1, 1, 7, 5, 2, 9, 9])
ROWS = torch.tensor([0, 1, 2, 4, 5, 6, 7, 8, 9])  # without row 3


@pytest.mark.parametrize("moment", [None, MOMENT], ids=["windows", "frames"])
@pytest.mark.parametrize("size", [1, 3, 4, 100])
def test_every_window_once(moment: torch.Tensor | None, size: int) -> None:
    for batches in (
        ordered_batches(ROWS, moment, size),
        shuffled_batches(ROWS, moment, size, torch.Generator().manual_seed(0)),
    ):
        assert sorted(torch.cat(batches).tolist()) == ROWS.tolist()


@pytest.mark.parametrize("size", [1, 3, 4])
def test_frames_stay_whole_and_batches_small_and_a_seed_repeats_them(size: int) -> None:
    orders = []
    for seed in (1, 1, 2):
        batches = shuffled_batches(ROWS, MOMENT, size, torch.Generator().manual_seed(seed))
        frames = [set(MOMENT[part].tolist()) for part in batches]
        assert sum(map(len, frames)) == 5  # no frame in two batches
        assert all(len(part) < size + 3 for part in batches)  # the largest frame has 3 windows
        orders.append(torch.cat(batches).tolist())
    assert orders[0] == orders[1] != orders[2]
