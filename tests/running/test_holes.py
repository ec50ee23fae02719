"""One car at constant speed, with and without two seconds that are missing in the files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.agent import Pipeline, Tracker
from mtp_bench.cards import Card, load_card, with_files
from mtp_bench.core import Task
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.running.reading import skipped_line
from mtp_bench.scoring import SceneScore, score_scene
from mtp_bench.sources import open_source
from mtp_bench.tracking import HypothesisTracker, TruthTracker
from tests.sources.test_kitti import CALIBRATION, QUARTER, detection, kitti_card, label, oxts
from tests.support import nuscenes_root as tables
from tests.support.runs import run_scenes
from tests.support.source_files import write

SPEED = 2.0  # m/s
FORMS: tuple[Any, ...] = ((label, (7, "Car")), (detection, (2,)))  # of KITTI: rows, and their numbers and types
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
    for name, records in made.items():
        tables.write_json(data / "nuscenes" / tables.VERSION / f"{name}.json", records)
    tables.write_json(data / tables.DETECTIONS, {"meta": {}, "results": results})
    return tables.nuscenes_card(("car",))


def kitti(data: Path, times: Sequence[float]) -> Card:
    """Frames without any row, in a sequence whose length does not change."""
    folder, frames = data / "kitti_tracking", [round(10 * time) for time in times]
    write(folder / "evaluate_tracking.seqmap.val", f"0000 empty 000000 {frames[-1] + 1:06d}")
    write(folder / "training/calib/0000.txt", CALIBRATION)
    write(folder / "training/oxts/0000.txt", *[oxts()] * (frames[-1] + 1))
    at = [(0.0, 1.65, 10 + SPEED * t / 10, -QUARTER) for t in frames]
    labels, seen = ([row(t, *kind, *place) for t, place in zip(frames, at, strict=True)] for row, kind in FORMS)
    write(folder / "training/label_02/0000.txt", *labels)
    write(folder / "detections/pointrcnn/Car/0000.txt", *seen)
    return kitti_card(("car",))


def score_of(card: Card, data: Path, tracker: Tracker) -> SceneScore:
    observe = "truth" if isinstance(tracker, TruthTracker) else "detections"
    names = open_source(card, data).names

    def agent(task: Task) -> Pipeline:
        return Pipeline(tracker, KinematicPredictor(), KMeansSampler())

    rollouts = run_scenes(agent, card, {"data": str(data), "observe": observe}, names)  # type: ignore[arg-type]
    return score_scene(open_source(card, data).load(names[0]), rollouts[0], card)


@pytest.mark.parametrize(
    ("files", "rate", "holes"), [(own, 2, 1), (own_numbers, 2, 0), (nuscenes, 2, 1), (kitti, 10, 0)]
)
@pytest.mark.parametrize(
    "tracker", [HypothesisTracker(), HypothesisTracker(5), TruthTracker()], ids=["stp", "mtp", "gt"]
)
def test_two_missing_seconds(files: Files, rate: int, holes: int, tracker: Tracker, tmp_path: Path) -> None:
    times = np.arange(80) / rate
    kept = times[(times < 30 / rate) | (times >= 30 / rate + 2)]
    whole, cut = (
        score_of(files(tmp_path / name, some.tolist()), tmp_path / name, tracker)
        for name, some in (("whole", times), ("cut", kept))
    )
    assert whole.covered.all()
    assert cut.covered.all()
    assert cut.capped.mean() == pytest.approx(whole.capped.mean(), abs=0.03)
    assert 20 < len(cut) < len(whole)
    said = "1 hole in time, steps of more than 1.5 frame periods: 15 targets across it left out"
    assert skipped_line(cut.skipped) == (said if holes else None)
