"""Presence: features of tracks, the models that ship, and what stands in for a model that is not there."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import load_submission
from mtp_bench.cards import load_card, with_files
from mtp_bench.core.errors import SubmissionError
from mtp_bench.core.tracks import Tracks
from mtp_bench.prediction import LearnedPresence
from mtp_bench.prediction.presence import (
    MODELS,
    PRESENCE_FEATURES,
    PresenceModel,
    TrackHistory,
    file_of,
    history_of,
    map_scores,
    read_model,
)
from mtp_bench.running.reference import frozen_reference
from mtp_bench.running.settings import training_note
from mtp_bench.scoring.weights import scene_key
from mtp_bench.tracking import HypothesisTracker
from tests.support.own_scenes import write_tables
from tests.support.tracking_scenes import CYCLIST, at_once, fitted_on, frame, kitti_task, run

SHIPPED = sorted(path.stem for path in MODELS.glob("*.json"))
CHANGES = {"last_score": 1.0, "mean_score": 2.0, "hits": 3, "age": 6, "unseen": 0, "range": 20.0, "speed": 1.0}


def test_the_history_of_a_track() -> None:
    # A cyclist: seen at x = 0, 0.5, not, 1.5, and then not.
    frames = [frame((0.0, 4.0, CYCLIST)), frame((0.5, 4.0, CYCLIST)), frame(), frame((1.5, 4.0, CYCLIST)), frame()]
    *_, tracks = run(HypothesisTracker(1, at_once()), frames)
    tracks = replace(tracks, score=np.array([0.25]), last_score=np.array([0.75]))
    got = history_of(tracks, {"ego_pose": np.array([tracks.box[0, 0], 1.0, 0, 0])}, dt=0.1)
    assert (got.hits.tolist(), got.age.tolist(), got.unseen.tolist()) == ([3], [5], [1])
    assert (got.mean_score[0], got.last_score[0]) == (0.25, 0.75)
    np.testing.assert_allclose(got.range, abs(tracks.box[0, 1] - 1.0))
    np.testing.assert_allclose(got.speed, np.linalg.norm(tracks.past[0, -1, :2] - [0, 4]) / 0.4)
    features = {name: float(make(got)[0]) for name, make in PRESENCE_FEATURES.items() if "score" not in name}
    assert features == pytest.approx(
        {
            "log_hits": np.log(3), "one_by_hits": 1 / 3, "unseen": 1, "coasting": 1, "miss_share": 0.4,
            "log_misses": np.log(3), "log_range": np.log1p(got.range[0]), "log_speed": np.log1p(got.speed[0]),
        }
    )  # fmt: skip


def tracks_of(score: float) -> Tracks:
    *_, tracks = run(HypothesisTracker(1, at_once()), [frame((0.0, 4.0, CYCLIST)), frame((0.5, 4.0, CYCLIST))])
    return replace(tracks, score=np.array([0.25]), last_score=np.array([score]))


def test_scores_are_taken_as_they_are() -> None:
    model = LearnedPresence()
    model.reset(kitti_task(presence="scores"))
    assert model.probability(tracks_of(0.75), {}).tolist() == [0.75]
    for outside in (3.2, -0.1):
        with pytest.raises(SubmissionError, match=rf"has the score {outside}, expected \[0, 1\]"):
            model.probability(tracks_of(outside), {})


def test_a_model_of_the_task_comes_before_that_of_its_detector() -> None:
    other = str(MODELS / "acf.json")
    said = []
    for model, task in (
        (LearnedPresence(), kitti_task(presence=other)),
        (LearnedPresence(other), kitti_task()),
        (LearnedPresence(other), kitti_task(presence="scores")),
        (LearnedPresence(), kitti_task()),
    ):
        model.reset(task)
        said.append(model.probability(tracks_of(0.75), {})[0])
    assert said[0] == said[1] == said[2] != said[3]


def test_a_track_that_nobody_saw_in_its_whole_past_was_not_seen_just_now() -> None:
    """An online tracker may name a track for longer than the frames that are kept."""
    *_, tracks = run(HypothesisTracker(1, at_once()), [frame((0.0, 4.0, CYCLIST))])
    kept = tracks.past_valid.shape[1]
    late = replace(tracks, past_valid=np.zeros_like(tracks.past_valid), age=np.array([kept + 3]))
    assert history_of(late, {}, 0.1).unseen.tolist() == [kept]


def test_a_model_by_hand() -> None:
    # z = ((1 - 0) / 2, clip(3, 0, 2) - 1) = (0.5, 1): 0.1 + 0.2 z1 + 0.3 z2 + z1 z1 + 2 z1 z2 + 3 z2 z2 = 4.75
    model = PresenceModel(
        features=["last_score", "mean_score"], low=[0.0, 0.0], high=[9.0, 2.0], center=[0.0, 1.0], scale=[2.0, 1.0],
        shared=[0.1, 0.2, 0.3, 1.0, 2.0, 3.0], classes={"car": [-4.75, 0.0, 0.5]},
        knots=[[0.0, 0.5, 1.0], [0.0, 0.2, 1.0]],
    )  # fmt: skip
    one = TrackHistory(**{name: np.array([value]) for name, value in {**CHANGES, "mean_score": 3.0}.items()})
    assert model.logits(model.standardised(one), np.array([1]), ["bus", "car"])[0] == pytest.approx(0.5)
    assert model.logits(model.standardised(one), np.array([0]), ["bus", "car"])[0] == pytest.approx(4.75)
    p = 1 / (1 + np.exp(-0.5))
    assert model.probability(one, np.array([1]), ["bus", "car"])[0] == pytest.approx(0.2 + (p - 0.5) / 0.5 * 0.8)


def test_scores_in_place_of_those_of_another_detector() -> None:
    tables = {"car": [[0.0, 0.4, 1.0], [0.0, 0.2, 1.0]]}
    got = map_scores(np.array([0.2, 0.2, 0.7]), tables, np.array([0, 1, 0]), ["car", "bus"])
    np.testing.assert_allclose(got, [0.1, 0.2, 0.6])


@pytest.mark.parametrize("detector", SHIPPED)
def test_the_models_that_ship(detector: str) -> None:
    content = json.loads((MODELS / f"{detector}.json").read_text())
    model = read_model(file_of(detector))
    assert content["detector"] == detector
    assert (np.diff(model.knots) > 0).all()
    assert np.array(model.knots)[:, [0, -1]].tolist() == [[0, 1], [0, 1]]
    assert len(fitted_on(detector)) > 0
    if "held_out" in content:
        assert content["held_out"]["presence"]["brier"] < content["held_out"]["score"]["brier"]
    names = [*model.classes, "unicycle"]
    n = len(names)
    seen = TrackHistory(**{key: np.full(n, value) for key, value in CHANGES.items()})
    said = model.probability(seen, np.arange(n), names)
    assert ((said > 0) & (said < 1)).all()


def test_every_env_has_a_model_but_unknown_detectors_go_by_the_default(repository: Path) -> None:
    for path in (repository / "envs").glob("*.toml"):
        assert file_of(load_card(path.stem).detector_name).stem != "default"
    assert (file_of("megvii-my_file").stem, file_of("yolo").stem) == ("megvii", "default")


def test_a_file_of_ones_own(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    file.write_text(
        json.dumps(
            {"features": ["log_hits"], "low": [0], "high": [1], "center": [0], "scale": [1], "shared": [0, 0],
             "classes": {}, "knots": [[0, 1], [0, 0.5]]}
        )
    )  # fmt: skip
    presence = LearnedPresence(file)
    presence.reset(kitti_task())
    tracks = Tracks.of_one_hypothesis(np.array([1, 2]), np.ones((2, 7)), np.array([0, 1]))
    assert presence.probability(tracks, {}).tolist() == [0.25, 0.25]
    none = Tracks.of_one_hypothesis(np.zeros(0, dtype=np.int64), np.zeros((0, 7)), np.zeros(0, dtype=np.int64))
    assert presence.probability(none, {}).shape == (0,)
    file.write_text(file.read_text().replace("0.5", "0.75"))
    os.utime(file, ns=(0, 0))  # whatever the clock of the file system
    presence.reset(kitti_task())
    assert presence.probability(tracks, {}).tolist() == [0.375, 0.375], "a model that was trained again is read again"


MINE = {
    "features": ["log_hits", "unseen"], "low": [0, 0], "high": [1, 1], "center": [0, 0], "scale": [1, 1],
    "shared": [0, 0, 0], "classes": {}, "knots": [[0, 1], [0, 0.5]],
}  # fmt: skip
BROKEN: dict[str, tuple[Any, str]] = {
    "an unknown key": ({**MINE, "shard": []}, "unknown key 'shard': did you mean 'shared'"),
    "too few numbers": ({**MINE, "low": [0]}, ".*low has 1 numbers, expected 2 for 2 features"),
    "no spread": ({**MINE, "scale": [1, 0]}, "scale.1: got 0"),
    "half of the products": ({**MINE, "shared": [0] * 5}, ".*shared has 5 numbers, expected 3 or 6"),
    "a short class": ({**MINE, "classes": {"car": [0]}}, ".*classes.car has 1 numbers, expected 3"),
    "knots that fall": ({**MINE, "knots": [[1, 0], [0, 1]]}, "knots: got .*: expected a first list whose numbers rise"),
    "no probabilities": ({**MINE, "knots": [[0, 1], [0, 2]]}, "knots.1.1: got 2"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_file_that_is_not_a_model(name: str, tmp_path: Path) -> None:
    content, message = BROKEN[name]
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(content))
    with pytest.raises(SubmissionError, match=f"mine.json: {message}"):
        LearnedPresence(file).reset(kitti_task())


BASELINES = [
    "stp", "mtp", "ab3dmot", "stp_same_samples", "stp_neighbours", "stp_bends", "stp_hedged", "stp_min_score",
    "mtp_min_score",
]  # fmt: skip


def test_the_baselines_say_what_was_trained_on_scored_scenes(tmp_path: Path) -> None:
    scored = {"scene-0061", "scene-0553", "scene-0655", "scene-0757", "scene-0796", "scene-1077", "scene-1094"}
    assert scored < set(fitted_on("megvii")) == set(fitted_on("centerpoint"))
    assert not {"scene-0103", "scene-0916"} & set(fitted_on("megvii"))  # of the official split val
    for env_id in ("MTP-nuScenes-v0", "MTP-nuScenes-CenterPoint-v0"):  # of its others nothing ranks there
        ranks = frozen_reference(load_card(env_id))
        assert ranks is not None
        assert not {scene_key(env_id, name) for name in fitted_on("megvii")} & set(ranks.scenes)
    for name in BASELINES:
        note = load_submission(name).note_on("MTP-nuScenes-mini-v0")
        assert note is not None
        assert note.endswith("presence trained on scored scenes")
        assert load_submission(name).note_on("MTP-KITTI-v0") is None
    mini = load_card("MTP-nuScenes-mini-v0")
    assert training_note(load_submission("stp"), mini)
    assert training_note(load_submission("stp"), with_files(mini, write_tables(tmp_path))) is None  # own scenes
