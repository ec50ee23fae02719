"""The tracker with AB3DMOT's settings against that tracker's published figures, on the KITTI validation split."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import Card, load_card
from mtp_bench.core import Bools, Floats, Scene
from mtp_bench.scoring import history, match
from mtp_bench.scoring.pairs import box_pairs
from mtp_bench.sources import open_source
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.training.split import observations
from tests.support.kitti_mot import Annotations, TrackRows, count_scene, detection_image_boxes, read_annotations
from tests.support.tracking_counts import find_events
from tests.support.tracking_scenes import kitti_task

CLASSES = ("car", "pedestrian", "cyclist")


@dataclass(frozen=True)
class Run:
    """One scene and what the tracker made of it."""

    scene: Scene
    truth: Annotations
    tracks: TrackRows


def track(scene: Scene, assignment: str, image_box: Floats) -> TrackRows:
    """Every row that one hypothesis puts out, with the score and image box of the detection that it took last."""
    tracker = HypothesisTracker(1, assignment=assignment)
    tracker.reset(kitti_task(classes=CLASSES))
    last: dict[int, int] = {}
    frame, track_id, class_id, box, took = [], [], [], [], []
    for t, seen in enumerate(observations(scene)):
        tracks = tracker.step(seen)
        hit = np.flatnonzero(tracks.detection >= 0)
        first = int(scene.detections.start[t])
        last.update(zip(tracks.track_id[hit].tolist(), (first + tracks.detection[hit]).tolist(), strict=True))
        frame.append(np.full(len(tracks.track_id), t))
        track_id.append(tracks.track_id)
        class_id.append(tracks.class_id)
        box.append(tracks.box)
        took += [last[i] for i in tracks.track_id.tolist()]
    return TrackRows(
        frame=np.concatenate(frame), track_id=np.concatenate(track_id), class_id=np.concatenate(class_id),
        box=np.concatenate(box), score=scene.detections.score[took], image_box=image_box[took],
    )  # fmt: skip


@pytest.fixture(scope="module")
def runs(data_root: Path) -> Callable[[str, str], list[Run]]:
    """Runs over all validation scenes of a card; each is made once."""
    root = data_root / "kitti_tracking"

    @cache
    def make(card_id: str, assignment: str) -> list[Run]:
        card = load_card(card_id)
        source = open_source(card, data_root)
        scenes = [source.load(name) for name in source.names]
        boxes = (detection_image_boxes(root, scene, CLASSES) for scene in scenes)
        common = card.source.traits.common_frame
        return [Run(scene, read_annotations(root, scene, common), track(scene, assignment, box))
                for scene, box in zip(scenes, boxes, strict=True)]  # fmt: skip

    return make


# MOTA of AB3DMOT with ego-motion compensation, in percent. Ours without switches: 86.37, 73.52, 85.31.
AB3DMOT_TABLE = {"car": 86.47, "pedestrian": 73.86, "cyclist": 84.79}


@pytest.mark.data
@pytest.mark.parametrize("class_name", CLASSES)
def test_accuracy_is_that_of_ab3dmot(class_name: str, runs: Callable[[str, str], list[Run]]) -> None:
    counts = np.zeros(3)
    for run in runs("MTP-KITTI-v0", "as_parameters"):
        mine = run.tracks.keep(run.tracks.class_id == CLASSES.index(class_name)).above(class_name)
        counts += count_scene(run.scene.frames, run.truth, mine, class_name)
    truth, misses, false = counts
    assert 100 * (1 - (misses + false) / truth) == pytest.approx(AB3DMOT_TABLE[class_name], abs=1.0)


def count_events(runs: list[Run], card: Card, vans: bool = False) -> Counter[str]:
    """Identity events of all true objects at a 3D IoU of 0.5, with all tracks; ``vans`` counts neighbour classes in.

    "seen": the object is neither truncated nor hidden; "with future": ten more frames of it follow; "objects": those
    with a switch.
    """
    total = Counter[str]()
    for run in runs:
        truth, tracks = run.scene.truth, run.tracks
        keep = ~truth.neutral | vans
        frame = truth.frame_of_rows[keep]
        object_id = truth.object_id[keep]
        gate = card.per_class(card.task.event_gate.threshold)
        pairs = box_pairs(
            frame, truth.box[keep], truth.class_id[keep], tracks.frame, tracks.box, tracks.class_id, "iou_3d", gate
        )
        events = find_events(history(frame, object_id), match(pairs, len(frame)), tracks.track_id)
        alive = set(zip(object_id.tolist(), frame.tolist(), strict=True))
        future = np.array([all((o, t + i) in alive for i in range(11)) for o, t in zip(object_id, frame, strict=True)])
        total["ids"] += len(events.ids)
        total["lost"] += len(events.lost)
        total["reacquired"] += len(events.reacquired)
        total["lost, seen"] += int((~hidden(run, keep)[events.lost]).sum())
        total["ids with future"] += int(future[events.ids].sum())
        total["lost with future"] += int(future[events.lost].sum())
        total["objects"] += len(np.unique(object_id[events.ids]))
    return total


def hidden(run: Run, keep: Bools) -> Bools:
    """True boxes that AB3DMOT's evaluation ignores."""
    labels, hidden = run.truth.labels, run.truth.hidden
    by_name = dict(
        zip(zip(labels.frame.tolist(), labels.table.whole_numbers("id").tolist(), strict=True), hidden, strict=True)
    )
    frame, object_id = run.scene.truth.frame_of_rows[keep], run.scene.truth.object_id[keep]
    return np.array([by_name[t, o] for t, o in zip(frame.tolist(), object_id.tolist(), strict=True)])


NOEGO = "MTP-KITTI-noego-v0"


# card, assignment, whether vans count, and the expected counts with their tolerances. AB3DMOT without compensation: 34 ids
# on 8 objects, 462 lost; 352 lost not ignored; 30 / 340 with ten future frames. Its files hold vans. With compensation it
# has 2 to 4 ids.
EVENTS: list[tuple[str, str, bool, dict[str, tuple[int, int]]]] = [
    (NOEGO, "as_parameters", False, {
        "ids": (33, 3), "ids with future": (29, 3), "lost": (433, 30), "lost, seen": (352, 20),
        "lost with future": (312, 30), "reacquired": (332, 30), "objects": (7, 1)}),
    (NOEGO, "as_parameters", True, {"ids": (34, 3), "objects": (8, 1)}),
    (NOEGO, "hungarian", False, {"ids": (11, 3), "lost": (432, 30), "lost, seen": (356, 30)}),
    ("MTP-KITTI-v0", "as_parameters", False, {"ids": (0, 3), "lost": (351, 30)}),
]  # fmt: skip


@pytest.mark.data
@pytest.mark.parametrize(("card_id", "assignment", "vans", "expected"), EVENTS)
def test_events_are_those_of_ab3dmot(
    card_id: str, assignment: str, vans: bool, expected: dict[str, tuple[int, int]],
    runs: Callable[[str, str], list[Run]],
) -> None:  # fmt: skip
    counts = count_events(runs(card_id, assignment), load_card(card_id), vans)
    for what, (count, tolerance) in expected.items():
        assert counts[what] == pytest.approx(count, abs=tolerance), what
