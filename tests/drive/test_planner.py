"""The fixed planner on a straight way along x: what makes it stop or yield, and what it does not mind."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from mtp_bench.cards.card import PlannerSection
from mtp_bench.core import Floats, boxes_meet
from mtp_bench.scoring.driving import DRIVE_SCORE_WEIGHTS
from mtp_bench.traffic.drive_episode import obstacles
from mtp_bench.traffic.highway.driven import Way
from mtp_bench.traffic.planner import (
    _NEAR_MISS_SEVERITY,
    Obstacles,
    Planner,
    _Contacts,
    _without_creeping,
    contact_severity,
)
from tests.support.small_scenes import decode, full_action, task

SIZE, LIMIT = (4.5, 1.8), 10.0  # m, m/s
S = np.arange(0.0, 300.0, 0.5)
WAY = Way(S, np.stack([S, 0 * S], axis=1), 0 * S, np.full(len(S), LIMIT), np.zeros(len(S), dtype=np.int64))
PLANNER = Planner(WAY, SIZE, PlannerSection())


def car(x: float, y: float = 0.0, heading: float = 0.0) -> list[float]:
    return [x, y, 0.75, heading, 4.5, 1.8, 1.5]


def moving(boxes: ArrayLike = (), velocity: ArrayLike = (0.0, 0.0)) -> Obstacles:
    """Boxes at a constant velocity, with one sample each of 12 half seconds."""
    box = np.array(boxes, dtype=np.float64).reshape(-1, 7)
    far = 0.5 * np.arange(1, 13)[:, None] * np.broadcast_to(velocity, (len(box), 1, 1, 2))
    return Obstacles(box, box[:, None, None, :2] + far, np.ones((len(box), 1)), 0.5)


NOBODY = moving()


def drive(seen: Callable[[float], Obstacles], seconds: float, speed: float, planner: Planner = PLANNER) -> Floats:
    """Stations and speeds [N, 2] at 10 Hz of an ego that decides every half second."""
    s, rows = 0.0, []
    for step in range(round(10 * seconds)):
        if step % 5 == 0:
            wanted = planner.decide(s, speed, seen(step / 10)).acceleration
        gain = min(wanted, (planner.allowed(s) - speed) / 0.3) if wanted > -2.0 else wanted  # as `DrivenEpisode` does
        s, speed = s + speed / 10, speed + max(gain, -10 * speed) / 10
        rows.append((s, speed))
    return np.array(rows)


def contacts_of(planner: Planner, seen: Obstacles) -> _Contacts:
    """Contacts of an ego that drives its first 100 m."""
    steady = _without_creeping(seen, planner._weights.creep)
    return planner._contacts(0.0, 100.0, steady, np.zeros(len(seen.box), dtype=bool))


def same(first: Obstacles, second: Obstacles) -> bool:
    """True if an ego that drives 8 m/s at 20 m decides the same on both."""
    plans = [PLANNER.decide(20.0, 8.0, seen) for seen in (first, second)]
    return plans[0].acceleration == plans[1].acceleration and plans[0].risk == plans[1].risk


@pytest.mark.parametrize(
    ("speed", "time", "patience", "severity"),
    [(0.0, 0.0, 4.0, 0.15), (4.0, 0.0, 4.0, 1.0), (9.0, 0.0, 4.0, 1.0), (2.0, 0.0, 4.0, 0.575),
     (4.0, 4.0, 4.0, 1 / np.e), (4.0, 3.0, 1.5, 1 / np.e**2), (0.0, 2.0, 2.0, 0.15 / np.e)],
)  # fmt: skip
def test_severity_of_a_contact(speed: float, time: float, patience: float, severity: float) -> None:
    assert contact_severity(np.array(speed), np.array(time), patience) == pytest.approx(severity)


@pytest.mark.parametrize(("aside_m", "chance"), [(-0.4, 1.0), (-0.15, 0.75), (0.0, 0.5), (0.15, 0.25), (0.31, 0.0)])
def test_the_chance_of_a_contact_falls_over_the_margin(aside_m: float, chance: float) -> None:
    """A standing car is this far beside the ego's strip; a forecast place is wrong by up to .3 m."""
    contacts = contacts_of(PLANNER, moving(car(30.0, (SIZE[1] + 1.8) / 2 + aside_m)))
    assert contacts.chance.max(initial=0.0) == pytest.approx(chance)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, 0.4, 1.2, 2.2, -0.9])
def test_certain_forecasts_touch_where_boxes_meet(turn: float) -> None:
    """Cars that drive into all directions: without a margin there is a contact where boxes meet, and nowhere else."""
    rng = np.random.default_rng(round(10 * turn) + 10)
    planner = Planner(WAY, SIZE, PlannerSection(margin=1e-6, creep=0.0))
    ego_m = np.arange(5.0, 95.0, 0.37)
    boxes = np.array([car(s) for s in ego_m])
    for _ in range(40):
        box = np.array(car(rng.uniform(20, 60), rng.uniform(-20, 20), turn))
        seen = moving(box, rng.uniform(3, 8) * np.array([np.cos(turn), np.sin(turn)]))
        contacts = contacts_of(planner, seen)
        for step in range(12):
            here = (contacts.step == step) & (contacts.chance > 0.5)
            inside = (ego_m[:, None] >= contacts.low[here]) & (ego_m[:, None] <= contacts.high[here])
            place = np.concatenate([seen.path[0, 0, step], box[2:]])
            meets = boxes_meet(boxes, np.tile(place, (len(boxes), 1)))
            if np.cos(turn) > 0.5:
                meets &= ego_m < place[0]  # one that leads is passed from its middle on
                inside = inside[ego_m < place[0]]
                meets = meets[ego_m < place[0]]
            assert (inside.any(axis=1) == meets).all()


def test_a_car_that_drifts_aside_does_not_turn_on_the_spot() -> None:
    """It stands 3 m beside the way, where it would reach the ego only across."""
    assert not len(contacts_of(PLANNER, moving(car(30.0, 3.0), (0.0, 1.2))).step)
    assert len(contacts_of(PLANNER, moving(car(30.0, 3.0, np.pi / 2))).step), "one that stands across"
    turning = moving(car(30.0, -12.0), (0.0, 4.0))
    assert len(contacts_of(PLANNER, turning).step), "after some metres it has turned"


@pytest.mark.parametrize(("speed", "meets"), [(1.1, False), (1.3, True)])
def test_motion_below_the_noise_is_none(speed: float, meets: bool) -> None:
    """A place counts from .65 widths per second on, 1.17 m/s; so a car 8 m aside meets the way, or never does."""
    contacts = contacts_of(PLANNER, moving(car(30.0, -8.0, np.pi / 2), (0.0, speed)))
    assert bool(len(contacts.step)) == meets
    late = moving(car(30.0, -8.0, np.pi / 2))
    late.path[..., 6:, 1] += np.arange(6) * 3.0  # it leaves after 3 s
    assert len(contacts_of(PLANNER, late).step)


def test_a_near_miss_costs_what_it_does_in_the_drive_score() -> None:
    assert DRIVE_SCORE_WEIGHTS["no near miss"] / sum(DRIVE_SCORE_WEIGHTS.values()) == _NEAR_MISS_SEVERITY


def test_it_keeps_clear_of_near_misses() -> None:
    """An ego that comes to a standing car would never meet it within .95 s at its speed."""
    s, speed = drive(lambda t: moving(car(60.0, 0.0, np.pi / 2)), 25.0, 8.0).T
    assert (s + SIZE[0] / 2 + 0.95 * speed < 60.0 - SIZE[1] / 2).all()


@pytest.mark.parametrize(("headway", "least_m", "most_m"), [(0.0, 0.0, 3.2), (0.6, 3.4, 6.0), (1.2, 6.0, 12.0)])
def test_it_keeps_a_time_gap_to_a_leader(headway: float, least_m: float, most_m: float) -> None:
    """The leader drives 6 m/s, 4 m ahead of an ego that would drive 10 m/s."""
    planner = Planner(WAY, SIZE, PlannerSection(headway=headway))
    rows = drive(lambda t: moving(car(4.0 + SIZE[0] + 6.0 * t), (6.0, 0.0)), 15.0, 6.0, planner)
    gap_m = 4.0 + 6.0 * np.arange(1, 151) / 10 - rows[:, 0]
    assert least_m < gap_m[-50:].min() < most_m


def test_with_nobody_it_drives_at_the_allowed_speed() -> None:
    speed = drive(lambda t: NOBODY, 15.0, 0.0)[:, 1]
    assert (np.diff(speed) > -1e-9).all()
    assert LIMIT - 0.2 < speed[100:].min() <= speed.max() <= LIMIT
    short = replace(NOBODY, path=NOBODY.path[:, :, :1], dt=0.1)  # forecasts of .1 s
    assert PLANNER.decide(0.0, 1.0, short).acceleration >= 0


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, np.pi])
def test_it_stops_before_a_standing_obstacle(heading: float) -> None:
    rows = drive(lambda t: moving(car(60.0, 0.0, heading)), 25.0, 8.0)
    assert rows[-1, 1] < 1e-9
    assert 0.3 < 60.0 - SIZE[heading == np.pi / 2] / 2 - rows[-1, 0] - SIZE[0] / 2 < 6.0
    assert np.diff(rows[:, 1]).min() > -0.31, "it brakes in time"


def test_it_yields_to_a_car_that_crosses() -> None:
    """The car is on the way, 30 m ahead, when an ego at 8 to 10 m/s comes there."""
    crossing = np.array([car(30.0, -26.0 + 7.5 * step / 10, np.pi / 2) for step in range(121)])
    rows = drive(lambda t: moving(crossing[round(10 * t)], (0.0, 7.5)), 12.0, 8.0)
    for own, meets in ((rows, False), (drive(lambda t: NOBODY, 12.0, 8.0), True)):
        assert boxes_meet(np.array([car(s) for s in own[:, 0]]), crossing[1:]).any() == meets
    assert rows[:, 1].min() < 6.5
    assert rows[-1, 0] > 60.0, "it goes on afterwards"


@pytest.mark.parametrize("speed", [0.0, 8.0, 14.0])
def test_a_car_behind_in_its_lane_does_not_matter(speed: float) -> None:
    assert same(moving(car(12.0), (speed, 0.0)), NOBODY)


def test_it_brakes_where_a_contact_ahead_cannot_be_avoided() -> None:
    assert PLANNER.decide(20.0, 8.0, moving([car(12.0), car(26.0), car(40.0, 12.0)])).acceleration <= -4.5
    everywhere = [car(x, y) for x in np.arange(-20.0, 150.0, 4.0) for y in np.arange(-6.0, 7.0, 2.0)]
    for speed, way in ((0.0, 1.0), (8.0, 8.0)):
        assert (drive(lambda t: moving(everywhere), 10.0, speed)[-1] < (way, 1e-9)).all()


def test_absent_samples_nan_and_no_confidence_never_matter() -> None:
    """Two objects beside the way; one has a third sample across it, which is absent or not a number."""
    rules = task(future=12)
    action = full_action(replace(rules, future=3))
    action["forecast"] = np.zeros((rules.objects, rules.samples, 12, 2), dtype=np.float32)
    action["object_box"][:2, :2] = [[35.0, 5.0], [5.0, 5.0]]
    usual = obstacles(decode(action, rules), 0.5)
    for value in (-5.0, np.nan, 1e30):
        action["forecast"][0, 2, :, 1] = value
        assert same(obstacles(decode(action, rules), 0.5), usual)
    action["forecast"][0, 2, :, 1], action["forecast_log_weight"][0, 2] = -5.0, 0.0
    assert not same(obstacles(decode(action, rules), 0.5), usual)
    action["object_confidence"][:] = 0.0
    assert same(obstacles(decode(action, rules), 0.5), NOBODY)
    action["object_box"][0, 0] = np.nan
    assert len(obstacles(decode(action, rules), 0.5).box) == 1
