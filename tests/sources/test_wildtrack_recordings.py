"""WILDTRACK source on the real recording: known counts, and detections, stored and simulated, on the truth."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from mtp_bench.cards import load_card, with_split
from mtp_bench.core import Detections, Scene, Truth
from mtp_bench.scoring import find_targets
from mtp_bench.sources.wildtrack import SCENES, SPLITS, STORED, Wildtrack

pytestmark = pytest.mark.data

RADIUS = 0.5  # m


@pytest.fixture(scope="module")
def scenes(data_root: Path) -> dict[str, Scene]:
    sources = [Wildtrack(with_split(load_card("MTP-WILDTRACK-v0"), split), data_root) for split in ("train", "val")]
    return {name: source.load(name) for source in sources for name in source.names}


def hits(truth: Truth, detections: Detections) -> int:
    """Pairs within half a metre, one to one, as many as possible."""
    count = 0
    for t in range(truth.frames):
        off = truth.box[truth.rows(t), None, :2] - detections.box[None, detections.rows(t), :2]
        near = np.hypot(off[..., 0], off[..., 1]) <= RADIUS
        count += int(near[linear_sum_assignment(near, maximize=True)].sum())
    return count


def test_counts_of_the_dataset(data_root: Path, scenes: dict[str, Scene]) -> None:
    assert (tuple(scenes), sum(scene.frames for scene in scenes.values())) == (tuple(SCENES), 400)
    assert sum(len(scene.truth.box) for scene in scenes.values()) == 9518
    frame = np.concatenate([40 * i + scene.truth.frame_of_rows for i, scene in enumerate(scenes.values())])
    ids = np.concatenate([scene.truth.object_id for scene in scenes.values()])
    tracks = [np.sort(frame[ids == i]) for i in np.unique(ids)]
    assert (len(tracks), sum(bool((np.diff(track) > 1).any()) for track in tracks)) == (313, 27)


def test_people_keep_their_ids_across_scenes(scenes: dict[str, Scene]) -> None:
    card = load_card("MTP-WILDTRACK-v0")
    assert {scene.recording for scene in scenes.values()} == {"wildtrack"}
    forecast = [np.unique(find_targets(scenes[name], card).object_id) for name in SPLITS["val"]]
    assert (len(np.unique(np.concatenate(forecast))), len(np.concatenate(forecast))) == (63, 95)


def test_stored_detections_lie_on_the_truth(scenes: dict[str, Scene]) -> None:
    truth, detections = scenes[STORED].truth, scenes[STORED].detections
    assert (len(truth.box), len(detections.box)) == (952, 966)
    assert hits(truth, detections) / len(truth.box) == pytest.approx(0.950, abs=5e-4)
    assert hits(truth, detections) / len(detections.box) == pytest.approx(0.936, abs=5e-4)
    assert all(scene.detector == "" for name, scene in scenes.items() if name != STORED)
