"""Costs of identity switches near the ego (`benchmarks/driving.py show`): a planted one is found, a null is not."""

import numpy as np
import pytest

from benchmarks.driving_measure import Kept, Moments
from benchmarks.driving_switches import Windows, cost_in_scenes, cost_in_windows
from tests.drive.test_record import of

FRAMES, SCENES = 40, 150


def drive(rng: np.random.Generator, cost: float) -> Kept:
    """A drive at 2 Hz with a switch in each tenth frame; an accident in each frame, likelier by ``cost`` after one."""
    switch, brakes, hit = rng.random(FRAMES) < 0.1, list[float](), FRAMES
    for frame in range(FRAMES - 1, -1, -1):
        after = switch[max(0, frame - 3) : frame + 1].any()
        brakes += [frame / 2 + 0.1] * bool(rng.random() < 0.03 + cost * after)
        hit = frame if rng.random() < 0.01 + cost / 2 * after else hit
    frames = min(hit + 1, FRAMES)
    events = np.array([[f, 0, 5.0, 0.0, 0.0] for f in np.flatnonzero(switch[:frames])]).reshape(-1, 5)
    same, phantom = np.ones(frames), np.sort(brakes)
    record = of(50.0, "car" * (hit < FRAMES), hit < FRAMES)
    object.__setattr__(record, "seconds", hit / 2 + 0.3)
    return Kept("", record, Moments(events, 8 * same, same, 5 * same, phantom[phantom < hit / 2], np.zeros(0)))


@pytest.mark.parametrize("cost", [0.0, 0.1])
def test_cost_of_a_planted_effect(cost: float) -> None:
    rng = np.random.default_rng(5)
    kept = [[drive(rng, cost) for _ in range(SCENES)] for _ in range(2)]
    windows = Windows.joined(Windows.of(one, 0.5, s, a) for a, row in enumerate(kept) for s, one in enumerate(row))
    costs = cost_in_windows(windows)
    for name in ("collision at fault", "phantom brake"):
        found = costs[f"{name}, no switch before it"]
        assert found is not None
        assert (found["low"] > 0) == (cost > 0)
        assert found["low"] <= found["difference"] <= found["high"]
        assert 0 < found["seen"] < 0.2
    switches = np.array([[one.moments.switches().sum() for one in row] for row in kept])
    seconds = np.array([[one.drive.seconds for one in row] for row in kept])
    score = rng.normal(size=switches.shape) - 10 * cost * (switches > 0)
    whole = cost_in_scenes(switches, seconds, score)["any switch"]
    assert whole is not None
    assert (whole["high"] < 0) == (cost > 0)
