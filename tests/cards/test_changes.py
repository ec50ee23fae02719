"""Changed copies of cards: another split or detector, other detections, other scenes."""

from pathlib import Path

import pytest

from mtp_bench.cards import CardChanges, load_card, parse_card, with_detections, with_detector, with_files, with_scenes
from mtp_bench.core.errors import CardError, DataError
from mtp_bench.detector import load_profile
from mtp_bench.detector.profile_file import profile_text
from mtp_bench.sources.nuscenes.layout import NuScenesSource
from mtp_bench.sources.wildtrack import WildtrackSource
from tests.cards.test_cards import put, simulated_content


def test_other_stored_detections_of_nuscenes_by_name() -> None:
    card = load_card("MTP-nuScenes-mini-v0")
    other = CardChanges(split="val", detector="centerpoint").apply(card)
    assert isinstance(other.source, NuScenesSource)
    assert (other.source.detector, other.source.split, other.detector) == ("centerpoint", "val", None)
    assert other.detector_name == "centerpoint"
    assert len({card.digest, CardChanges(split="val").apply(card).digest, other.digest}) == 3


def test_a_file_of_detections_counts_by_its_content_not_by_its_place(tmp_path: Path) -> None:
    card = load_card("MTP-nuScenes-v0")
    here, there, other = tmp_path / "mine.json", tmp_path / "sub/mine.json", tmp_path / "other/mine.json"
    for path, text in ((here, "{}"), (there, "{}"), (other, "{ }")):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    mine = CardChanges(detections=str(here)).apply(card)
    assert mine.detector_name == "megvii-mine", "tracked with the settings of the detector that it stands in for"
    assert mine.digest == with_detections(card, there).digest != card.digest
    assert with_detections(card, other).digest != mine.digest
    here.write_text("{}  ")
    assert with_detections(card, here).digest != mine.digest
    assert str(tmp_path) not in str(mine.model_dump(mode="json"))


def test_another_presence_model_makes_another_card(tmp_path: Path) -> None:
    card, file = load_card("MTP-nuScenes-mini-v0"), tmp_path / "mine.json"
    file.write_text("{}")
    changed = [CardChanges(presence=each).apply(card) for each in ("scores", str(file))]
    assert [each.presence for each in changed] == ["scores", str(file)]
    assert len({card.digest, *(each.digest for each in changed)}) == 3, "never compared with the shipped card"
    assert parse_card(changed[1].stored()).digest == changed[1].digest
    with pytest.raises(DataError, match=r"no file .*gone.json, expected one of `mtp-bench train presence`, or"):
        CardChanges(presence=str(tmp_path / "gone.json")).apply(card)


def test_another_detector_takes_the_place_of_wildtracks_stored_detections_too() -> None:
    other = with_detector(load_card("MTP-WILDTRACK-v0"), "iid")
    assert isinstance(other.source, WildtrackSource)
    assert (other.source.detector, other.detector_name) == (None, "wildtrack_mvdet-iid")
    assert parse_card(other.stored()).digest == other.digest, "a stored run of it can be opened"


def test_own_scenes_keep_the_detector_of_a_card(tmp_path: Path) -> None:
    recorded, simulated = load_card("MTP-KITTI-v0"), with_detector(load_card("MTP-Intersection-v0"), "iid")
    for own in (with_files(recorded, tmp_path), with_scenes(recorded, [])):
        assert own.detector is None
    for own in (with_files(simulated, tmp_path), with_scenes(simulated, [])):
        assert (own.detector, own.detector_name) == (simulated.detector, "nuscenes_megvii-iid")
        assert parse_card(own.stored()).digest == own.digest


def test_the_digest_covers_the_noise_behind_a_name() -> None:
    profile = load_profile("nuscenes_megvii")
    inline = put(simulated_content(), "detector", {"noise": profile.model_dump(exclude_none=True), "reach": 60.0})
    changed = put(inline, "detector.noise.dt", 0.4)
    assert len({parse_card(card).digest for card in (simulated_content(), inline, changed)}) == 3


def test_a_profile_without_the_class_is_an_error() -> None:
    noise = load_profile("nuscenes_megvii").model_dump(exclude_none=True)
    del noise["alike"]["bus"]
    with pytest.raises(CardError, match="class of detector profile 'nuscenes_megvii' 'bus'"):
        parse_card(put(simulated_content(), "detector", {"noise": noise}))


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
    values = 'reach = 50.0\nfield_of_view = 200.0\nvariant = "iid"'
    section.write_text(f"[detector]\n{values}\n\n[detector.noise]\n{profile}")
    found = with_detector(card, str(section)).detector
    assert found is not None
    assert (found.reach, found.field_of_view, found.variant, found.profile) == (50.0, 200.0, "iid", None)
    section.write_text(section.read_text().replace("reach", "raech"))
    with pytest.raises(CardError, match=r"section\.toml, \[detector\]: unknown key 'raech': did you mean 'reach'"):
        with_detector(card, str(section))
