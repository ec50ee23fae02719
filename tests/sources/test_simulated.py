"""Simulated detections in place of stored ones: the frame of reference that they stand still in."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from mtp_bench import detector
from mtp_bench.cards import load_card, with_detector, with_scenes
from mtp_bench.core import Scene
from mtp_bench.core.geometry import rotate, transform_boxes, wrap_angle
from mtp_bench.sources import load_scenes, simulated
from mtp_bench.sources.base import no_detections
from mtp_bench.sources.motion import looking_back
from mtp_bench.sources.simulated import detected
from tests.support.detector_scenes import traffic

CARD = with_detector(load_card("MTP-KITTI-noego-v0"), "kitti_pointrcnn_raw")
STEPS = np.arange(40)
WORLD = np.stack([0.9 * STEPS, 0.1 * STEPS, 0.01 * STEPS, 0.02 * STEPS], axis=1)  # poses of what drives and turns


def test_a_moving_frame_of_reference_changes_nothing_that_is_detected() -> None:
    """The same scene twice, in the world and in the frames of a sensor that drives and turns: false boxes included."""
    truth, _ = traffic(frames=40)
    time = STEPS / CARD.task.rate
    still = Scene(name="a", time=time, ego=WORLD, truth=truth, detections=no_detections(40))
    pose = WORLD[truth.frame_of_rows]
    box = transform_boxes(truth.box, -pose[:, 3], -rotate(pose[:, :3], -pose[:, 3]))
    own = replace(truth, box=box, velocity=rotate(truth.velocity, -pose[:, 3]))
    moving = replace(still, ego=np.zeros((40, 4)), truth=own, world=WORLD)
    expected, found = detected(still, CARD, seed=0).detections, detected(moving, CARD, seed=0).detections
    assert len(found.box) > len(truth.box) / 4
    np.testing.assert_array_equal(found.start, expected.start)
    np.testing.assert_array_equal(found.class_id, expected.class_id)
    np.testing.assert_allclose(found.score, expected.score, atol=1e-9)
    pose = WORLD[found.frame_of_rows]
    off = transform_boxes(found.box, pose[:, 3], pose[:, :3]) - expected.box
    off[:, 3] = wrap_angle(off[:, 3])
    np.testing.assert_allclose(off, 0, atol=1e-9)
    assert detected(moving, CARD, seed=0).truth is own


def test_no_missing_velocity_tells_a_true_box_from_a_false_one() -> None:
    """Backward velocities are unknown in the first frame of an object: what is shown of it must not say so."""
    truth, _ = traffic(frames=30)
    unknown = truth.velocity.copy()
    unknown[truth.frame_of_rows % 7 == 0] = np.nan
    scene = Scene("a", np.arange(30) / 2, np.zeros((30, 4)), truth, no_detections(30))
    for profile in ("nuscenes_megvii_raw", "nuscenes_megvii"):
        card = with_detector(load_card("MTP-nuScenes-mini-v0"), profile)
        part = replace(scene, truth=replace(truth, velocity=unknown, class_id=np.zeros(len(truth.box), dtype=int)))
        seen = detected(part, card, seed=0)
        assert len(seen.detections.box) > 100
        assert np.isfinite(seen.detections.velocity).all()
        assert (np.abs(seen.detections.velocity) > 0).all()
        assert seen.truth is part.truth


def test_own_scenes_of_people_have_places_alone_too() -> None:
    truth, _ = traffic(frames=30)
    box = truth.box.copy()
    box[:, 3:] = 0, 0.6, 0.6, 1.75
    people = replace(truth, box=box, class_id=np.zeros(len(box), dtype=int))
    scene = Scene("a", np.arange(30) / 2, np.zeros((30, 4)), people, no_detections(30))
    card = with_scenes(load_card("MTP-WILDTRACK-v0"), [scene])
    assert card.source.traits.places_only
    pets = with_scenes(load_card("MTP-PETS-v0"), [scene]).source.traits
    assert (pets.places_only, pets.bounded_by_truth) == (True, True)
    (seen,) = load_scenes(with_detector(card, "wildtrack_mvdet"))
    assert len(seen.detections.box) > len(box) / 10, "within the reach of the detector of WILDTRACK, which stays"
    assert len(np.unique(seen.detections.box[:, 3:], axis=0)) == 1
    others = with_scenes(load_card("MTP-nuScenes-v0"), [scene]).source.model_dump(exclude_none=True)
    assert others.keys().isdisjoint({"places_only", "bounded_by_truth"})


def test_what_stands_moves_against_a_frame_that_drives_true_or_not() -> None:
    """Velocities of a detector are those of its frame: a false box that stands is told the same as a true one."""
    truth, _ = traffic(frames=40)
    _, first, inverse = np.unique(truth.object_id, return_index=True, return_inverse=True)  # rows of the objects
    standing = replace(truth, box=truth.box[first[inverse]], velocity=np.zeros_like(truth.velocity))
    pose = WORLD[standing.frame_of_rows]
    box = transform_boxes(standing.box, -pose[:, 3], -rotate(pose[:, :3], -pose[:, 3]))
    time = STEPS / CARD.task.rate
    own = looking_back(replace(standing, box=box, class_id=np.zeros(len(box), dtype=int)), time, 1 / CARD.task.rate)
    card = with_detector(load_card("MTP-KITTI-noego-v0"), "nuscenes_megvii_raw")
    seen = detected(Scene("a", time, np.zeros((40, 4)), own, no_detections(40), world=WORLD), card, seed=0).detections
    frame = seen.frame_of_rows
    seen_with = [(own.rows(t), at) for t, at in zip(frame, seen.box[:, :2], strict=True)]
    near = np.array([np.abs(box[rows, :2] - at).sum(1).min(initial=99.0) for rows, at in seen_with])
    for which in ((near < 2) & (frame > 0), (near > 5) & (frame > 0)):
        assert which.sum() > 40
        now, before, place = WORLD[frame[which]], WORLD[frame[which] - 1], seen.box[which, :2]
        still = now[:, :2] + rotate(place, now[:, 3])  # in the world; then where it was in the frame before
        expected = (place - rotate(still - before[:, :2], -before[:, 3])) * CARD.task.rate
        assert np.abs(np.median(seen.velocity[which] - expected, axis=0)).max() < 0.2
        assert np.linalg.norm(np.median(expected, axis=0)) > 5


def test_detections_are_simulated_once_and_nobody_can_change_those_that_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth, ego = traffic(frames=20)
    scene = Scene("kept", np.arange(20) / CARD.task.rate, ego, truth, no_detections(20))
    monkeypatch.setattr(simulated, "_SIMULATED", {})
    first = detected(scene, CARD).detections
    expected = {name: column.copy() for name, column in vars(first).items()}
    first.box[:] = 0.0
    simulate = Mock(return_value=first)
    monkeypatch.setattr(detector, "simulate", simulate, raising=False)
    for name, column in vars(detected(scene, CARD).detections).items():
        np.testing.assert_array_equal(column, expected[name])
    simulate.assert_not_called()
    detected(replace(scene, name="of another name, so another noise"), CARD)
    monkeypatch.setattr(simulated, "MAX_SIMULATED_BYTES", 0)
    detected(replace(scene, ego=ego + 1.0), CARD)
    assert len(simulate.mock_calls) == 2
    assert not simulated._SIMULATED
