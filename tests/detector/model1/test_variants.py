"""Variants of profiles of model 1, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.detector import Profile1, load_profile
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.simulate import simulate
from mtp_bench.detector.variants import with_variant
from mtp_bench.errors import CardError
from mtp_bench.types import Floats
from tests.support.detector_scenes import EVERYWHERE, crowd, detect, inner_gaps, on_grid, seen_at
from tests.support.model1_scenes import FALSE_POSITIVES, in_empty_scene, noisy, perfect_with, profile1

FITTED = ["kitti_pointrcnn", "nuscenes_centerpoint", "nuscenes_megvii"]  # of vehicles, with a view from one place
FRAMES, OBJECTS = 150, 200


def _objects_only(profile: Profile1) -> Profile1:
    update = {"false_positives": None, "duplicates": 0.0}
    return profile.model_copy(
        update={"classes": {name: noise.model_copy(update=update) for name, noise in profile.classes.items()}}
    )


def _run(profile: Profile1, distance: float = 30.0) -> tuple[Floats, Floats]:
    """Hits ``[F, J]`` and errors of the boxes ``[F, J, 7]`` of a crowd of cars."""
    truth = crowd(FRAMES, OBJECTS)
    sight = seen_at(truth, distance)
    found = simulate(truth, np.zeros((FRAMES, 4)), ("car",), _objects_only(profile), EVERYWHERE, 0, profile.dt, sight)
    hit, box, _, _ = on_grid(found, OBJECTS)
    return hit.astype(float), box - truth.box.reshape(FRAMES, OBJECTS, 7)


@pytest.mark.parametrize("name", FITTED)
def test_without_memory_recall_and_margins_stay(name: str) -> None:
    profile = profile1(name)
    (hit, error), (free_hit, free_error) = _run(profile), _run(with_variant(profile, "iid"))
    assert free_hit.mean() == pytest.approx(hit.mean(), abs=0.025)
    for column in (0, 1, 4):
        spread, free_spread = (np.nanquantile(np.abs(each[..., column]), 0.5) for each in (error, free_error))
        assert free_spread == pytest.approx(spread, rel=0.15), column
    flips = (float(np.nanmean(np.abs(each[..., 3]) > np.pi / 2)) for each in (error, free_error))
    assert next(flips) == pytest.approx(next(flips), abs=0.004)


@pytest.mark.parametrize("name", FITTED)
def test_without_memory_nothing_lasts(name: str) -> None:
    hit, error = _run(with_variant(profile1(name), "iid"))
    for whole in (1 - hit, *(error[..., column] for column in (0, 1, 4, 5))):
        value = np.clip(whole, *np.nanquantile(whole, [0.01, 0.99])) if np.isnan(whole).any() else whole
        pairs = np.isfinite(value[1:]) & np.isfinite(value[:-1])
        assert abs(np.corrcoef(value[1:][pairs], value[:-1][pairs])[0, 1]) < 0.04
    fitted = _run(profile1(name))[0]
    assert inner_gaps(hit > 0).mean() < 0.9 * inner_gaps(fitted > 0).mean()


@pytest.mark.parametrize("name", FITTED)
def test_hard_is_harder(name: str) -> None:
    profile = profile1(name)
    (hit, error), (hard_hit, hard_error) = _run(profile), _run(with_variant(profile, "hard"))
    odds, hard_odds = (1 / each.mean() - 1 for each in (hit, hard_hit))
    assert np.log(hard_odds / odds) > 0.9
    both = np.isfinite(error[..., 0]) & np.isfinite(hard_error[..., 0])
    expected = np.clip(2 * error[both][:, :2], -2.0, 2.0)
    inside = np.abs(expected) < 1.99
    np.testing.assert_allclose(hard_error[both][:, :2][inside], expected[inside], atol=1e-9)
    np.testing.assert_array_equal(hard_error[both][:, 2:], error[both][:, 2:])


def test_hard_has_twice_the_false_positives_and_the_scenes_keep_their_factor() -> None:
    plain = perfect_with(dispersion=3.0)
    hard = with_variant(plain, "hard")
    law = hard.classes["car"].false_positives
    assert law is not None
    assert (law.rate, law.dispersion) == (4.0, 5.0)
    count, hard_count = (
        np.array([len(in_empty_scene(each, frames=60, seed=seed).box) for seed in range(60)]) for each in (plain, hard)
    )
    assert hard_count.sum() / count.sum() == pytest.approx(2.0, rel=0.1)
    assert np.corrcoef(count, hard_count)[0, 1] > 0.9


def test_false_positives_without_memory_have_the_same_rate() -> None:
    plain = perfect_with(survive=0.6)
    free = with_variant(plain, "iid")
    counts = [np.diff(in_empty_scene(each, frames=3000).start).astype(float) for each in (plain, free)]
    assert counts[1].mean() == pytest.approx(counts[0].mean(), rel=0.06)
    assert np.corrcoef(counts[0][1:], counts[0][:-1])[0, 1] == pytest.approx(0.6, abs=0.06)
    assert abs(np.corrcoef(counts[1][1:], counts[1][:-1])[0, 1]) < 0.06


@pytest.mark.parametrize("name", FITTED)
def test_hidden_and_far_objects_are_undetected_more_often(name: str) -> None:
    truth = crowd(40, 50)
    profile = _objects_only(profile1(name))
    recall = [
        len(detect(truth, profile, seen_at(truth, distance, occlusion), dt=profile.dt).box) / len(truth.box)
        for distance, occlusion in ((5.0, 0), (30.0, 0), (60.0, 0), (30.0, 3))
    ]
    assert recall[0] > 0.9
    assert recall[0] > recall[1] > recall[2]
    assert recall[3] < recall[1] - 0.1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radial": {"bias": 0.1, "ar": 0.3, "phi": 0.5, "white": 0.5}}, r"bias \+ ar \+ white is 0.9, expected 1"),
        ({"score": {"floor": 0.5, "ceiling": 0.4}}, "expected more than the floor, 0.5"),
        ({"false_positives": {**FALSE_POSITIVES, "distance": (5.0, 4.0, *range(6, 15))}}, "expected ascending dist"),
        ({"false_positives": {**FALSE_POSITIVES, "distance": (5.0, 6.0)}}, "at least 11 items"),
    ],
)
def test_noise_that_makes_no_sense_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        noisy(**change)


def test_messages_of_a_wrong_profile_are_short(tmp_path: Path) -> None:
    text = profile_text(profile1("kitti_pointrcnn"))
    path = tmp_path / "mine.toml"
    for old, new, message in (
        ("white = 0.2187", "white = 0.9", r"classes.car.score.white: got 0.9: bias \+ ar \+ white is"),
        ('van = "car"', 'van = "auto"', "alike: got .*'auto' has no noise; expected one of 'car', 'pedestrian'"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(CardError, match=message) as caught:
            load_profile(str(path))
        assert len(str(caught.value)) < 220
