"""The fixed planner on a straight way along x: what makes it stop or yield, and what it does not mind."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike

from mtp_bench.cards.card import PlannerSection
from mtp_bench.core import Floats, boxes_meet
from mtp_bench.traffic.drive_episode import obstacles
from mtp_bench.traffic.highway.driven import Way
from mtp_bench.traffic.planner import Obstacles, Planner, contact_severity
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


def drive(seen: Callable[[float], Obstacles], seconds: float, speed: float) -> Floats:
    """Stations and speeds [N, 2] at 10 Hz of an ego that decides every half second."""
    s, rows = 0.0, []
    for step in range(round(10 * seconds)):
        if step % 5 == 0:
            wanted = PLANNER.decide(s, speed, seen(step / 10)).acceleration
        gain = min(wanted, (PLANNER.allowed(s) - speed) / 0.3) if wanted > -2.0 else wanted  # as `DrivenEpisode` does
        s, speed = s + speed / 10, speed + max(gain, -10 * speed) / 10
        rows.append((s, speed))
    return np.array(rows)


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


@pytest.mark.parametrize(("aside_m", "first_step"), [(0.4, 0), (0.9, 1), (1.4, 2), (5.9, 11), (6.1, None)])
def test_the_margin_grows_from_the_first_forecast_on(aside_m: float, first_step: int | None) -> None:
    """A standing car is this far beside the ego's strip; the margin grows by .5 m per step of half a second."""
    planner = Planner(WAY, SIZE, PlannerSection(margin=0.0, growth=1.0))
    disc_m = np.hypot(1.8 / 2, 4.5 / 6)
    seen = moving(car(30.0, SIZE[1] / 2 + disc_m + aside_m))
    contacts = planner._contacts(0.0, 60.0, seen, np.zeros(1, dtype=bool))
    assert min(contacts.step, default=None) == first_step


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
    assert rows[:, 1].min() < 6.0
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
