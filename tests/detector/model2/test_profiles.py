"""Profiles of model 2: what is read, what is refused, variants, and that what ships can be used."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.detector import Profile, Profile2, load_profile, profile_names
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.variants import with_variant
from mtp_bench.errors import CardError, UnknownNameError
from tests.detector.model2.test_couplings import on_grid
from tests.support.quality_scenes import FREE, LASTING, NEAR, cars, detect2, profile2


def full() -> Profile2:
    return profile2(quality=LASTING, radial={**LASTING, "s0": 0.2}, free=FREE, near=NEAR)


@pytest.mark.parametrize("name", profile_names())
def test_what_ships_is_read_and_written_equal(name: str, tmp_path: Path) -> None:
    profile = load_profile(name)
    assert isinstance(profile, Profile2)
    assert profile.name == name
    path = tmp_path / "profile.toml"
    path.write_text(profile_text(profile), encoding="utf-8")
    assert load_profile(str(path)) == profile


def test_a_profile_without_the_key_is_of_model_1() -> None:
    assert isinstance(load_profile("v1/nuscenes_megvii"), Profile)
    with pytest.raises(UnknownNameError, match="did you mean 'nuscenes_megvii'"):
        load_profile("nuscenes_megvi")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "scores that sink": ({"score": (0.1, 0.3, 0.2, 0.9, 1.0)}, "expected ascending numbers"),
    "other lengths": ({"score": (0.1, 1.0)}, "latent has 5 numbers and score 2, expected as many of both"),
    "floor": ({"floor": 1.5}, "expected at most the highest score, 1"),
    "shares": ({"white": 0.5}, r"bias \+ ar \+ white is 1.3, expected 1"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_figures_are_one_clear_error(name: str, tmp_path: Path) -> None:
    change, text = WRONG[name]
    car = full().classes["car"]
    quality = car.quality.model_copy(update=change)
    wrong = full().model_copy(update={"classes": {"car": car.model_copy(update={"quality": quality})}})
    path = tmp_path / "wrong.toml"
    path.write_text(profile_text(wrong), encoding="utf-8")
    with pytest.raises(CardError, match=text):
        load_profile(str(path))


def test_a_card_takes_a_profile_of_model_2_and_digests_it() -> None:
    card = load_card("MTP-Intersection-v0")
    first, second = card.with_detector("nuscenes_megvii"), card.with_detector("nuscenes_megvii_raw")
    assert len({card.with_detector("v1/nuscenes_megvii").digest, first.digest, second.digest}) == 3
    assert first.velocity
    assert first.detector_name == "nuscenes_megvii"


def test_a_file_of_model_2_is_a_card_s_own_noise(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(profile_text(load_profile("nuscenes_megvii")), encoding="utf-8")
    card = load_card("MTP-Intersection-v0").with_detector(str(path))
    assert card.detector is not None
    assert isinstance(card.detector.noise, Profile2)
    assert type(card).model_validate(card.model_dump()).detector == card.detector


def test_iid_keeps_recall_and_scores_but_nothing_lasts() -> None:
    profile = profile2(quality={**LASTING, "lapses": {"share": 0.4, "bias": 0.5, "phi": 0.9, "shared": 0.5}})
    hits, scores = [], []
    for one in (profile, with_variant(profile, "iid")):
        hit, score, _ = on_grid(detect2(cars(300, 150, 30.0), one), 30.0, 150)
        hits.append(hit)
        scores.append(score)
    assert hits[1].mean() == pytest.approx(hits[0].mean(), abs=0.015)
    assert np.nanmean(scores[1]) == pytest.approx(float(np.nanmean(scores[0])), abs=0.02)
    assert abs(np.corrcoef(hits[1][:-1].ravel(), hits[1][1:].ravel())[0, 1]) < 0.02
    assert np.corrcoef(hits[0][:-1].ravel(), hits[0][1:].ravel())[0, 1] > 0.3


def test_hard_misses_more_errs_more_and_invents_more() -> None:
    truth = cars(200, 60, 30.0)
    plain, hard = full(), with_variant(full(), "hard")
    assert hard.name == "synthetic-hard"
    objects = [without_false_ones(one) for one in (plain, hard)]
    (hit, _, error), (fewer, _, wider) = (on_grid(detect2(truth, one), 30.0) for one in objects)
    odds = [np.log((1 - one.mean()) / one.mean()) for one in (hit, fewer)]
    assert odds[1] - odds[0] == pytest.approx(1.0, abs=0.15)
    assert np.nanstd(wider) / np.nanstd(error) == pytest.approx(2.0, rel=0.1)
    false = [
        len(detect2(truth, a).box) - len(detect2(truth, b).box) for a, b in ((plain, objects[0]), (hard, objects[1]))
    ]
    assert false[1] / false[0] == pytest.approx(2.0, rel=0.3)


def without_false_ones(profile: Profile2) -> Profile2:
    car = profile.classes["car"].model_copy(update={"free": None, "near": None})
    return profile.model_copy(update={"classes": {"car": car}})
