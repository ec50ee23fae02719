"""Cards: strict TOML with a digest of its content."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from mtp_bench import card_ids
from mtp_bench._bundle import bundled
from mtp_bench.cards import Card, DetectorSection, load_card, parse_card, with_detections, with_files
from mtp_bench.errors import CardError, UnknownNameError
from mtp_bench.sources.kitti import KittiSource

Content = dict[str, Any]

SMALL = """
id = "MTP-small-v0"
summary = "two classes"

[source]
name = "kitti"

[task]
rate = 10.0
past = 10
future = 10
samples = 20
classes = ["car", "pedestrian"]
miss_error = 2.0

[task.event_gate]
measure = "iou_3d"
threshold = 0.5

[task.forecast_gate]
pedestrian = 1.0
car = 2.0

[size]
detections = 4
tracks = 8
objects = 4
hypotheses = 2
"""


@pytest.fixture
def content() -> Content:
    return tomllib.loads(SMALL)


def put(content: Content, key: str, value: object = None) -> Content:
    """The content with another value of ``key`` ("task.event_gate.measure"), or without the key."""
    changed = table = copy.deepcopy(content)
    *path, last = key.split(".")
    for part in path:
        table = table.setdefault(part, {})
    if value is None:
        del table[last]
    else:
        table[last] = value
    return changed


@pytest.mark.parametrize("env_id", card_ids())
def test_every_shipped_card_parses(env_id: str) -> None:
    card = load_card(env_id)
    assert card.id == env_id
    assert card.summary
    assert card.size.objects >= card.size.detections, "an agent must be able to forecast whatever it sees"


@pytest.mark.parametrize(
    ("env_id", "ego_motion", "rate", "stride"),
    [
        ("MTP-KITTI-v0", True, 10.0, 1),
        ("MTP-KITTI-noego-v0", False, 10.0, 1),
        ("MTP-KITTI-5Hz-v0", False, 5.0, 2),
    ],
)
def test_kitti_cards_follow_the_protocol(env_id: str, ego_motion: bool, rate: float, stride: int) -> None:
    card = load_card(env_id)
    task = card.task
    assert isinstance(card.source, KittiSource)
    assert (card.source.ego_motion, task.rate, card.source.stride) == (ego_motion, rate, stride)
    assert (card.source.split, card.source.detector) == ("val", "pointrcnn")
    assert (task.past, task.future, task.samples) == (10, 10, 20)
    assert task.classes == ("car", "pedestrian", "cyclist")
    assert task.event_gate.measure == "iou_3d"
    assert card.per_class(task.event_gate.threshold) == (0.5, 0.5, 0.5)
    assert card.per_class(task.forecast_gate) == (2.0, 1.0, 1.5)
    assert card.per_class(task.miss_error) == (2.0, 2.0, 2.0)


def test_a_single_number_stands_for_every_class(content: Content) -> None:
    card = parse_card(content)
    assert card.task.miss_error == {"car": 2.0, "pedestrian": 2.0}
    assert card.per_class(card.task.forecast_gate) == (2.0, 1.0), "in the order of task.classes"


def test_a_card_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "MTP-small-v0.toml"
    path.write_text(SMALL)
    assert load_card(path) == load_card(str(path)) == parse_card(tomllib.loads(SMALL))
    path.write_text(SMALL, encoding="utf-8-sig")  # with the mark that some editors write
    assert load_card(path) == parse_card(tomllib.loads(SMALL))


def test_the_digest_does_not_depend_on_order_and_spelling(content: Content) -> None:
    reordered = dict(reversed(content.items()))
    reordered["task"] = {**dict(reversed(content["task"].items())), "miss_error": {"pedestrian": 2.0, "car": 2.0}}
    assert parse_card(reordered).digest == parse_card(content).digest == "6621378e5670e103"


CHANGES = {
    "id": "MTP-other-v0",
    "summary": "three classes",
    "reference": "mtp",
    "source.detector": "other",
    "source.detections_sha256": "00",
    "source.split": "train",
    "source.ego_motion": False,
    "source.stride": 2,
    "task.rate": 5.0,
    "task.past": 9,
    "task.future": 9,
    "task.samples": 19,
    "task.classes": ["pedestrian", "car"],
    "task.event_gate.measure": "center_distance",
    "task.event_gate.threshold": 0.25,
    "task.forecast_gate.car": 3.0,
    "task.miss_error": 3.0,
    "size.detections": 5,
    "size.tracks": 9,
    "size.objects": 5,
    "size.hypotheses": 3,
}


@pytest.mark.parametrize(("key", "value"), CHANGES.items(), ids=CHANGES)
def test_the_digest_changes_with_every_field(content: Content, key: str, value: object) -> None:
    assert parse_card(put(content, key, value)).digest != parse_card(content).digest


def test_the_digest_does_not_depend_on_what_agents_choose_their_parameters_by(content: Content) -> None:
    rule = {"assignment": "greedy", "affinity": "center_distance", "gate": 2.0, "min_hits": 1, "max_age": 2}
    hints = {"motion_noise": "KITTI", "weights_of": "MTP-KITTI-v0", "board": 3, "tracker": {"car": rule}}
    card = parse_card({**content, **hints})
    assert card.digest == parse_card(content).digest
    assert {name: card.model_dump()[name] for name in hints} == hints


def test_every_field_has_a_change_in_the_test_above(content: Content) -> None:
    def leaves(table: Content, prefix: str = "") -> set[str]:
        found = set()
        for key, value in table.items():
            nested = isinstance(value, dict) and prefix + key not in {"task.event_gate.threshold", "task.miss_error"}
            found |= leaves(value, f"{prefix}{key}.") if nested else {prefix + key}
        return found

    dumped = leaves(parse_card(content).model_dump())
    # test_cards_simulated.py changes the fields of a simulated detector.
    assert dumped - {
        "source.name",
        "task.forecast_gate.pedestrian",
        "detector",
        "motion_noise",
        "weights_of",
        "board",
    } == set(CHANGES)


WRONG: dict[str, tuple[str, object, str]] = {
    "typo in an optional key": ("refrence", "stp", "unknown key 'refrence': did you mean 'reference'?"),
    "typo in a required key": (
        "size",
        {"detections": 4, "tarcks": 8, "objects": 4, "hypotheses": 2},
        "unknown key 'size.tarcks': did you mean 'tracks'?",
    ),
    "typo in a nested key": (
        "task.event_gate",
        {"mesure": "iou_3d", "threshold": 0.5},
        "unknown key 'task.event_gate.mesure': did you mean 'measure'?",
    ),
    "typo in a source key": ("source.detecter", "x", "unknown key 'detecter': did you mean 'detector'?"),
    "unlike any key": ("size.qqq", 1, "unknown key 'size.qqq': known are detections, hypotheses, objects, tracks"),
    "missing key": ("task.past", None, "key 'task.past' is missing"),
    "missing table": ("size", None, "key 'size' is missing"),
    "missing gate": ("task.event_gate.threshold", None, "key 'task.event_gate.threshold' is missing"),
    "no table": ("task", 3, "task: got 3: expected a table"),
    "text for an integer": ("task.past", "10", "task.past: got '10': Input should be a valid integer"),
    "decimal for an integer": ("task.past", 10.0, "task.past: got 10.0: Input should be a valid integer"),
    "truth value for a number": ("task.rate", True, "task.rate: got True: Input should be a valid number"),
    "text for a truth value": (
        "source.ego_motion",
        "no",
        "ego_motion: got 'no': Input should be a valid boolean",
    ),
    "number for a text": ("summary", 1, "summary: got 1: Input should be a valid string"),
    "text for a list": ("task.classes", "car", "task.classes: got 'car': Input should be a valid list"),
    "number in a list": ("task.classes", ["car", 1], "task.classes.1: got 1: Input should be a valid string"),
    "no classes": ("task.classes", [], "task.classes: got []: Tuple should have at least 1 item"),
    "the same class twice": ("task.classes", ["car", "car", "pedestrian"], "expected each class once"),
    "one past frame": ("task.past", 1, "task.past: got 1: Input should be greater than or equal to 2"),
    "no samples": ("task.samples", 0, "task.samples: got 0: Input should be greater than or equal to 1"),
    "no rate": ("task.rate", 0.0, "task.rate: got 0.0: Input should be greater than 0"),
    "infinite": ("task.forecast_gate.car", float("inf"), "task.forecast_gate.car: got inf"),
    "not a number": ("task.miss_error", float("nan"), "task.miss_error.car: got nan"),
    "negative gate": ("task.forecast_gate.car", -1.0, "task.forecast_gate.car is -1.0, expected a number above 0"),
    "an IoU in percent": (
        "task.event_gate.threshold",
        50.0,
        "event_gate.threshold.car is 50.0, expected a number above 0, at most 1",
    ),
    "unknown measure": ("task.event_gate.measure", "iou", "'iou_3d' or 'center_distance'"),
    "unknown source": (
        "source.name",
        "kiti",
        "source.name: got 'kiti', expected one of 'kitti', 'nuscenes', 'wildtrack'",
    ),
    "unknown split": ("source.split", "test", "split: got 'test': expected one of 'train', 'val'"),
    "unknown class in a table": (
        "task.forecast_gate.pedestrain",
        1.0,
        "task.forecast_gate has an unknown class 'pedestrain': did you mean 'pedestrian'?",
    ),
    "class without a value": (
        "task.forecast_gate.pedestrian",
        None,
        "task.forecast_gate has no value for class 'pedestrian'",
    ),
    "text in a class table": ("task.miss_error", {"car": "2", "pedestrian": 1.0}, "task.miss_error.car: got '2'"),
}


@pytest.mark.parametrize(("key", "value", "text"), WRONG.values(), ids=WRONG)
def test_wrong_content_is_one_clear_error(content: Content, key: str, value: object, text: str) -> None:
    with pytest.raises(CardError) as caught:
        parse_card(put(content, key, value), where="MTP-small-v0.toml")
    message = str(caught.value)
    assert message.startswith("MTP-small-v0.toml")
    assert text in message
    assert "\n" not in message


def test_unknown_env_id_names_the_nearest_or_all() -> None:
    with pytest.raises(UnknownNameError, match=r"unknown environment 'MTP-KITI-v0': did you mean 'MTP-KITTI-v0'\?"):
        load_card("MTP-KITI-v0")
    with pytest.raises(UnknownNameError) as caught:
        load_card("qqqq")
    assert all(env_id in str(caught.value) for env_id in card_ids())


@pytest.mark.parametrize(
    ("raw", "what"),
    [(b"id = ", "not valid TOML"), (b"\xff\xfe", "not valid UTF-8")],
    ids=["truncated", "not utf-8"],
)
def test_a_file_that_is_no_toml(tmp_path: Path, raw: bytes, what: str) -> None:
    path = tmp_path / "MTP-broken-v0.toml"
    path.write_bytes(raw)
    with pytest.raises(CardError, match=rf"MTP-broken-v0\.toml: {what}"):
        load_card(path)


def test_the_file_is_there_and_its_name_promises_the_id(tmp_path: Path) -> None:
    with pytest.raises(CardError, match=r"no card file at .*none\.toml"):
        load_card(tmp_path / "none.toml")
    path = tmp_path / "MTP-other-v0.toml"
    path.write_text(SMALL)
    with pytest.raises(CardError, match="id is 'MTP-small-v0', expected the file's stem 'MTP-other-v0'"):
        load_card(path)


def test_a_card_cannot_be_changed() -> None:
    card = load_card(card_ids()[0])
    with pytest.raises(ValueError, match="frozen"):
        card.id = "other"  # pyright: ignore[reportAttributeAccessIssue]


def test_shipped_cards_have_different_digests() -> None:
    cards: list[Card] = [load_card(env_id) for env_id in card_ids()]
    assert len({card.digest for card in cards}) == len(cards) == len(list(bundled("envs").glob("*.toml")))


@pytest.mark.parametrize("env_id", ["MTP-KITTI-v0", "MTP-nuScenes-v0"])
def test_other_detections_are_not_those_of_a_shipped_card(env_id: str) -> None:
    """A place is no part of the digest: with it alone the digest would be that of the card that ships."""
    stored = load_card(env_id).stored()
    stored["source"]["detections_file"] = "truth.json"
    with pytest.raises(CardError, match=r"source\.detections_file needs source\.detections_sha256"):
        parse_card(stored)
    stored["source"]["detections_sha256"] = "0" * 64
    assert parse_card(stored).digest != load_card(env_id).digest


def test_a_card_is_stored_whatever_its_files_are_called(tmp_path: Path) -> None:
    file, folder = tmp_path / "my détections.json", tmp_path / "my boxes"
    file.write_text("{}")
    folder.mkdir()
    named = with_detections(load_card("MTP-nuScenes-mini-v0"), file), with_detections(load_card("MTP-KITTI-v0"), folder)
    assert [card.detector_name for card in named] == ["megvii-my-d-tections", "pointrcnn-my-boxes"]
    for card in (*named, with_files(named[1], folder)):
        assert parse_card(card.stored()) == card


def test_the_corners_of_an_area_come_in_order() -> None:
    DetectorSection(profile="clean", area=(-3.0, -9.0, 9.0, 27.0))
    with pytest.raises(ValidationError, match="expected least x and y, then largest x and y"):
        DetectorSection(profile="clean", area=(9.0, 27.0, -3.0, -9.0))
