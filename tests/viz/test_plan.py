"""The plan of a drive in pictures and recordings, and its collision among the events."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.core import Drive
from mtp_bench.viz.plan import plan_at
from mtp_bench.viz.run_replay import Replay, replay
from mtp_bench.viz.terminal.event_table import Listed, show_collisions
from tests.support.scoring_scenes import line, make_card, make_rollout, make_scene, with_detections


def driven(
    stations: list[list[float]], acceleration: list[float], cause: list[int], hit: int = -1, seen: bool = False
) -> Replay:
    """A scene with car 5, forecast in each frame at 10 Hz, by whose forecasts the ego drives along x."""
    frames, plan = len(stations), np.zeros((len(stations), len(stations[0]), 2))
    plan[..., 0] = stations
    drive = Drive(
        way=1.0, seconds=0.3, goal=False, collision="car" if hit >= 0 else "", at_fault=True, near_misses=0,
        phantom_brakes=0, comfortable=True, acceleration=np.array(acceleration), risk=np.full(frames, 0.25),
        cause=np.array(cause), plan=plan, hit=hit, size=np.array([4.5, 1.8]), station=np.zeros(len(acceleration) + 1),
        route=np.zeros((1, 4)),
    )  # fmt: skip
    rollout = make_rollout(line([1] * frames), line([1] * frames))
    scene = with_detections(make_scene(line([5] * frames)), line([5] * frames) if seen else [[]] * frames)
    return replay(scene, replace(rollout, drive=drive), make_card())


def test_a_plan_is_hard_where_it_brakes_by_more_than_3_m_s2() -> None:
    run = driven([[0.0, 1.0, 1.9, 2.8], [1.0, 2.0, 3.0, 4.0]], [-4.0, 0.5], [0, -1])
    first, second = (plan_at(run, t) for t in range(2))
    assert first is not None
    assert second is not None
    assert (first.hard.tolist(), second.hard.tolist()) == ([True, True, False], [False] * 3)
    assert (first.acceleration, first.risk) == (-4.0, 0.25)
    np.testing.assert_array_equal(first.slower, run.rollout.object_box[:1])
    assert not len(second.slower)
    assert plan_at(replay(run.scene, make_rollout(line([1, 1])), make_card()), 0) is None, "not a closed loop"


def test_the_collision_is_an_event_of_the_last_frame(capsys: pytest.CaptureFixture[str]) -> None:
    for seen, cause in ((False, "detector: detected in 0 and forecast in 2"), (True, "planner: detected in 2")):
        run = driven([[0.0, 1.0]] * 3, [0.0] * 3, [-1] * 3, hit=5, seen=seen)
        (collision,) = (each for each in run.incidents if each.kind == "collision")
        assert (collision.name, collision.frame, collision.object_id) == ("collision-0", 2, 5)
        show_collisions([Listed.of(run, collision, "run", None)])
        assert f"collision at 0.3 s with car 5, at fault; {cause}" in " ".join(capsys.readouterr().out.split())
    assert not driven([[0.0, 1.0]] * 3, [0.0] * 3, [-1] * 3).incidents
