"""Profiles of either model: what ships, what is read and written, variants, and cards that take them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from mtp_bench.cards import load_card, with_detector
from mtp_bench.detector import Profile, Profile1, load_profile, profile_names
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.variants import with_variant
from mtp_bench.errors import UnknownNameError
from tests.support.detector_scenes import crowd, detect, seen_at


def test_the_shipped_profiles_are_those_of_the_documentation() -> None:
    fitted = ["kitti_pointrcnn", "nuscenes_centerpoint", "nuscenes_megvii", "wildtrack_mvdet"]
    assert profile_names() == sorted(["clean", "kitti_pointrcnn_raw", "nuscenes_megvii_raw", *fitted])
    assert profile_names(1) == [f"v1/{name}" for name in ("clean", *fitted)]
    for name in (*profile_names(), *profile_names(1)):
        assert load_profile(name).name == name.removeprefix("v1/")
        assert load_profile(name).source
        assert load_profile(name) is load_profile(name), "read once"


@pytest.mark.parametrize("name", [*profile_names(), *profile_names(1)])
def test_what_ships_is_read_and_written_equal(name: str, tmp_path: Path) -> None:
    assert read_back(load_profile(name), tmp_path) == load_profile(name)


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_odd_names_and_absent_parts_are_read_back_equal(name: str, tmp_path: Path) -> None:
    profile = load_profile(name)
    odd = profile.classes["car"].model_copy(update={"velocity": None})
    names = {"truck": "car", 'a "quoted" one': "car"}
    changed = profile.model_copy(
        update={"classes": {**profile.classes, "e-scooter": odd}, "alike": names, "summary": 'naïve "x" \\ y'}
    )
    assert read_back(changed, tmp_path) == changed


def read_back(profile: Profile | Profile1, folder: Path) -> Profile | Profile1:
    path = folder / "profile.toml"
    path.write_text(profile_text(profile), encoding="utf-8")
    return load_profile(str(path))


def test_coefficients_are_explained() -> None:
    assert "# the same, and: undetected in the frame before" in profile_text(load_profile("v1/nuscenes_megvii"))
    assert "# length, width, height, m" in profile_text(load_profile("nuscenes_megvii"))


def test_a_profile_without_the_key_is_of_model_1() -> None:
    assert all(isinstance(load_profile(name), Profile) for name in profile_names())
    assert all(isinstance(load_profile(name), Profile1) for name in profile_names(1))
    with pytest.raises(UnknownNameError, match="did you mean 'nuscenes_megvii'"):
        load_profile("nuscenes_megvi")


def test_the_variants_of_no_noise_are_no_noise() -> None:
    truth = crowd(20, 30)
    for profile in (load_profile("clean"), load_profile("v1/clean")):
        for variant in ("as_fitted", "iid", "hard"):
            found = detect(truth, with_variant(profile, variant), seen_at(truth, 20.0, occlusion=3))
            np.testing.assert_allclose(found.box, truth.box)


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_as_fitted_is_the_profile_itself(name: str) -> None:
    assert with_variant(load_profile(name), "as_fitted") is load_profile(name)


@pytest.mark.parametrize("name", [*profile_names(), *profile_names(1)])
@pytest.mark.parametrize("variant", ["iid", "hard"])
def test_variants_are_valid_profiles_of_their_own_name(name: str, variant: Literal["iid", "hard"]) -> None:
    profile = load_profile(name)
    changed = with_variant(profile, variant)
    assert changed.name == f"{profile.name}-{variant}"
    assert type(profile).model_validate(changed.model_dump()) == changed


def test_a_card_digests_the_profile_and_its_model() -> None:
    card = load_card("MTP-Intersection-v0")
    names = ("nuscenes_megvii", "nuscenes_megvii_raw", "v1/nuscenes_megvii")
    cards = [with_detector(card, name) for name in names]
    assert len({one.digest for one in cards}) == 3
    assert all(one.velocity for one in cards)
    assert [one.detector_name for one in cards] == [name.removeprefix("v1/") for name in names]


@pytest.mark.parametrize("name", ["nuscenes_megvii", "v1/nuscenes_megvii"])
def test_a_file_of_either_model_is_a_card_s_own_noise(name: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(profile_text(load_profile(name)), encoding="utf-8")
    card = with_detector(load_card("MTP-Intersection-v0"), str(path))
    assert card.detector is not None
    assert card.detector.noise == load_profile(name)
    assert type(card).model_validate(card.model_dump()).detector == card.detector
