"""Cards of recorded logs other than KITTI: the rules of the protocol, other splits, other detections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mtp_bench.cards import (
    changed_card,
    load_card,
    parse_card,
    with_detections,
    with_detector,
    with_files,
    with_scenes,
    with_split,
)
from mtp_bench.env import MTPEnv
from mtp_bench.errors import CardError, DataError, MtpBenchError, UnknownNameError
from mtp_bench.sources.nuscenes import NuScenesSource
from mtp_bench.sources.wildtrack import WildtrackSource
from mtp_bench.tracking.parameters import detector_parameters

VEHICLES = ("car", "truck", "bus", "trailer", "construction_vehicle")
PROTOCOL = {
    # rate, past, future, k, classes; event gate, forecast gate and miss error of the first and the last class
    "MTP-nuScenes-v0": (2.0, 4, 12, 10, VEHICLES, (2.0, 2.0, 10.0), (2.0, 2.0, 10.0)),
    "MTP-nuScenes-CenterPoint-v0": (2.0, 4, 12, 10, VEHICLES, (2.0, 2.0, 10.0), (2.0, 2.0, 10.0)),
    "MTP-nuScenes-mini-v0": (
        *(2.0, 4, 12, 10),
        (*VEHICLES, "motorcycle", "bicycle", "pedestrian"),
        *((2.0, 2.0, 10.0), (1.0, 1.0, 4.0)),
    ),
    "MTP-WILDTRACK-v0": (2.0, 4, 12, 1, ("pedestrian",), (1.0, 1.0, 4.0), (1.0, 1.0, 4.0)),
    "MTP-WILDTRACK-k10-v0": (2.0, 4, 12, 10, ("pedestrian",), (1.0, 1.0, 4.0), (1.0, 1.0, 4.0)),
    "MTP-PETS-v0": (7.0, 7, 14, 10, ("pedestrian",), (1.0, 1.0, 2.0), (1.0, 1.0, 2.0)),
}
NAMES = {
    "MTP-nuScenes-v0": ("megvii", True, False),
    "MTP-nuScenes-CenterPoint-v0": ("centerpoint", True, False),
    "MTP-nuScenes-mini-v0": ("megvii", True, False),
    "MTP-WILDTRACK-v0": ("wildtrack_mvdet", False, False),
    "MTP-WILDTRACK-k10-v0": ("wildtrack_mvdet", False, False),
    "MTP-PETS-v0": ("acf", False, False),
}


@pytest.mark.parametrize("env_id", PROTOCOL)
def test_shipped_cards_follow_the_protocol(env_id: str) -> None:
    card = load_card(env_id)
    rate, past, future, k, classes, first, last = PROTOCOL[env_id]
    task = card.task
    assert (task.rate, task.past, task.future, task.samples, task.classes) == (rate, past, future, k, classes)
    assert task.event_gate.measure == "center_distance"
    for name, want in ((classes[0], first), (classes[-1], last)):
        assert (task.event_gate.threshold[name], task.forecast_gate[name], task.miss_error[name]) == want
    assert (card.detector_name, card.has_ego, card.velocity) == NAMES[env_id]


def test_the_summary_says_what_cannot_be_measured_and_what_is_simulated() -> None:
    assert "false positives not measurable" in load_card("MTP-nuScenes-v0").summary
    assert "simulated detections" in load_card("MTP-WILDTRACK-v0").summary


def test_other_stored_detections_of_nuscenes_by_name() -> None:
    card = load_card("MTP-nuScenes-mini-v0")
    other = changed_card(card, "val", "centerpoint")
    assert isinstance(other.source, NuScenesSource)
    assert (other.source.detector, other.source.split, other.detector) == ("centerpoint", "val", None)
    assert other.detector_name == "centerpoint"
    assert len({card.digest, with_split(card, "val").digest, other.digest}) == 3


@pytest.mark.parametrize("name", ["", "../detections/megvii", "megvii*", "a b"])
def test_a_name_that_no_file_can_have(name: str) -> None:
    with pytest.raises(CardError, match="expected the first part of the names of its files"):
        with_detector(load_card("MTP-nuScenes-mini-v0"), name)


def test_a_simulated_detector_needs_to_see_more_than_targets() -> None:
    with pytest.raises(CardError, match="would see nothing but the prediction targets"):
        with_detector(load_card("MTP-nuScenes-v0"), "clean")


@pytest.mark.parametrize("profile", ["clean", "nuscenes_megvii", "nuscenes_centerpoint"])
def test_vehicle_detectors_know_all_classes_of_mini(profile: str) -> None:
    """Those who have only the free mini download have no detections."""
    card = with_detector(load_card("MTP-nuScenes-mini-v0"), profile)
    assert len(detector_parameters(card.detector_name, card.task.classes)) == 8
    assert card.detector is not None
    assert card.detector.field_of_view == 360.0


@pytest.mark.parametrize("changes", [{"detector": 3}, {"detection_file": 3}, {"split": 3}])
def test_changes_are_texts(changes: dict[str, Any]) -> None:
    with pytest.raises(MtpBenchError, match="is 3, expected a text"):
        MTPEnv("MTP-nuScenes-mini-v0", **changes)


def test_velocities_are_shown_where_a_card_says_so() -> None:
    content = load_card("MTP-nuScenes-v0").model_dump(mode="json")
    content["source"]["velocity"] = True
    assert parse_card(content).velocity


def test_a_file_of_detections_counts_by_its_content_not_by_its_place(tmp_path: Path) -> None:
    card = load_card("MTP-nuScenes-v0")
    here, there, other = tmp_path / "mine.json", tmp_path / "sub/mine.json", tmp_path / "other/mine.json"
    for path, text in ((here, "{}"), (there, "{}"), (other, "{ }")):
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    mine = changed_card(card, detection_file=str(here))
    assert mine.detector_name == "megvii-mine", "tracked with the settings of the detector that it stands in for"
    assert mine.digest == with_detections(card, there).digest != card.digest
    assert with_detections(card, other).digest != mine.digest
    here.write_text("{}  ")
    assert with_detections(card, here).digest != mine.digest
    assert str(tmp_path) not in str(mine.model_dump(mode="json"))


def test_a_file_of_detections_that_cannot_be_used(tmp_path: Path) -> None:
    card = load_card("MTP-nuScenes-v0")
    with pytest.raises(DataError, match=r"detections .*none\.json: No such file"):
        with_detections(card, tmp_path / "none.json")
    with pytest.raises(DataError, match=r"none: No such file or directory; expected a folder of KITTI text"):
        with_detections(load_card("MTP-KITTI-v0"), tmp_path / "none")
    with pytest.raises(CardError, match="MTP-PETS-v0 takes no file of detections: only those of KITTI and nuScenes"):
        with_detections(load_card("MTP-PETS-v0"), tmp_path / "none.json")
    with pytest.raises(CardError, match="takes no file of detections"):
        MTPEnv("MTP-Intersection-v0", detection_file="some.json")


def test_another_detector_takes_the_place_of_wildtracks_stored_detections_too() -> None:
    card = load_card("MTP-WILDTRACK-v0")
    other = with_detector(card, "hard")
    assert isinstance(other.source, WildtrackSource)
    assert (other.source.detector, other.detector_name) == (None, "wildtrack_mvdet-hard")
    assert parse_card(other.stored()).digest == other.digest, "a stored run of it can be opened"


def test_wildtrack_needs_a_detector() -> None:
    content = load_card("MTP-WILDTRACK-v0").model_dump(mode="json")
    content["detector"] = None
    with pytest.raises(CardError, match=r"most of WILDTRACK has no detections: a \[detector\] section is missing"):
        parse_card(content)


@pytest.mark.parametrize(
    ("env_id", "split", "known"),
    [("MTP-nuScenes-v0", "mini", "did you mean 'mini_val'"), ("MTP-PETS-v0", "test", "known are train, val")],
)
def test_an_unknown_split(env_id: str, split: str, known: str) -> None:
    with pytest.raises(UnknownNameError, match=known):
        with_split(load_card(env_id), split)


def test_own_scenes_keep_the_detector_of_a_card(tmp_path: Path) -> None:
    recorded, simulated = load_card("MTP-KITTI-v0"), with_detector(load_card("MTP-Intersection-v0"), "hard")
    for own in (with_files(recorded, tmp_path), with_scenes(recorded, [])):
        assert own.detector is None
    for own in (with_files(simulated, tmp_path), with_scenes(simulated, [])):
        assert (own.detector, own.detector_name) == (simulated.detector, "nuscenes_megvii-hard")
        assert parse_card(own.stored()).digest == own.digest
