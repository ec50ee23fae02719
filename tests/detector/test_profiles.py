"""Profiles: the shipped ones, reading and writing, wrong ones, variants, and cards that use them."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.detector import Profile, load_profile, profile_names
from mtp_bench.detector.profile_file import profile_for, profile_text, with_variant
from tests.support.detector_scenes import FREE, LASTING, NEAR, cars, detect, on_grid, profile_of

FULL = profile_of(quality=LASTING, radial={**LASTING, "s0": 0.2}, free=FREE, near=NEAR)


def read_back(profile: Profile, folder: Path) -> Profile:
    path = folder / "profile.toml"
    path.write_text(profile_text(profile), encoding="utf-8")
    return load_profile(str(path))


@pytest.mark.parametrize("name", profile_names())
def test_a_shipped_profile_is_complete_and_read_back_equal(name: str, tmp_path: Path) -> None:
    profile = load_profile(name)
    assert profile.name == name
    assert profile.source
    assert load_profile(name) is profile, "read once"
    assert read_back(profile, tmp_path) == profile
    changed = with_variant(profile, "iid")
    assert (changed.name, Profile.model_validate(changed.model_dump())) == (f"{name}-iid", changed)
    assert with_variant(profile, "as_fitted") is profile


def test_odd_names_and_absent_parts_are_read_back_equal(tmp_path: Path) -> None:
    profile = load_profile("nuscenes_megvii")
    odd = profile.classes["car"].model_copy(update={"velocity": None})
    names = {"truck": "car", 'a "quoted" one': "car"}
    changed = profile.model_copy(
        update={"classes": {**profile.classes, "e-scooter": odd}, "alike": names, "summary": 'naïve "x" \\ y'}
    )
    assert read_back(changed, tmp_path) == changed


@pytest.mark.parametrize(
    ("detector", "profile"),
    [("megvii", "nuscenes_megvii"), ("acf", "wildtrack_mvdet"), ("kitti_pointrcnn", "kitti_pointrcnn"), ("new", "")],
)
def test_a_stored_detector_has_a_profile_that_can_replace_it(detector: str, profile: str) -> None:
    assert profile_for(detector) == profile


def test_iid_keeps_recall_and_scores_without_memory() -> None:
    profile = profile_of(quality={**LASTING, "lapses": {"share": 0.4, "bias": 0.5, "phi": 0.9, "shared": 0.5}})
    variants = (profile, with_variant(profile, "iid"))
    (hit, score, _), (iid_hit, iid_score, _) = (
        on_grid(detect(cars(300, 150, 30.0), one), 30.0, 150) for one in variants
    )
    assert iid_hit.mean() == pytest.approx(hit.mean(), abs=0.015)
    assert np.nanmean(iid_score) == pytest.approx(float(np.nanmean(score)), abs=0.02)
    memory, no_memory = (np.corrcoef(hits[:-1].ravel(), hits[1:].ravel())[0, 1] for hits in (hit, iid_hit))
    assert abs(no_memory) < 0.02
    assert memory > 0.3
