"""Training windows: what agents see, beside the truth that belongs to it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.core import ImageField, Lane, Scene
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.env.observation import LocalFrame, make_feed
from mtp_bench.running.options import RunOptions
from mtp_bench.tracking import ClassParameters, HypothesisTracker, TruthTracker
from mtp_bench.training.labels import UNKNOWN
from mtp_bench.training.tracklets import BY_WINDOW, Windows, concatenate, windows, windows_of_scene
from tests.support.scoring_scenes import end_to_end
from tests.support.small_scenes import CARD, bare_scene, make_scene, task as small_task, write_card, write_kitti


def windows_of_scenes(tmp_path: Path, *scenes: Scene, truth: bool = False, hypotheses: int = 1) -> Windows:
    card = load_card(write_card(tmp_path))
    task = small_task(observe="truth" if truth else "detections")
    tracker = TruthTracker() if truth else HypothesisTracker(hypotheses)
    return concatenate([windows_of_scene(scene, card, task, tracker) for scene in scenes])


def test_true_pasts_have_their_own_futures(tmp_path: Path) -> None:
    scene = make_scene(frames=8)
    found = windows_of_scenes(tmp_path, scene, truth=True)
    assert len(found) == 8 * 3
    np.testing.assert_allclose(found.present, found.box[:, -1, :2], atol=1e-4)
    local = LocalFrame.of(scene)
    for row in np.flatnonzero(found.object_id == 7):
        t = int(found.frame[row])
        true = local.to_local(np.array([[20 + 0.8 * i, 10, 0.8, 0, 4, 1.8, 1.5] for i in range(t + 1, t + 4)]))
        known = found.future_known[row]
        assert known.tolist() == [t + step < 8 for step in (1, 2, 3)]
        np.testing.assert_allclose(found.future[row][known], true[known, :2], atol=1e-4)


def test_tracks_follow_the_object_of_their_last_detection(tmp_path: Path) -> None:
    """Detections are .1 m off along x; where none is made the track coasts, and still follows its object."""
    found = windows_of_scenes(tmp_path, make_scene(empty=(4,)))
    assert set(found.object_id.tolist()) == {3, 5, 7}
    assert set(found.frame[found.target].tolist()) == {1, 2, 3, 4}  # two past frames, three future ones
    seen = found.taken[:, -1]
    off = np.linalg.norm(found.present - found.box[:, -1, :2], axis=1)
    np.testing.assert_allclose(off[seen], 0.1, atol=1e-4)
    coasting = found.frame == 4
    assert coasting.sum() == 3
    assert not seen[coasting].any()
    assert (found.detection[coasting, -1] == -1).all()
    assert sorted(found.object_id[coasting]) == [3, 5, 7]
    np.testing.assert_array_equal(found.hits[found.frame == 3], 4)


def test_tracks_of_neutral_objects_are_left_out(tmp_path: Path) -> None:
    scene = make_scene()
    neutral = replace(scene.truth, neutral=scene.truth.object_id == 7)
    found = windows_of_scenes(tmp_path, replace(scene, truth=neutral))
    assert set(found.object_id.tolist()) == {3, 5}
    assert UNKNOWN not in found.object_id


def test_a_track_that_was_not_seen_in_its_whole_window_is_left_out(tmp_path: Path) -> None:
    """Two frames are kept: the walker is lost in frame 4, and in the last frame nothing is seen at all."""
    scene = make_scene(empty=(7,))
    seen = scene.detections
    seen = seen.select((seen.class_id == 0) | (seen.frame_of_rows < 4))
    rules = tuple(ClassParameters("hungarian", "center_distance", 2.0, 1, 9) for _ in range(2))
    card, task = load_card(write_card(tmp_path)), small_task()
    found = windows_of_scene(replace(scene, detections=seen), card, task, HypothesisTracker(parameters=rules))
    followed = {t: set(found.object_id[found.frame == t].tolist()) for t in range(8)}
    assert followed == {t: {3, 5, 7} if t < 5 else {3, 7} for t in range(8)}


def camera_at(place: tuple[float, float], looks: float, frames: int = 8) -> ImageField:
    """A camera at x y of the scene that looks along x (1) or against it (-1), 90 degrees wide."""
    f = 2000.0  # pixels to the metre, 1 m ahead
    into = np.array([[f * looks, -f * looks, 0.0, 0.0], [f / 2 * looks, 0.0, -f, 0.0], [looks, 0.0, 0.0, 0.0]])
    into[:, 3] = -into[:, 0] * place[0] - into[:, 1] * place[1]
    return ImageField(
        projection=np.tile(into, (frames, 1, 1)),
        height=np.zeros(frames),
        heading=np.zeros(frames),
        size=(4000, 2000),
        region=np.zeros((0, 4)),
        region_start=np.zeros(frames + 1, dtype=int),
        box_size=np.array([[4.0, 1.8, 1.5], [0.6, 0.6, 1.8]]),
    )


def test_tracks_of_no_object_are_negatives_only_where_labels_are_complete_and_in_view(tmp_path: Path) -> None:
    """The image is of the scene's frame of reference; tracks are in that of the observations, turned and moved."""
    scene = make_scene()
    ghosts = replace(scene, detections=replace(scene.detections, box=scene.detections.box + np.eye(7)[0] * 50))
    found = windows_of_scenes(tmp_path, ghosts)
    assert (found.object_id < 0).all()
    assert not found.future_known.any()
    in_sight = windows_of_scenes(tmp_path, replace(ghosts, image=camera_at((20, 10), 1)))
    assert in_sight.object_id.tolist() == found.object_id.tolist()
    unlabelled: list[dict[str, Any]] = [{"image": camera_at((20, 10), -1)}, {"truth_complete": False}]
    for changes in unlabelled:
        assert len(windows_of_scenes(tmp_path, replace(ghosts, **changes))) == 0


def test_a_scene_without_objects_has_no_windows(tmp_path: Path) -> None:
    found = windows_of_scenes(tmp_path, bare_scene(), make_scene())
    assert (found.scene == 1).all()
    assert found.surroundings.frames == 3 + 8
    np.testing.assert_array_equal(found.moment, found.frame + 3)
    np.testing.assert_array_equal(found.surroundings.before, [0, 1, 2, *range(8)])


@pytest.mark.parametrize("truth", [False, True])
def test_windows_do_not_cross_a_hole_in_time(truth: bool, tmp_path: Path) -> None:
    clip = replace(make_scene(empty=(6,)), ego=np.zeros((8, 4)))
    whole, apart = (
        windows_of_scenes(tmp_path, *scenes, truth=truth) for scenes in ([end_to_end([clip, clip], 0.2)], [clip, clip])
    )
    for name in set(BY_WINDOW) - {"scene", "frame"}:
        np.testing.assert_array_equal(getattr(whole, name), getattr(apart, name), err_msg=name)
    np.testing.assert_array_equal(whole.surroundings.before, apart.surroundings.before)


def test_windows_hold_the_lanes_of_their_frames(tmp_path: Path) -> None:
    card = load_card(write_card(tmp_path, CARD.replace("[source]", "lanes = true\n[source]").replace("kitti", "files")))
    center = np.array([[15.0, 12.0], [90.0, 12.0]])
    scene = replace(make_scene(), lanes=(Lane(center, center, center),))
    seen = concatenate(
        [windows_of_scene(scene, card, small_task(), HypothesisTracker(1)) for _ in range(2)]
    ).surroundings
    shown = make_feed(scene, LocalFrame.of(scene), small_task(), card).observe(3)
    assert shown["lane_valid"].any()
    for name, value in seen.lanes_at(8 + 3).items():
        np.testing.assert_array_equal(value, shown[name])
    assert windows_of_scenes(tmp_path, scene).surroundings.lanes == {}


def test_folds_are_whole_scenes(tmp_path: Path) -> None:
    found = windows_of_scenes(tmp_path, *(make_scene(name) for name in "abcd"))
    learnt, away = found.split((1, 4))
    assert len(set(away.scene.tolist())) == 1
    assert not set(away.scene.tolist()) & set(learnt.scene.tolist())
    held = [set(found.split((number, 4))[1].scene.tolist()).pop() for number in (1, 2, 3, 4)]
    assert sorted(held) == [0, 1, 2, 3]
    with pytest.raises(MtpBenchError, match="4 scenes cannot be cut into 5 folds"):
        found.split((1, 5))


def test_a_fold_takes_a_scene_out_of_all_envs_that_show_it(tmp_path: Path) -> None:
    one = windows_of_scenes(tmp_path, *(make_scene(name) for name in "abcd"))
    both = concatenate([one, replace(one, task=small_task(env_id="MTP-SmallRaw-v0"), envs=("MTP-SmallRaw-v0",))])
    for number in (1, 2, 3, 4):
        parts = both.split((number, 4))
        learnt, away = ({both.names[scene] for scene in part.scene.tolist()} for part in parts)
        (name,) = {one.names[scene] for scene in one.split((number, 4))[1].scene.tolist()}
        assert (away, len(learnt)) == ({f"MTP-Small-v0 {name}", f"MTP-SmallRaw-v0 {name}"}, 6)


def test_from_a_data_root(tmp_path: Path) -> None:
    card, options = write_card(tmp_path), RunOptions(write_kitti(tmp_path), split="val")
    first = windows(card, "val", 2, options=options)
    own = windows(card, "val", HypothesisTracker(2), options=options)
    np.testing.assert_array_equal(first.future, own.future)
    named = windows(card, "val", 2, first.names * 2, options=options)
    assert named.names == first.names, "no scene is learnt twice"
    wrong: dict[str, Any] = {"scene 'nowhere'": ["nowhere"], "number of": {"one"}, "a whole number": True}
    for message, scenes in wrong.items():
        with pytest.raises(MtpBenchError, match=message):
            windows(card, "val", 1, scenes=scenes, options=options)
