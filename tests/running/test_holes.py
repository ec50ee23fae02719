"""One car at constant speed, with and without two seconds that are missing in the files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.agent import Pipeline, Tracker
from mtp_bench.cards import Card, load_card, with_files
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.running.reading import read_status
from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.sources import open_source
from mtp_bench.tracking import HypothesisTracker, OnlineTracker, TruthTracker
from mtp_bench.types import Task
from tests.sources.test_kitti import CALIBRATION, QUARTER, detection, kitti_card, label, oxts
from tests.support import nuscenes_root as tables
from tests.support.runs import run_scenes
from tests.support.source_files import write

SPEED = 2.0  # m/s
Files = Callable[[Path, Sequence[float]], Card]  # writes the frames at these times, s; the card of the files


def own(data: Path, times: Sequence[float], numbers: Sequence[int] = ()) -> Card:
    rows = [
        f"{t},{{}}car,{SPEED * time},0,0.75,0,4,2,1.5" for t, time in zip(numbers or range(99), times, strict=False)
    ]
    columns = "class,x,y,z,yaw,l,w,h"
    write(data / "logs/a/truth.csv", f"frame,id,{columns}", *(row.format("7,") for row in rows))
    write(data / "logs/a/detections.csv", f"frame,{columns}", *(row.format("") for row in rows))
    if not numbers:
        write(data / "logs/a/ego.csv", "frame,time", *(f"{t},{time}" for t, time in enumerate(times)))
    return with_files(load_card("MTP-nuScenes-mini-v0"), str(data / "logs"))


def own_numbers(data: Path, times: Sequence[float]) -> Card:
    """Without times, a number without rows is an empty frame."""
    return own(data, times, [round(2 * time) for time in times])


def nuscenes(data: Path, times: Sequence[float]) -> Card:
    made, count = tables.make_tables(("a",)), len(times)
    linked = [{"token": f"s{t}", "prev": f"s{t - 1}" if t else "", "next": f"s{t + 1}"} for t in range(count)]
    linked[-1]["next"] = ""
    lidar = next(
        row for row in made["sample_data"] if row["is_key_frame"] and row["calibrated_sensor_token"] != "cam-1"
    )
    box, car = made["sample_annotation"][0], made["instance"][0]
    ends = {"first_annotation_token": "s0", "last_annotation_token": f"s{count - 1}"}
    made["scene"][0] |= {"nbr_samples": count, "first_sample_token": "s0", "last_sample_token": f"s{count - 1}"}
    made["instance"] = [{**car, "nbr_annotations": count, **ends}]
    for name, row in (("sample", made["sample"][0]), ("sample_data", lidar), ("sample_annotation", box)):
        made[name] = [{**row, "sample_token": f"s{t}", **link} for t, link in enumerate(linked)]
    results: dict[str, list[Any]] = {}
    for t, time in enumerate(times):
        place = [SPEED * time, 1.0, 1.0]
        made["sample"][t]["timestamp"] = 10**15 + round(1e6 * time)
        made["sample_annotation"][t] |= {"translation": place, "rotation": tables.AHEAD}
        results[f"s{t}"] = [tables.detection(f"s{t}", translation=place, rotation=tables.AHEAD)]
    tables.write_tables(data, made)
    tables.write_json(data / tables.DETECTIONS, {"meta": {}, "results": results})
    return tables.nuscenes_card(("car",))


def kitti(data: Path, times: Sequence[float]) -> Card:
    """Frames without any row, in a sequence whose length does not change."""
    folder, frames = data / "kitti_tracking", [round(10 * time) for time in times]
    write(folder / "evaluate_tracking.seqmap.val", f"0000 empty 000000 {frames[-1] + 1:06d}")
    write(folder / "training/calib/0000.txt", CALIBRATION)
    write(folder / "training/oxts/0000.txt", *[oxts()] * (frames[-1] + 1))
    for place, row, kind in (("training/label_02", label, "Car"), ("detections/pointrcnn/Car", detection, 2)):
        made = [(t, 7, kind) if row is label else (t, kind) for t in frames]
        lines = [row(*one, 0, 1.65, 10 + SPEED * one[0] / 10, -QUARTER) for one in made]  # type: ignore[operator]
        write(folder / f"{place}/0000.txt", *lines)
    return kitti_card(("car",))


def mean_error(card: Card, data: Path, tracker: Tracker) -> tuple[float, SceneScore]:
    """Mean plain error of constant velocities, m."""
    observe = "truth" if isinstance(tracker, TruthTracker) else "detections"
    names = open_source(card, data).names

    def agent(task: Task) -> Pipeline:
        return Pipeline(tracker, KinematicPredictor(), KMeansSampler())

    rollouts = run_scenes(agent, card, {"data": str(data), "observe": observe}, names)  # type: ignore[arg-type]
    score = score_scene(open_source(card, data).load(names[0]), rollouts[0], card)
    return float(score.capped.mean()), score


@pytest.mark.parametrize(("files", "rate"), [(own, 2), (own_numbers, 2), (nuscenes, 2), (kitti, 10)])
def test_two_missing_seconds_do_not_change_the_error(files: Files, rate: int, tmp_path: Path) -> None:
    times = np.arange(80) / rate
    found = {}
    for name, kept in (("whole", times), ("hole", times[(times < 30 / rate) | (times >= 30 / rate + 2)])):
        card = files(tmp_path / name, kept.tolist())
        for tracker in (HypothesisTracker(), HypothesisTracker(5), TruthTracker()):
            error, score = mean_error(card, tmp_path / name, tracker)
            print(files.__name__, name, type(tracker).__name__, error, len(score), score.skipped)
