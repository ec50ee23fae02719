"""Cards: strict TOML with a digest of its content."""

import copy
import itertools
import tomllib
from pathlib import Path
from typing import Any

import pytest

from mtp_bench import card_ids
from mtp_bench.cards import load_card, parse_card
from mtp_bench.core.bundle import bundled
from mtp_bench.core.errors import CardError
from mtp_bench.traffic.highway.world import GENERATOR, HighwaySource

Content = dict[str, Any]

SMALL = """
id = "MTP-small-v0"
summary = "two classes"
reference = "stp"

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


def simulated_content() -> Content:
    return tomllib.loads((bundled("envs") / "MTP-Intersection-v0.toml").read_text())


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


KITTI, VEHICLES = ("car", "pedestrian", "cyclist"), ("car", "truck", "bus", "trailer", "construction_vehicle")
PEOPLE, TRAFFIC = ("pedestrian",), ("car", "truck", "bus", "motorcycle")
DRIVING = ("car", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian")
FAR, NEAR, IOU = (2.0, 10.0), (1.0, 4.0), (2.0, 2.0)
# rate, past, future, k, classes; forecast gate and miss error of the first and the last class; detector, ego, velocity
PROTOCOL: dict[str, tuple[Any, ...]] = {
    "MTP-KITTI-v0": (10.0, 10, 10, 20, KITTI, IOU, (1.5, 2.0), "pointrcnn", True, False),
    "MTP-KITTI-noego-v0": (10.0, 10, 10, 20, KITTI, IOU, (1.5, 2.0), "pointrcnn", True, False),
    "MTP-KITTI-5Hz-v0": (5.0, 10, 10, 20, KITTI, IOU, (1.5, 2.0), "pointrcnn", True, False),
    "MTP-nuScenes-v0": (2.0, 4, 12, 10, VEHICLES, FAR, FAR, "megvii", True, False),
    "MTP-nuScenes-CenterPoint-v0": (2.0, 4, 12, 10, VEHICLES, FAR, FAR, "centerpoint", True, False),
    "MTP-nuScenes-3s-v0": (2.0, 4, 6, 10, VEHICLES, FAR, FAR, "megvii", True, False),
    "MTP-nuScenes-mini-v0": (
        2.0, 4, 12, 10, (*VEHICLES, "motorcycle", "bicycle", "pedestrian"), FAR, NEAR, "megvii", True, False,
    ),
    "MTP-AV2-v0": (2.0, 4, 12, 10, DRIVING, FAR, NEAR, "nuscenes_megvii", True, False),
    "MTP-AV2-Lanes-v0": (2.0, 4, 12, 10, DRIVING, FAR, NEAR, "nuscenes_megvii", True, False),
    "MTP-AV2-3s-v0": (2.0, 4, 6, 10, DRIVING, FAR, NEAR, "nuscenes_megvii", True, False),
    "MTP-AV2-10Hz-v0": (10.0, 10, 10, 20, DRIVING, IOU, (1.0, 2.0), "nuscenes_megvii", True, False),
    "MTP-WILDTRACK-v0": (2.0, 4, 12, 1, PEOPLE, NEAR, NEAR, "wildtrack_mvdet", False, False),
    "MTP-WILDTRACK-k10-v0": (2.0, 4, 12, 10, PEOPLE, NEAR, NEAR, "wildtrack_mvdet", False, False),
    "MTP-PETS-v0": (7.0, 7, 14, 10, PEOPLE, (1.0, 2.0), (1.0, 2.0), "acf", False, False),
    "MTP-Intersection-v0": (2.0, 4, 12, 10, (*TRAFFIC, "pedestrian"), FAR, NEAR, "nuscenes_megvii", True, True),
    "MTP-IntersectionRaw-v0": (2.0, 4, 12, 10, (*TRAFFIC, "pedestrian"), FAR, NEAR, "nuscenes_megvii_raw", True, True),
    "MTP-Roundabout-v0": (2.0, 4, 12, 10, TRAFFIC, FAR, FAR, "nuscenes_megvii", False, True),
    "MTP-Merge-v0": (10.0, 10, 10, 20, None, IOU, IOU, "kitti_pointrcnn", True, False),
    "MTP-Highway-v0": (10.0, 10, 10, 20, None, IOU, IOU, "kitti_pointrcnn", True, False),
}  # fmt: skip


@pytest.mark.parametrize("env_id", PROTOCOL)
def test_shipped_cards_follow_the_protocol(env_id: str) -> None:
    card = load_card(env_id)
    task = card.task
    first, last = ((task.forecast_gate[name], task.miss_error[name]) for name in (task.classes[0], task.classes[-1]))
    names = card.detector_name, card.has_ego, card.velocity
    classes = PROTOCOL[env_id][4] and task.classes
    found = (task.rate, task.past, task.future, task.samples, classes, first, last, *names)
    assert (card.id, found) == (env_id, PROTOCOL[env_id])
    if "KITTI" in env_id:
        assert (task.event_gate.measure, card.per_class(task.event_gate.threshold)) == ("iou_3d", (0.5, 0.5, 0.5))
        assert card.source.traits.common_frame == (env_id == "MTP-KITTI-v0")
    else:
        assert task.event_gate.measure == "center_distance"
        for name in (task.classes[0], task.classes[-1]):
            assert task.event_gate.threshold[name] == task.forecast_gate[name]
    assert card.size.objects >= card.size.detections, "an agent must be able to forecast all that it sees"


def test_every_shipped_card_has_its_own_digest() -> None:
    assert set(PROTOCOL) <= set(card_ids())
    assert len({load_card(env_id).digest for env_id in card_ids()}) == len(card_ids())


@pytest.mark.parametrize("env_id", ["MTP-Intersection-v0", "MTP-Merge-v0"])
def test_splits_of_simulated_traffic_have_no_scene_in_common(env_id: str) -> None:
    source = load_card(env_id).source
    assert isinstance(source, HighwaySource)
    assert (source.generator, source.seconds) == (GENERATOR, 20.0)
    ranges = [getattr(source.seeds, split) for split in ("train", "val", "test")]
    assert [end - first for first, end in ranges] == [500, 150, 150]
    assert all(end <= first for (_, end), (first, _) in itertools.pairwise(ranges))


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


SIMULATED: dict[str, object] = {  # of MTP-Intersection-v0
    "source.split": "test",
    "source.sensor": "roadside",
    "source.seconds": 10.0,
    "source.vehicles": 10,
    "source.pedestrians": 0,
    "source.seeds.train": [0, 2],
    "detector.profile": "nuscenes_centerpoint",
    "detector.variant": "iid",
    "detector.reach": 50.0,
    "detector.field_of_view": 180.0,
    "detector.seed": 1,
}
CHANGES: dict[str, object] = {
    "id": "MTP-other-v0", "summary": "three classes", "reference": "mtp", "source.detector": "other",
    "source.detections_sha256": "00", "source.split": "train", "source.ego_motion": False, "source.stride": 2,
    "task.rate": 5.0, "task.past": 9, "task.future": 9, "task.samples": 19, "task.classes": ["pedestrian", "car"],
    "task.event_gate.measure": "center_distance", "task.event_gate.threshold": 0.25, "task.forecast_gate.car": 3.0,
    "task.miss_error": 3.0, "size.detections": 5, "size.tracks": 9, "size.objects": 5, "size.hypotheses": 3,
}  # fmt: skip


def test_the_digest_changes_with_every_field(content: Content) -> None:
    for whole, changes in ((content, CHANGES), (simulated_content(), SIMULATED)):
        digests = {parse_card(put(whole, key, value)).digest for key, value in changes.items()}
        assert len(digests | {parse_card(whole).digest}) == len(changes) + 1


def test_the_digest_does_not_depend_on_what_agents_choose_their_parameters_by(content: Content) -> None:
    rule = {"assignment": "greedy", "affinity": "center_distance", "gate": 2.0, "min_hits": 1, "max_age": 2}
    hints = {"motion_noise": "KITTI", "weights_of": "MTP-KITTI-v0", "board": 3, "tracker": {"car": rule}}
    card = parse_card({**content, **hints})
    assert (card.digest, {name: card.model_dump()[name] for name in hints}) == (parse_card(content).digest, hints)


WRONG: dict[str, tuple[str, object, str]] = {
    "typo in an optional key": ("refrence", "stp", "unknown key 'refrence': did you mean 'reference'?"),
    "missing key": ("task.past", None, "key 'task.past' is missing"),
    "no table": ("task", 3, "task: got 3: expected a table"),
    "text for an integer": ("task.past", "10", "task.past: got '10'"),
    "no classes": ("task.classes", [], "task.classes: got []"),
    "the same class twice": ("task.classes", ["car", "car", "pedestrian"], "expected each class once"),
    "infinite": ("task.forecast_gate.car", float("inf"), "task.forecast_gate.car: got inf"),
    "an IoU in percent": ("task.event_gate.threshold", 50.0, "an IoU of at most 1"),
    "unknown measure": ("task.event_gate.measure", "iou", "'iou_3d' or 'center_distance'"),
    "unknown source": ("source.name", "kiti", "source.name: got 'kiti', expected one of 'kitti'"),
    "unknown split": ("source.split", "test", "split: got 'test': expected one of 'train', 'val'"),
    "unknown class in a table": ("task.forecast_gate.pedestrain", 1.0, "unknown class 'pedestrain'"),
    "class without a value": ("task.forecast_gate.pedestrian", None, "no value for class 'pedestrian'"),
}


@pytest.mark.parametrize(("key", "value", "text"), WRONG.values(), ids=WRONG)
def test_wrong_content_is_one_clear_error(content: Content, key: str, value: object, text: str) -> None:
    with pytest.raises(CardError) as caught:
        parse_card(put(content, key, value), where="MTP-small-v0.toml")
    message = str(caught.value)
    assert message.startswith("MTP-small-v0.toml")
    assert text in message
    assert "\n" not in message
