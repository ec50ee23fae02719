"""Environments of highway-env as scenes: recording, policies, crashes, classes that stay as they were, wrong cards."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, parse_card
from mtp_bench.core import Floats
from mtp_bench.core.errors import CardError, DataError
from mtp_bench.core.files import CACHE_VARIABLE
from mtp_bench.core.notice import QUIET_VARIABLE
from mtp_bench.sources import open_source, prepare
from mtp_bench.sources.base import section_of
from mtp_bench.traffic.gym import simulate as gym_simulate
from mtp_bench.traffic.gym.source import GymSource, traffic_of
from mtp_bench.traffic.highway.source import pack
from mtp_bench.traffic.highway.world import GymTraffic, World


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))


def gym_card(**source: Any) -> Card:
    content = load_card("MTP-Roundabout-v0").stored()
    seeds = {"train": [0, 1], "val": [5, 7], "test": [8, 9]}
    own = {"name": "gym", "id": "merge-v0", "config": {"simulation_frequency": 10}, "seconds": 8.0, "seeds": seeds}
    return parse_card({**content, "id": "MTP-Own-v0", "source": own | source, "lanes": True})


def traffic(env_id: str, seconds: float = 4.0, policy: str = "idm", **config: Any) -> GymTraffic:
    card = gym_card(id=env_id, policy=policy, config={"simulation_frequency": 10} | config)
    return replace(traffic_of(section_of(card, GymSource)), seconds=seconds)


def simulated(env_id: str, seconds: float = 4.0, policy: str = "idm") -> World:
    return gym_simulate.simulate(traffic(env_id, seconds, policy), 5)


def faster(observation: Floats) -> int:
    """The action that raises the speed, in the numbers of highway-env."""
    return 3


def test_a_scene_is_right_handed_and_lies_on_its_lanes() -> None:
    """The ramp of merge-v0 comes from the right: it is at y -14.5 m and turns to the left."""
    scene = open_source(gym_card()).load("merge-v0-000005")
    assert (scene.frames, scene.detector, scene.recording) == (16, "nuscenes_megvii, simulated detections", "")
    center = np.concatenate([lane.center for lane in scene.lanes])
    assert (center[:, 1].min(), center[:, 1].max()) == (-14.5, 0.0)
    assert [len(lane.following) for lane in scene.lanes].count(0) == 2, "the ramp's end is continued"
    truth, t = scene.truth, scene.truth.frame_of_rows
    assert set(truth.class_id.tolist()) == {0}
    np.testing.assert_array_equal(truth.box[0, 4:], (5.0, 2.0, 1.6))
    assert np.hypot(*(truth.box[:, None, :2] - center).transpose(2, 0, 1)).min(axis=1).max() < 2.5
    for number in np.unique(truth.object_id):
        own = truth.object_id == number
        moved = np.diff(truth.box[own, :2], axis=0)
        np.testing.assert_allclose(moved[np.diff(t[own]) == 1] * 2.0, truth.velocity[own][1:], atol=2.5)
    assert (np.diff(scene.ego[:, 0]) > 5).all()


def test_the_same_seed_gives_the_same_scene_after_others_changed_classes() -> None:
    from highway_env.vehicle.behavior import IDMVehicle

    first, wanted = pack(simulated("roundabout-v0")), IDMVehicle.DISTANCE_WANTED
    simulated("intersection-v1", 0.2)  # sets attributes of IDMVehicle
    assert wanted == IDMVehicle.DISTANCE_WANTED
    for name, array in pack(simulated("roundabout-v0")).items():
        np.testing.assert_array_equal(array, first[name], err_msg=name)


def test_no_lane_leads_back() -> None:
    """Beside each of the four exits of intersection-v1, 4 m away, begins the entry of the same road."""
    lanes = simulated("intersection-v1", 0.2).lanes
    assert [len(lane.following) for lane in lanes].count(0) == 4
    ends, starts = (np.array([lane.center[i + 1] - lane.center[i] for lane in lanes]) for i in (-2, 0))
    assert all(ends[k] @ starts[after] > 0 for k, lane in enumerate(lanes) for after in lane.following)


def test_policies() -> None:
    """The ego of merge-v0 starts with 30 m/s behind slower vehicles."""
    policies = "idm", "idle", f"{__name__}:faster"
    idm, idle, fast = (simulated("merge-v0", 3.0, policy).ego[-1, 0] for policy in policies)
    assert idm < idle - 1.0 <= fast - 1.0


def test_scenes_with_a_crash_are_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    crashed = gym_simulate.simulate(traffic("highway-v0", 20.0, f"{__name__}:faster", vehicles_density=6), 1)
    sound = simulated("merge-v0", 8.0)
    made: list[int] = []
    assert not len(crashed.time)

    def simulate(own: GymTraffic, seed: int) -> World:
        made.append(seed)
        return sound if seed == 6 else crashed

    monkeypatch.setattr(gym_simulate, "simulate", simulate)
    monkeypatch.delenv(QUIET_VARIABLE, raising=False)
    prepare(gym_card())
    assert [open_source(gym_card()).names for _ in range(2)] == [("merge-v0-000006",)] * 2
    assert made == [5, 6], "once per seed"
    assert "MTP-Own-v0: vehicles crash in 1 of 2 scenes, which are left out" in capsys.readouterr().err
    with pytest.raises(DataError, match="crash in 1 of 1 scenes, expected one without"):
        open_source(gym_card(split="train")).load("merge-v0-000000")


def test_misspelt_keys_are_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv(QUIET_VARIABLE, raising=False)
    config: dict[str, Any] = {
        "simulation_frequency": 10,
        "vehicle_count": 3,
        "action": {"type": "DiscreteMetaAction", "longitudnal": True},
    }
    gym_simulate.checked_rate(traffic("highway-v0", **config), 0)
    said = capsys.readouterr().err
    assert "highway-v0 has no default for the key 'vehicle_count' of [source] config: if it is misspelt, it" in said
    assert "'action.longitudnal'" in said
    assert "simulation_frequency" not in said


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ({"config": {}}, "task.rate is 2 Hz, expected 15 Hz or a whole part of it; or set config"),
        ({"id": "nowhere-v0"}, "source.id: got 'nowhere-v0', expected an id .*registers .*nowhere"),
        ({"id": "CartPole-v1", "config": {}}, "CartPole-v1 is not an environment of highway-env"),
        ({"id": "no_such_module:A-v0"}, "no module 'no_such_module', which"),
        ({"module": "no_such.module"}, "no module 'no_such.module', which"),
        (
            {"config": {"simulation_frequency": 10, "policy_frequency": 20}},
            "policy_frequency 20 above simulation_frequency",
        ),
        (
            {"id": "highway-v0", "config": {"simulation_frequency": 10, "vehicles_count": 0}},
            "no vehicle but those of the",
        ),
        ({"policy": "fast"}, "policy: got 'fast': expected 'idm', 'idle' or"),
        ({"policy": "sys:exit"}, "no module 'sys', which"),
        ({"id": "lane-keeping-v0"}, "lane-keeping-v0 with policy 'idm' cannot be simulated: AttributeError: "),
    ],
)
def test_wrong_cards(source: dict[str, Any], text: str) -> None:
    with pytest.raises((CardError, DataError), match=text):
        prepare(gym_card(**source))
