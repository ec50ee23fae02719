"""Forecasts of a run in files: two objects of a small nuScenes root by hand, in each form."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

from mtp_bench.core import CardError, MtpBenchError, Rollout
from mtp_bench.running import export_forecasts
from mtp_bench.running.rollout_files import Run, RunInfo
from mtp_bench.running.stored import OpenedRun
from mtp_bench.sources import NuScenes, lidar_pose, open_source, to_global
from tests.support.command_line import CommandLine
from tests.support.nuscenes_root import VERSION, edited, nuscenes_card, sample, write_root
from tests.support.scoring_scenes import CAR, WALKER, Thing, at, make_rollout
from tests.support.small_scenes import CARD

SCENE = "scene-0003"
STEPS = np.arange(1, 13)[:, None]
# Car: track 4 is a metre beside it, track 5 nearer but of a walker. Eight samples of speeds 1 to 8 m per step, the
# fastest one absent, the third the heaviest. Walker: no track.
SPEEDS = np.arange(1, 9)
WEIGHTS = np.array([0.1, 0.1, 0.3, 0.1, 0.1, 0.2, 0.1, 0.0])
CAR_PATHS = np.array([10.0, 2.0]) + SPEEDS[:, None, None] * STEPS * [0.0, 1.0]
FRAME: list[Thing] = [
    at(0, (10, 2), class_id=CAR, forecast=CAR_PATHS, log_weight=np.log(WEIGHTS, where=WEIGHTS > 0, out=np.full(8, -np.inf)),
       confidence=0.75),
    at(0, (5, 5), class_id=WALKER, forecast=np.broadcast_to([5.0, 5.0], (8, 12, 2)), confidence=0.5),
]  # fmt: skip
TRACKS = [at(4, (11, 2), class_id=CAR), at(5, (10, 2.1), class_id=WALKER)]


def rollout() -> Rollout:
    made = make_rollout([[], TRACKS, [], []], [[], FRAME, [], []], name=SCENE, samples=8, future=12)
    box = made.object_box.copy()
    box[:, 2] = 1.5
    return replace(made, object_box=box)


@pytest.fixture
def opened(tmp_path: Path) -> OpenedRun:
    data = write_root(tmp_path / "data")
    with edited(data / "nuscenes" / VERSION / "calibrated_sensor.json") as sensors:
        sensors[0].update(translation=[1.0, 0.0, 2.0], rotation=[0.9950041652780258, 0.09983341664682815, 0.0, 0.0])
    card = nuscenes_card()
    info = RunInfo(
        env_id=card.id, card_digest=card.digest, observe="detections", samples=8, split="all", keywords={},
        agent="drawn", parameters={}, submission_digest="", seed=0, definitions="", versions={},
    )  # fmt: skip
    return OpenedRun(tmp_path, Run(info, (rollout(),)), card, open_source(card, data), str(data))


def written(opened: OpenedRun, form: Any, file: Path) -> tuple[tuple[int, int], dict[str, Any]]:
    counts = export_forecasts(opened, file, form)
    return counts, json.loads(file.read_text())["results"]


def test_the_form_of_mfeval(opened: OpenedRun, tmp_path: Path) -> None:
    counts, results = written(opened, None, tmp_path / "f.json")
    assert counts == (1, 1), "a walker has no place in it"
    assert list(results) == [sample(SCENE, t) for t in range(4)]
    (car,) = results.pop(sample(SCENE, 1))
    assert list(results.values()) == [[], [], []]
    paths, weights = np.array(car.pop("traj")), np.array(car.pop("traj_prob"))
    assert car == {
        "sample_token": sample(SCENE, 1), "class_name": "car", "translation": [10.0, 2.0], "detection_score": 0.75
    }  # fmt: skip
    assert paths[:, 0, 1].tolist() == [5.0, 8.0, 3.0, 4.0, 6.0, 7.0, 9.0], "the heaviest first, without the absent one"
    np.testing.assert_allclose(weights, [0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1])
    np.testing.assert_array_equal(paths[0], CAR_PATHS[2])


def test_the_form_of_uniad(opened: OpenedRun, tmp_path: Path) -> None:
    counts, results = written(opened, "uniad", tmp_path / "f.json")
    assert counts == (2, 0)
    car, walker = results[sample(SCENE, 1)]
    assert [car["tracking_id"], walker["tracking_id"]] == ["4", "7"], "a new number: those of tracks end at 5"
    assert [car["tracking_name"], walker["detection_name"]] == ["car", "pedestrian"]
    assert [car["tracking_score"], car["detection_score"], car["attribute_name"]] == [0.75, 0.75, ""]
    np.testing.assert_allclose(np.exp(car["predict_traj_score"]), np.array([3, 2, 1, 1, 1, 1]) / 9)
    points = np.array(car["predict_traj"])
    assert points.shape == (6, 12, 2)
    pose = lidar_pose(NuScenes(opened.card, opened.data).tables, sample(SCENE, 1))
    height = np.full((6, 12, 1), car["translation"][2])
    places = to_global(np.concatenate([points, height], axis=2), pose)
    np.testing.assert_allclose(places[..., :2], CAR_PATHS[[2, 5, 0, 1, 3, 4]], atol=2e-4)
    # the lidar is at (0, 3), 2.5 m high, looks along y and leans by .2 rad: the first place is 2 m ahead, 10 m to the right
    np.testing.assert_allclose(points[0, 0], [2.0, -10 * np.cos(0.2) - np.sin(0.2)], atol=2e-4)


def test_the_form_of_a_table(opened: OpenedRun, tmp_path: Path) -> None:
    assert export_forecasts(opened, tmp_path / "tables", "table") == (2, 0)
    table = parquet.read_table(tmp_path / "tables" / f"{SCENE}.parquet").to_pydict()
    places = [f"{axis}{step}" for step in range(1, 13) for axis in "xy"]
    assert list(table) == [
        "frame", "class", "x", "y", "z", "yaw", "l", "w", "h", "object", "id", "confidence", "mode", "weight", *places
    ]  # fmt: skip
    assert table["object"] == [0] * 7 + [1] * 8
    assert set(zip(table["frame"], table["class"], table["id"], strict=True)) == {(1, "car", 4), (1, "pedestrian", 7)}
    assert table["mode"][:8] == [0, 1, 2, 3, 4, 5, 6, 0]
    assert [table["y1"][2], table["y12"][2], table["z"][2], table["confidence"][2]] == [5.0, 38.0, 1.5, 0.75]
    assert sum(table["weight"][:7]) == pytest.approx(1.0)
    with pytest.raises(MtpBenchError, match="is not empty"):
        export_forecasts(opened, tmp_path / "tables", "table")


def test_a_name_or_a_card_that_does_not_fit(opened: OpenedRun, tmp_path: Path) -> None:
    for form, name in (("mfeval", "folder"), ("uniad", "folder"), ("table", "f.json")):
        with pytest.raises(CardError, match=f"the form is {form}; expected a .json file for mfeval or uniad"):
            export_forecasts(opened, tmp_path / name, form)  # type: ignore[arg-type]
    short = replace(
        opened, card=opened.card.model_copy(update={"task": opened.card.task.model_copy(update={"future": 6})})
    )
    with pytest.raises(CardError, match="has 6 steps of nuscenes, expected 12 of nuScenes"):
        export_forecasts(short, tmp_path / "f.json")
    assert not (tmp_path / "f.json").exists()


def test_the_command(cli: CommandLine, events_run: Path, tmp_path: Path, kitti: str) -> None:
    assert "MTP-Small-v0" in CARD
    said = cli.ok("export", events_run, "--data", kitti, "--forecasts", "-o", tmp_path / "tables")
    assert said == f"{tmp_path / 'tables'}: 3 objects; left out: 0 of other classes\n"
    assert {path.name for path in (tmp_path / "tables").iterdir()} == {"0001.parquet", "0006.parquet", "0008.parquet"}
    error = cli(
        "export", events_run, "--data", kitti, "--forecasts", "--form", "uniad", "-o", tmp_path / "f.json"
    ).error
    assert "expected 12 of nuScenes, as MFEval and UniAD have" in error
    error = cli("score", events_run, "--data", kitti, "--official").error
    assert "expected 12 of nuScenes, as MFEval and UniAD have" in error
