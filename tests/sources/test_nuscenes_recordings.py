"""nuScenes source on the real recordings: known counts, and detections that lie where the true boxes are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, with_split
from mtp_bench.core import Scene
from mtp_bench.core.geometry import center_distance
from mtp_bench.scoring.targets import find_targets
from mtp_bench.sources import open_source

pytestmark = pytest.mark.data

NEAR = 40.0  # m


def changed(card: Card, **source: Any) -> Card:
    return card.model_copy(update={"source": card.source.model_copy(update=source)})


MINI, TRAIN = load_card("MTP-nuScenes-mini-v0"), with_split(load_card("MTP-nuScenes-v0"), "train")
CENTERPOINT = changed(MINI, detector="centerpoint", split="val")


def scenes_of(data: Path, card: Card) -> list[Scene]:
    source = open_source(card, data)
    return [source.load(name) for name in source.names]


@pytest.fixture(scope="module")
def mini(data_root: Path) -> list[Scene]:
    return scenes_of(data_root, MINI)


@pytest.fixture(scope="module")
def train(data_root: Path) -> list[Scene]:
    return scenes_of(data_root, TRAIN)


def test_counts_of_mini(data_root: Path, mini: list[Scene]) -> None:
    assert [len(mini), sum(scene.frames for scene in mini)] == [10, 404]
    assert sum(len(scene.truth.box) for scene in mini) == 18389 - 2323 - 1378  # without barriers and cones
    assert sum(scene.truth.neutral.sum() for scene in mini) == 25  # somebody on a scooter
    assert sum(len(scene.detections.box) for scene in mini) == 27937
    assert all(scene.truth_complete and scene.truth.eligible.all() for scene in mini)
    everything = (*MINI.task.classes, "traffic_cone", "barrier")
    card = MINI.model_copy(update={"task": MINI.task.model_copy(update={"classes": everything})})
    assert sum(len(scene.truth.box) for scene in scenes_of(data_root, card)) == 18389


def test_counts_of_trainval(data_root: Path, train: list[Scene]) -> None:
    assert [len(train), sum(scene.frames for scene in train)] == [100, 3893]
    assert sum(len(np.unique(scene.truth.object_id)) for scene in train) == 624
    assert sum(len(scene.truth.box) for scene in train) == 16341
    assert sum(len(scene.detections.box) for scene in train) == 167967
    assert sum(len(find_targets(scene, TRAIN)) for scene in train) == 7749
    assert sum(scene.truth.eligible.sum() for scene in train) == 7749
    assert not any(scene.truth_complete for scene in train)


def test_targets_of_mini(data_root: Path) -> None:
    for split, targets in (("mini_train", 742), ("mini_val", 61)):
        card = changed(MINI, truth="targets", split=split)
        assert sum(len(find_targets(scene, card)) for scene in scenes_of(data_root, card)) == targets


@pytest.mark.parametrize(
    ("card", "found"), [(MINI, 0.93), (CENTERPOINT, 0.91), (TRAIN, 0.97)], ids=["megvii", "centerpoint", "all"]
)
def test_detections_lie_on_the_truth(data_root: Path, card: Card, found: float) -> None:
    """Share of the cars nearer than 40 m with a detected car within 2 m; half of them are nearer than 20 cm."""
    nearest: list[float] = []
    for scene in scenes_of(data_root, card):
        truth, seen = scene.truth, scene.detections
        far = np.hypot(*(truth.box[:, :2] - scene.ego[truth.frame_of_rows, :2]).T)
        for t in range(scene.frames):
            true = truth.box[truth.rows(t)][(far < NEAR)[truth.rows(t)] & (truth.class_id[truth.rows(t)] == 0)]
            shown = seen.box[seen.rows(t)][seen.class_id[seen.rows(t)] == 0]
            nearest += center_distance(true[:, None], shown[None]).min(axis=1, initial=99.0).tolist()
    on_it = np.array(nearest) < 2
    assert round(float(on_it.mean()), 2) == found
    assert np.median(np.array(nearest)[on_it]) < 0.2
