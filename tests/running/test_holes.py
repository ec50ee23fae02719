"""One car at constant speed, with and without two seconds that are missing in the files."""

from collections.abc import Sequence
from pathlib import Path

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
from tests.support.runs import run_scenes
from tests.support.source_files import write

SPEED = 2.0  # m/s


def own(data: Path, times: Sequence[float], numbered: bool) -> Card:
    """The frames at these times, s; by numbers alone, a number without rows is an empty frame."""
    numbers = [round(2 * time) for time in times] if numbered else range(len(times))
    rows = [f"{t},{{}}car,{SPEED * time},0,0.75,0,4,2,1.5" for t, time in zip(numbers, times, strict=True)]
    columns = "class,x,y,z,yaw,l,w,h"
    write(data / "logs/a/truth.csv", f"frame,id,{columns}", *(row.format("7,") for row in rows))
    write(data / "logs/a/detections.csv", f"frame,{columns}", *(row.format("") for row in rows))
    if not numbered:
        write(data / "logs/a/ego.csv", "frame,time", *(f"{t},{time}" for t, time in enumerate(times)))
    return with_files(load_card("MTP-nuScenes-mini-v0"), str(data / "logs"))


def score_of(card: Card, data: Path, tracker: Tracker) -> SceneScore:
    observe = "truth" if isinstance(tracker, TruthTracker) else "detections"
    names = open_source(card, data).names

    def agent(task: Task) -> Pipeline:
        return Pipeline(tracker, KinematicPredictor(), KMeansSampler())

    rollouts = run_scenes(agent, card, {"data": str(data), "observe": observe}, names)  # type: ignore[arg-type]
    return score_scene(open_source(card, data).load(names[0]), rollouts[0], card)


@pytest.mark.parametrize("numbered", [False, True], ids=["a hole", "empty frames"])
@pytest.mark.parametrize(
    "tracker", [HypothesisTracker(), HypothesisTracker(5), TruthTracker()], ids=["stp", "mtp", "gt"]
)
def test_two_missing_seconds(numbered: bool, tracker: Tracker, tmp_path: Path) -> None:
    times = np.arange(80) / 2
    kept = times[(times < 15) | (times >= 17)]
    whole, cut = (
        score_of(own(tmp_path / name, some.tolist(), numbered), tmp_path / name, tracker)
        for name, some in (("whole", times), ("cut", kept))
    )
    assert whole.covered.all()
    assert cut.covered.all()
    assert cut.capped.mean() == pytest.approx(whole.capped.mean(), abs=0.03)
    assert 20 < len(cut) < len(whole)
    said = "1 hole in time, steps of more than 1.5 frame periods: 15 targets across it left out"
    assert skipped_line(cut.skipped) == (None if numbered else said)
