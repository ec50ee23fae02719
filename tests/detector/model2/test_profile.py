"""Profiles of model 2: what is refused, and their variants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.detector import Profile, load_profile
from mtp_bench.detector.model2.profile import ClassNoise
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.variants import with_variant
from mtp_bench.errors import CardError
from tests.detector.model2.test_couplings import on_grid
from tests.support.model2_scenes import FREE, LASTING, NEAR, cars, detect, profile_of


def full() -> Profile:
    return profile_of(quality=LASTING, radial={**LASTING, "s0": 0.2}, free=FREE, near=NEAR)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "scores that sink": ({"score": (0.1, 0.3, 0.2, 0.9, 1.0)}, "expected ascending numbers"),
    "other lengths": ({"score": (0.1, 1.0)}, "latent has 5 numbers and score 2, expected as many of both"),
    "floor": ({"floor": 1.5}, "expected at most the highest score, 1"),
    "shares": ({"white": 0.5}, r"bias \+ ar \+ white is 1.3, expected 1"),
}


def require_refused(car: ClassNoise, text: str, folder: Path) -> None:
    path = folder / "wrong.toml"
    path.write_text(profile_text(full().model_copy(update={"classes": {"car": car}})), encoding="utf-8")
    with pytest.raises(CardError, match=text):
        load_profile(str(path))


@pytest.mark.parametrize("name", WRONG)
def test_wrong_figures_are_one_clear_error(name: str, tmp_path: Path) -> None:
    change, text = WRONG[name]
    car = full().classes["car"]
    quality = car.quality.model_copy(update=change)
    require_refused(car.model_copy(update={"quality": quality}), text, tmp_path)


def test_scores_of_duplicates_ascend(tmp_path: Path) -> None:
    car = full().classes["car"]
    assert car.near is not None
    sinking = car.near.model_copy(update={"duplicates": tuple(reversed(car.near.score))})
    require_refused(car.model_copy(update={"near": sinking}), "expected ascending numbers", tmp_path)


def test_iid_keeps_recall_and_scores_but_nothing_lasts() -> None:
    profile = profile_of(quality={**LASTING, "lapses": {"share": 0.4, "bias": 0.5, "phi": 0.9, "shared": 0.5}})
    hits, scores = [], []
    for one in (profile, with_variant(profile, "iid")):
        hit, score, _ = on_grid(detect(cars(300, 150, 30.0), one), 30.0, 150)
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
    (hit, _, error), (fewer, _, wider) = (on_grid(detect(truth, one), 30.0) for one in objects)
    odds = [np.log((1 - one.mean()) / one.mean()) for one in (hit, fewer)]
    assert odds[1] - odds[0] == pytest.approx(1.0, abs=0.15)
    assert np.nanstd(wider) / np.nanstd(error) == pytest.approx(2.0, rel=0.1)
    false = [
        len(detect(truth, a).box) - len(detect(truth, b).box) for a, b in ((plain, objects[0]), (hard, objects[1]))
    ]
    assert false[1] / false[0] == pytest.approx(2.0, rel=0.3)


def without_false_ones(profile: Profile) -> Profile:
    car = profile.classes["car"].model_copy(update={"free": None, "near": None})
    return profile.model_copy(update={"classes": {"car": car}})
