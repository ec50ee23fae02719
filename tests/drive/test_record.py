"""What is recorded of a drive, its score, and rows of agents, by hand."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import savgol_filter

from mtp_bench.core import Drive, Floats, Truth, starts_of
from mtp_bench.scoring.driving import AgentDrives, driving_rows, fault_interval, scene_score, score_interval
from mtp_bench.scoring.statistics import bootstrap_interval, paired_difference
from mtp_bench.traffic.drive_record import is_comfortable, record_of, smoothed_jerk
from mtp_bench.traffic.highway.world import CLASSES, World
from mtp_bench.traffic.planner import Decision
from tests.drive.test_planner import SIZE, WAY, car

STEPS = 40
ALWAYS = range(STEPS + 1)


def driven(gain: Floats, *others: tuple[float, float, float, range], speed: float = 10.0) -> Drive:
    """Drive along x from 3 m on; each other one is at (x, y) first, drives along x, and is there in some steps."""
    ego = 3.0 + np.cumsum(np.append(0.0, speed + np.cumsum(np.append(0.0, gain[:-1])) / 10)) / 10
    rows = [(t, car(x + t / 10 * v, y), v) for t in ALWAYS for x, y, v, when in others if t in when]
    box, velocity = np.zeros((len(rows), 7)), np.zeros((len(rows), 2))
    for i, (_, own, v) in enumerate(rows):
        box[i], velocity[i, 0] = own, v
    start, yes = starts_of([sum(row[0] == t for row in rows) for t in ALWAYS]), np.ones(len(rows), dtype=bool)
    truth = Truth(start, box, velocity, np.full(len(rows), CLASSES.index("car")), np.arange(len(rows)), yes, ~yes)
    world = World(np.arange(len(ego)) / 10, np.column_stack([ego, np.zeros((len(ego), 3))]), truth, ())
    traffic: Any = SimpleNamespace(world=lambda: world, collision=None, way=WAY, size=SIZE, at_goal=True)
    return record_of(traffic, ego, gain, [Decision(0.0, 0.0, -1, ego[:2])])


def test_way_and_end_and_two_near_misses() -> None:
    drive = driven(np.zeros(STEPS))
    assert (round(drive.way, 9), drive.seconds, drive.goal, drive.collision) == (40.0, 4.0, True, "")
    assert (drive.at_fault, drive.near_misses, drive.phantom_brakes, drive.comfortable) == (False, 0, 0, True)
    twice = (20.0, 0.0, 0.0, range(8, 12)), (40.0, 0.0, 0.0, range(26, 30))
    assert driven(np.zeros(STEPS), *twice).near_misses == 2, "once each"


# one other at first: .9 s ahead, 1 s, driving on, beside the strip, towards the ego, behind it; last, the ego stands
NEAR = (((16.5, 0.0, 0.0), 10.0, 1), ((17.5, 0.0, 0.0), 10.0, 0), ((16.5, 0.0, 5.0), 10.0, 0),
        ((16.5, 2.0, 0.0), 10.0, 0), ((26.0, 0.0, -10.0), 10.0, 1), ((-5.0, 0.0, 25.0), 10.0, 0),
        ((9.0, 0.0, -10.0), 0.0, 0))  # fmt: skip


@pytest.mark.parametrize(("other", "speed", "count"), NEAR)
def test_near_misses(other: tuple[float, float, float], speed: float, count: int) -> None:
    assert driven(np.zeros(STEPS), (*other, range(1)), speed=speed).near_misses == count


HARD = -3.5 * np.isin(np.arange(STEPS), (5, 6, 7, 20))
ONE = -3.5 * (np.arange(STEPS) == 5)  # at x = 8 m, 10 m/s


@pytest.mark.parametrize(("gain", "others", "count"), [
    (0.8 * HARD, (), 0), (HARD, (), 2), (HARD, ((25.0, 0.0, 9.0, range(10)),), 1),
    *((HARD, ((x, y, 9.0, ALWAYS),), 2) for x, y in ((25.0, 6.0), (45.0, 0.0), (-9.0, 0.0))),
    # at the ends of the strip ahead when the brake begins: beyond it, and in it though the ego passes in that step
    (ONE, ((42.35, 0.0, 0.0, range(5, 6)),), 1), (ONE, ((7.75, 0.0, 0.0, range(5, 6)),), 0),
])  # fmt: skip
def test_hard_brakes_without_a_cause(gain: Floats, others: Any, count: int) -> None:
    assert driven(gain, *others).phantom_brakes == count


def test_comfort() -> None:
    none, speed, step = np.zeros(30), np.full(30, 10.0), np.arange(30)
    for most, good in ((-4.0, True), (-4.1, False), (2.3, True), (2.5, False)):
        assert is_comfortable(most * np.minimum(step / 15, 1.0), speed, none) == good
    assert not is_comfortable(np.where(step < 15, -3.9, 2.3), speed, none), "a jerk"
    assert is_comfortable(none, speed, 0.045 * step), "4.5 m/s2 across"
    assert not is_comfortable(none, speed, 0.05 * step), "5 m/s2 across"
    gains = np.random.default_rng(0).normal(size=30)
    np.testing.assert_allclose(smoothed_jerk(gains), savgol_filter(gains, 15, 2, deriv=1, delta=0.1), atol=1e-11)


def of(way: float, collision: str = "", at_fault: bool = False, near: int = 0, comfortable: bool = True) -> Drive:
    none, place = np.zeros(1), np.zeros((1, 2, 2))
    size, route = np.array(SIZE), np.zeros((1, 4))
    comfort, cause = comfortable, none.astype(np.int64)
    return Drive(
        way, 20.0, way > 99, collision, at_fault, near, 1, comfort, none, none, cause, place, -1, size, none, route
    )  # fmt: skip


@pytest.mark.parametrize(
    ("drive", "reference", "twelfths"),
    [
        (of(90.0), 80.0, 12.0), (of(50.0), 100.0, 9.5), (of(80.0, near=3), 80.0, 7.0),
        (of(80.0, comfortable=False), 80.0, 10.0), (of(25.0, near=1, comfortable=False), 100.0, 1.25),
        (of(80.0, "car", True), 80.0, 0.0), (of(80.0, "car"), 80.0, 12.0),
        (of(0.0), 5.0, 7.0), (of(0.0), 4.9, 12.0), (of(0.0), 0.0, 12.0),
    ],
)  # fmt: skip
def test_drive_score(drive: Drive, reference: float, twelfths: float) -> None:
    assert scene_score(drive, reference) == pytest.approx(twelfths / 12)


def test_rows_are_paired_by_scene() -> None:
    reference = {f"s{i}": 100.0 for i in range(8)}
    stp = AgentDrives("stp", {name: [of(50.0)] for name in reference})
    good = {name: [of(60.0 + 4 * i), of(100.0)] for i, name in enumerate(reference)}
    good["s7"] = [of(50.0, "car", True, near=2), of(100.0, "bus")]
    first, last = driving_rows([stp, AgentDrives("good", good)], reference, stp)
    scores = np.array([(7 + (1.6 + 0.04 * i) * 2.5) / 12 for i in range(7)] + [0.5])
    test = paired_difference(scores, np.full(8, 9.5 / 12), np.ones(8))
    assert test is not None
    assert (first.agent, last.agent, last.difference, last.p) == ("good", "stp", None, None)
    assert first.interval == pytest.approx(bootstrap_interval(scores, np.ones(8)))
    assert first.collisions_interval == fault_interval(6.25, 8)
    assert score_interval([1.0, 0.8, 1.0, 0.0, 1.0]) == (0.0, 1.0)  # the bootstrap's ends at 1.1
    exact = [fault_interval(100.0 * hits / 20, 20) for hits in (0, 3, 20)]  # as in tables of Clopper and Pearson
    assert exact == [pytest.approx(pair, abs=0.01) for pair in ((0.0, 16.84), (3.21, 37.89), (83.16, 100.0))]
    assert first.difference_interval == pytest.approx(test.interval)
    means = scores.mean(), scores.mean() - 9.5 / 12, test.p
    assert (first.drive_score, first.difference, first.p) == pytest.approx(means)
    assert (first.collisions, first.any_collision, first.near_misses, first.phantom_brakes) == (6.25, 12.5, 12.5, 100.0)
    assert (first.goal_seconds, last.goal_seconds, last.progress, last.comfort) == (20.0, None, 0.5, 1.0)
