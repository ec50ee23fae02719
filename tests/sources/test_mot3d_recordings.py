"""3DMOT2015 source on the real recordings: known counts, and how well the detections lie on the truth."""

from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card, with_split
from mtp_bench.core import Scene
from mtp_bench.scoring import find_targets
from mtp_bench.sources import open_source
from tests.support.source_files import card_of

pytestmark = pytest.mark.data


def whole_sequence(sequence: str, rate: float, frames: int) -> Card:
    return card_of("MTP-PETS-v0", ["pedestrian"], rate, sequence=sequence, train_scenes=0, scene_frames=frames)


PETS = whole_sequence("PETS09-S2L1", 7.0, 795)
TUD = whole_sequence("TUD-Stadtmitte", 25.0, 179)


@pytest.fixture(scope="module")
def scenes(data_root: Path) -> dict[str, Scene]:
    found = {}
    for card in (PETS, TUD):
        source = open_source(card, data_root)
        assert len(source.names) == 1
        found[card.id + source.names[0]] = source.load(source.names[0])
    return {scene.name: scene for scene in found.values()}


@pytest.mark.parametrize(("name", "counts"), [
    pytest.param("PETS09-S2L1-0001", (795, 19, 4650, 5578), id="PETS"),
    pytest.param("TUD-Stadtmitte-0001", (179, 10, 1156, 1129), id="TUD"),
])  # fmt: skip
def test_counts(scenes: dict[str, Scene], name: str, counts: tuple[int, int, int, int]) -> None:
    scene = scenes[name]
    ids = len(np.unique(scene.truth.object_id))
    assert ((scene.frames, ids, len(scene.truth.box), len(scene.detections.box)), scene.skipped) == (counts, {})


def test_scenes_of_the_card(data_root: Path, scenes: dict[str, Scene]) -> None:
    """20 s each, the first two for training, the last one shorter; together they are the sequence."""
    whole, card = scenes["PETS09-S2L1-0001"], load_card("MTP-PETS-v0")
    first = {"train": [1, 141], "val": [281, 421, 561, 701]}
    parts: list[Scene] = []
    for split, numbers in first.items():
        source = open_source(with_split(card, split), data_root)
        assert source.names == tuple(f"PETS09-S2L1-{number:04d}" for number in numbers)
        parts += [source.load(name) for name in source.names]
    assert [scene.frames for scene in parts] == [140, 140, 140, 140, 140, 95]
    np.testing.assert_allclose(np.concatenate([scene.time for scene in parts]), whole.time)
    np.testing.assert_array_equal(np.concatenate([scene.truth.box for scene in parts]), whole.truth.box)
    np.testing.assert_array_equal(np.concatenate([scene.detections.box for scene in parts]), whole.detections.box)
    assert all(np.array_equal(scene.ego, np.tile([-6.0, -4.0, 0, 0], (scene.frames, 1))) for scene in parts)
    assert [int(scene.truth.neutral.sum()) for scene in parts] == [0, 174, 0, 0, 0, 0]
    assert all(len(find_targets(scene, card)) > 200 for scene in parts)
    # people keep their ids across the cuts: 15 are forecast, not 29
    assert {scene.recording for scene in parts} == {"PETS09-S2L1"}
    np.testing.assert_array_equal(np.concatenate([scene.truth.object_id for scene in parts]), whole.truth.object_id)
    forecast = [np.unique(find_targets(scene, card).object_id) for scene in parts[2:]]
    assert (len(np.unique(np.concatenate(forecast))), len(np.concatenate(forecast))) == (15, 29)
