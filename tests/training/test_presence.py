"""The fit of presence: rows and their labels, scikit-learn against our evaluation, calibration on held-out scenes."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Floats
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.prediction.presence import MODELS, TrackHistory, logistic, read_model
from mtp_bench.running.options import RunOptions
from mtp_bench.training import presence
from mtp_bench.training.presence import design, isotonic_knots, quality
from mtp_bench.training.presence_rows import PresenceRecipe, PresenceRows, collect
from tests.support.command_line import CommandLine
from tests.support.scoring_scenes import at, make_card, make_scene, with_detections
from tests.support.tracking_scenes import fitted_on, kitti_task

FULL = PresenceRecipe((), terms="of nobody")
SMALL = PresenceRecipe((), ("mean_score", "log_hits", "coasting"), products=False, calibrated=False)


def made_up(n: int = 4000, scenes: int = 8, seed: int = 0) -> tuple[PresenceRows, Floats]:
    """PresenceRows of scenes, and the true probability of each."""
    rng = np.random.default_rng(seed)
    hits = rng.integers(1, 9, n)
    unseen = rng.integers(0, 3, n)
    score = rng.normal(0.4, 0.2, n)
    names = rng.choice(["car", "bus"], n)
    truth = logistic(4 * score + hits - 2.5 * unseen - 3.0 * (names == "bus") - 1.5)
    history = TrackHistory(score, score, hits, hits + unseen, unseen, rng.uniform(0, 50, n), rng.uniform(0, 9, n))
    scene = np.array([f"s{i}" for i in rng.integers(0, scenes, n)])
    return PresenceRows(**vars(history), class_name=names, present=rng.random(n) < truth, scene=scene), truth


@pytest.mark.parametrize("recipe", [FULL, SMALL], ids=["full", "small"])
def test_evaluated_as_by_scikit_learn(recipe: PresenceRecipe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "DIGITS", 17)
    rows, _ = made_up()
    estimator, bare = presence.logistic_regression(rows, recipe)
    columns = design(bare.standardised(rows), rows.class_name, recipe.products)
    ours = presence.probabilities(presence.fit_logistic(rows, recipe), rows)
    np.testing.assert_allclose(ours, estimator.predict_proba(columns)[:, 1], rtol=0, atol=1e-9)


def test_calibration_is_isotonic_regression_at_the_centres_of_its_steps() -> None:
    from sklearn.isotonic import IsotonicRegression

    rng = np.random.default_rng(1)
    p = np.sort(rng.random(100))  # one row per bin
    present = rng.random(100) < p**2
    level = IsotonicRegression(y_min=0, y_max=1).fit_transform(p, present)
    knots = isotonic_knots(p, present)
    assert (np.diff(knots) > 0).all()
    for value in np.unique(level):
        if 0 < value < 1:
            assert np.interp(p[level == value].mean(), *knots) == pytest.approx(value, abs=1e-5)


@pytest.mark.parametrize("present", [False, True])
def test_calibration_without_anything_to_learn_from_changes_nothing(present: bool) -> None:
    assert isotonic_knots(np.linspace(0.1, 0.9, 50), np.full(50, present)).tolist() == [[0, 1], [0, 1]]


def test_a_fit_finds_the_probability_that_made_the_rows() -> None:
    rows, truth = made_up(20_000)
    model, said = presence.fit(rows, FULL)
    fresh, fresh_truth = made_up(5000, seed=1)
    assert np.abs(presence.probabilities(model, fresh) - fresh_truth).mean() < 0.02
    assert np.abs(said - truth).mean() < 0.03
    assert quality(said, rows.present)["brier"] < quality(presence.score_probability(rows), rows.present)["brier"]
    assert len(np.unique(presence.probabilities(model, fresh))) > 4900  # no ties


def test_scenes_are_never_on_both_sides() -> None:
    rows, _ = made_up()
    folds = presence.folds(rows)
    assert np.sum(folds, axis=0).tolist() == [1] * len(rows.present)
    for away in folds:
        assert not set(rows.scene[away]) & set(rows.scene[~away])
    with pytest.raises(MtpBenchError, match="got 1 scene of at most 10 s, expected several"):
        presence.folds(replace(rows, scene=np.full(len(rows.scene), "s")))


def test_the_same_rows_give_the_same_file_which_is_read_as_it_was_written(tmp_path: Path) -> None:
    rows, _ = made_up()
    texts = []
    for _ in range(2):
        model, held_out = presence.fit(rows, FULL)
        texts.append(presence.model_text("mine", FULL, model, [], {"presence": quality(held_out, rows.present)}))
    assert (texts[0], json.loads(texts[0])["terms"]) == (texts[1], "of nobody")
    file = tmp_path / "mine.json"
    file.write_text(texts[0])
    stored = read_model(file)
    assert stored.score_map == {}
    np.testing.assert_array_equal(presence.probabilities(stored, rows), presence.probabilities(model, rows))


def test_labels_are_those_of_the_rule_for_forecasts() -> None:
    """Two tracks on one car: one is present; a track on a neutral one is left out; one on nothing is not there."""
    card, frames = make_card(), 6
    truth = [[at(1, (10.0, 0.0)), at(2, (20.0, 0.0), neutral=True)] for _ in range(frames)]
    seen = [[at(i, xy) for i, xy in enumerate([(10.0, 0.3), (10.0, -0.1), (20.0, 0.0), (30.0, 0.0)])]] * frames
    rows = collect([with_detections(make_scene(truth), seen)], card, kitti_task(classes=card.task.classes))
    told = [(round(float(away)), bool(there)) for away, there in zip(rows.range, rows.present, strict=True)]
    frames_told = len(told) // 3
    assert frames_told > 0
    assert Counter(told) == {(10, True): frames_told, (10, False): frames_told, (30, False): frames_told}


def test_rows_of_few_scenes_are_held_out_by_blocks_of_ten_seconds() -> None:
    """21 s at 2 frames per second: two blocks of 20 frames and one of 3."""
    card, frames = make_card(), 43
    truth = [[at(1, (10.0, 0.0))] for _ in range(frames)]
    scene = with_detections(make_scene(truth), truth)
    scene = replace(scene, time=np.arange(frames) / 2)
    task = kitti_task(classes=card.task.classes, dt=0.5)
    whole, blocks = (collect([scene], card, task, in_blocks) for in_blocks in (False, True))
    assert len(set(whole.scene)) == 1
    with pytest.raises(MtpBenchError, match="expected several, or a longer one"):
        presence.folds(whole)
    count = {name.rpartition(" ")[2]: number for name, number in Counter(blocks.scene.tolist()).items()}
    assert count == {"0": len(whole.scene) - 23, "1": 20, "2": 3}
    with pytest.raises(MtpBenchError, match="the truth of prediction targets alone"):
        collect([replace(scene, truth_complete=False)], card, task)


@pytest.mark.parametrize("present", [True, False])
def test_tracks_of_one_kind_fit_nothing(present: bool) -> None:
    rows = replace(made_up(200)[0], present=np.full(200, present))
    with pytest.raises(MtpBenchError, match=r"all or none are of true objects, .*--presence scores needs no fit"):
        presence.fit(rows, presence.OWN_RECIPE)


def test_the_quality_of_probabilities() -> None:
    got = quality(np.array([0.05, 0.05, 0.95, 1.0]), np.array([False, True, True, True]))
    assert (got["rows"], got["auc"], got["reliability"]) == (4, round(2.5 / 3, 4), [[0.05, 0.5, 2], [0.975, 1.0, 2]])
    assert quality(np.array([0.5]), np.array([True]))["auc"] == 0.5


@pytest.mark.data
@pytest.mark.parametrize("detector", ["acf", "megvii", "wildtrack_mvdet"])
def test_the_command_gives_the_file_that_ships(cli: CommandLine, data_root: Path, detector: str) -> None:
    made = cli.ok("maintain", "presence", detector, "--data", data_root)
    _same(json.loads(made), json.loads((MODELS / f"{detector}.json").read_text()))


def _same(made: Any, shipped: Any) -> None:
    """Equal but for what processors round differently: the last digit, and means that are zero but for rounding."""
    if isinstance(made, dict):
        assert list(made) == list(shipped)
        for key, value in made.items():
            _same(value, shipped[key])
    elif isinstance(made, list):
        assert len(made) == len(shipped)
        for one, other in zip(made, shipped, strict=True):
            _same(one, other)
    else:
        assert made == (pytest.approx(shipped, rel=2e-5, abs=1e-12) if isinstance(shipped, float) else shipped)


@pytest.mark.data
def test_no_scored_scene_of_another_split_is_fitted_on(data_root: Path) -> None:
    from mtp_bench.training.split import open_split

    for env_id in ("MTP-KITTI-v0", "MTP-PETS-v0", "MTP-WILDTRACK-v0"):
        split = open_split(env_id, RunOptions(str(data_root)))
        assert not set(split.names) & set(fitted_on(split.card.detector_name))
