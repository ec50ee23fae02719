"""Cards of simulated traffic, and of a simulated detector on recorded logs."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path

import pytest

from mtp_bench._bundle import bundled
from mtp_bench.cards import changed_card, load_card, parse_card, with_detector, with_split
from mtp_bench.detector import load_profile
from mtp_bench.detector.profile_file import profile_text
from mtp_bench.errors import CardError, MtpBenchError, UnknownNameError
from mtp_bench.sources.highway.section import GENERATOR, HighwaySource
from tests.cards.test_cards import Content, put

PROTOCOL = {
    "MTP-Intersection-v0": ("intersection", 2.0, 4, 12, 10, "nuscenes_megvii", True),
    "MTP-IntersectionRaw-v0": ("intersection", 2.0, 4, 12, 10, "nuscenes_megvii_raw", True),
    "MTP-Roundabout-v0": ("roundabout", 2.0, 4, 12, 10, "nuscenes_megvii", True),
    "MTP-Merge-v0": ("merge", 10.0, 10, 10, 20, "kitti_pointrcnn", False),
    "MTP-Highway-v0": ("highway", 10.0, 10, 10, 20, "kitti_pointrcnn", False),
}


def content(env_id: str = "MTP-Intersection-v0") -> Content:
    return tomllib.loads((bundled("envs") / f"{env_id}.toml").read_text())


@pytest.mark.parametrize("env_id", PROTOCOL)
def test_shipped_cards_follow_the_protocol(env_id: str) -> None:
    scenario, rate, past, future, k, detector, velocity = PROTOCOL[env_id]
    card = load_card(env_id)
    assert isinstance(card.source, HighwaySource)
    assert card.source.scenario == scenario
    assert card.source.generator == GENERATOR
    assert (card.task.rate, card.task.past, card.task.future, card.task.samples) == (rate, past, future, k)
    assert (card.detector_name, card.velocity, card.ego_motion) == (detector, velocity, True)
    error = 10.0 if rate == 2.0 else 2.0
    for name in card.task.classes:
        near, far = (1.0, 4.0) if name == "pedestrian" else (2.0, error)
        assert card.task.event_gate.threshold[name] == card.task.forecast_gate[name] == near
        assert card.task.miss_error[name] == far
    assert ("pedestrian" in card.task.classes) == (scenario == "intersection")
    assert card.source.seconds == 20.0
    ranges = [getattr(card.source.seeds, split) for split in ("train", "val", "test")]
    assert [end - first for first, end in ranges] == [500, 150, 150]
    for (_, end), (first, _) in itertools.pairwise(ranges):
        assert end <= first, "splits have no scene in common"


CHANGES: dict[str, object] = {
    "source.split": "test",
    "source.sensor": "roadside",
    "source.seconds": 10.0,
    "source.vehicles": 10,
    "source.pedestrians": 0,
    "source.seeds.train": [0, 2],
    "source.seeds.val": [10000, 10001],
    "source.seeds.test": [30000, 30001],
    "detector.profile": "nuscenes_centerpoint",
    "detector.variant": "hard",
    "detector.reach": 50.0,
    "detector.field_of_view": 180.0,
    "detector.seed": 1,
}


@pytest.mark.parametrize("key", CHANGES)
def test_the_digest_changes_with_every_field(key: str) -> None:
    assert parse_card(put(content(), key, CHANGES[key])).digest != parse_card(content()).digest


def test_the_digest_changes_with_the_scenario() -> None:
    merge = content("MTP-Merge-v0")
    assert parse_card(put(merge, "source.scenario", "highway")).digest != parse_card(merge).digest


def test_pedestrians_only_where_they_cross() -> None:
    with pytest.raises(CardError, match=r"pedestrians: got 3: expected 0: only the intersection has crossings"):
        parse_card(put(content("MTP-Merge-v0"), "source.pedestrians", 3))


def test_the_digest_covers_the_noise_behind_a_name() -> None:
    profile = load_profile("nuscenes_megvii")
    inline = put(content(), "detector", {"noise": profile.model_dump(exclude_none=True), "reach": 60.0})
    changed = put(inline, "detector.noise.dt", 0.4)
    digests = {parse_card(card).digest for card in (content(), inline, changed)}
    assert len(digests) == 3


WRONG: dict[str, tuple[str, object, str]] = {
    "no such scenario": ("source.scenario", "intersektion", "scenario: got 'intersektion'"),
    "misspelt key": ("source.vehicle", 3, "unknown key 'vehicle': did you mean 'vehicles'?"),
    "misspelt key of the detector": ("detector.profil", "x", "unknown key 'detector.profil': did you mean 'profile'?"),
    "no such profile": ("detector.profile", "megvii", "card.toml: unknown detector profile 'megvii'"),
    "a file as profile": ("detector.profile", "mine.toml", "belongs into [detector.noise]"),
    "an older generator": ("source.generator", 1, "generator: got 1: this version of the library makes"),
    "splits that overlap": (
        "source.seeds.test",
        [0, 10],
        "seeds: got a table: expected splits without a",
    ),
    "too short": ("source.seconds", 5.0, "scenes of 5 s at 2 Hz have 10 frames, expected at least 16"),
    "two kinds of noise": ("detector.noise", load_profile("clean").model_dump(exclude_none=True), "both or none"),
    "an empty split": ("source.seeds.val", [5, 5], "seeds.val: got [5, 5]"),
    "a negative seed": ("source.seeds.val", [-5, 5], "seeds.val: got [-5, 5]"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_content_is_one_clear_error(name: str) -> None:
    key, value, text = WRONG[name]
    with pytest.raises(MtpBenchError) as caught:
        parse_card(put(content(), key, value), where="card.toml")
    assert text in str(caught.value)


def test_simulated_traffic_needs_a_detector() -> None:
    with pytest.raises(CardError, match=r"a \[detector\] section is missing"):
        parse_card(put(content(), "detector"))


def test_a_profile_without_the_class_is_an_error() -> None:
    noise = load_profile("nuscenes_megvii").model_dump(exclude_none=True)
    del noise["alike"]["bus"]
    with pytest.raises(CardError, match="class of detector profile 'nuscenes_megvii' 'bus'"):
        parse_card(put(content(), "detector", {"noise": noise}))


def test_another_split_and_detector() -> None:
    card = load_card("MTP-Intersection-v0")
    assert changed_card(card) == card
    changed = changed_card(card, "test", "clean")
    assert (changed.source.split, changed.detector_name) == ("test", "clean")
    assert with_detector(card, "hard").detector_name == "nuscenes_megvii-hard"
    assert with_detector(card, "iid").detector_name == "nuscenes_megvii-iid"
    assert with_detector(card, "clean").detector == card.detector.model_copy(update={"profile": "clean"})  # type: ignore[union-attr]
    assert len({c.digest for c in (card, changed, with_split(card, "test"), with_detector(card, "clean"))}) == 4
    with pytest.raises(UnknownNameError, match="unknown split of MTP-Intersection-v0 'valid'"):
        with_split(card, "valid")
    with pytest.raises(UnknownNameError, match="unknown detector profile 'kleen'"):
        with_detector(card, "kleen")


def test_a_simulated_detector_on_recorded_logs() -> None:
    card = load_card("MTP-KITTI-v0")
    assert (card.detector_name, card.velocity) == ("pointrcnn", False)
    simulated = with_detector(card, "kitti_pointrcnn")
    assert (simulated.detector_name, simulated.velocity) == ("kitti_pointrcnn", False)
    assert simulated.digest != card.digest
    with pytest.raises(CardError, match="'hard' is a variant of a simulated detector, and MTP-KITTI-v0 has none"):
        with_detector(card, "hard")
    with pytest.raises(UnknownNameError, match="unknown split of MTP-KITTI-v0 'test'"):
        with_split(card, "test")


def test_a_profile_from_a_file(tmp_path: Path) -> None:
    card = load_card("MTP-Roundabout-v0")
    section = tmp_path / "section.toml"
    section.write_text('[detector]\nprofile = "clean"\n')
    with pytest.raises(CardError, match=r"section\.toml: \[detector\] has no table 'noise'"):
        with_detector(card, str(section))
    with pytest.raises(CardError, match=r"mine\.toml: cannot be read"):
        with_detector(card, str(tmp_path / "mine.toml"))
    profile = (
        profile_text(load_profile("clean"))
        .replace("[classes", "[detector.noise.classes")
        .replace("[alike", "[detector.noise.alike")
    )
    section.write_text(
        f'[detector]\nreach = 50.0\nfield_of_view = 200.0\nvariant = "hard"\n\n[detector.noise]\n{profile}'
    )
    found = with_detector(card, str(section)).detector
    assert found is not None
    assert (found.reach, found.field_of_view, found.variant, found.profile) == (50.0, 200.0, "hard", None)
    section.write_text(section.read_text().replace("reach", "raech"))
    with pytest.raises(CardError, match=r"section\.toml, \[detector\]: unknown key 'raech': did you mean 'reach'"):
        with_detector(card, str(section))
