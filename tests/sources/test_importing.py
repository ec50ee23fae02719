"""Imports: KITTI's text and nuScenes submissions as folders of own scenes, each with a card that runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import load_card, with_detections, with_split
from mtp_bench.errors import DataError, MtpBenchError
from mtp_bench.running.rollout_files import load_run
from mtp_bench.sources import load_scenes
from mtp_bench.sources.importing import KittiText, import_scenes, import_tracks, kitti_scenes
from mtp_bench.types import Rollout, Scene, StoredTracks
from tests.support.command_line import CommandLine
from tests.support.source_files import write

CLASSES = ("car", "pedestrian")
# frame id type truncated occluded alpha, image box, h w l, x y z of the bottom in camera axes, rotation_y
LABELS = [
    "0 4 Car 0 0 0 1 2 3 4 1.5 1.8 4 2 1.6 10 0",
    "1 4 Car 0 0 0 1 2 3 4 1.5 1.8 4 2 1.6 11 0",
    "1 5 Van 0 0 0 1 2 3 4 1.5 1.8 4 -6 1.6 11 0",
    "1 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -1000 -1000 -1000 -10",
]
RESULTS = [*(f"{line} {score}" for line, score in zip(LABELS, ("0.9", "-2.5", "0.3", "0"), strict=True))]


@pytest.fixture
def text(tmp_path: Path) -> KittiText:
    write(tmp_path / "labels" / "0003.txt", *LABELS)
    write(tmp_path / "det" / "0003.txt", *RESULTS, "2 -1 Pedestrian 0 0 0 1 2 3 4 1.7 0.6 0.6 2 1.6 10 0 0.1")
    return KittiText(tmp_path / "labels", tmp_path / "det")


def only(text: KittiText) -> Scene:
    (scene,) = kitti_scenes(text, CLASSES)
    return scene


def test_without_poses_every_frame_is_the_sensors_own(text: KittiText) -> None:
    scene = only(text)
    assert (scene.name, scene.frames, scene.detector) == ("0003", 3, "det, stored detections")
    np.testing.assert_allclose(scene.truth.box[0], [10, -2, -0.85, -np.pi / 2, 4, 1.8, 1.5])
    np.testing.assert_array_equal(scene.truth.start, [0, 1, 3, 3])
    np.testing.assert_array_equal(scene.truth.neutral, [False, False, True])
    np.testing.assert_array_equal(scene.detections.start, [0, 1, 2, 3])
    np.testing.assert_array_equal(scene.detections.score, [0.9, -2.5, 0.1])
    np.testing.assert_array_equal(scene.detections.class_id, [0, 0, 1])
    np.testing.assert_allclose(scene.time, [0, 0.1036, 0.2072])
    assert not scene.ego.any()


def test_poses_of_the_camera_bring_all_frames_into_one(text: KittiText, tmp_path: Path) -> None:
    forwards = [f"1 0 0 0 0 1 0 0 0 0 1 {z}" for z in (0, 5, 10, 15)]
    write(tmp_path / "poses" / "0003.txt", *forwards)
    scene = only(KittiText(text.labels, text.detections, poses=tmp_path / "poses", period=0.1))
    np.testing.assert_allclose(scene.ego[:, 0], [0, 5, 10, 15])
    np.testing.assert_allclose(scene.truth.box[:2, 0], [10, 16])
    np.testing.assert_allclose(scene.time, [0, 0.1, 0.2, 0.3])


def test_the_import_is_a_folder_with_a_card_that_runs(text: KittiText, tmp_path: Path, cli: CommandLine) -> None:
    given = ("--labels", text.labels, "--detections", text.detections)
    said = cli.ok("import", "kitti", *given, "-o", tmp_path / "my logs")
    path = tmp_path / "my logs" / "my-logs.toml"
    assert said.splitlines()[0] == f"1 scene and their card my-logs.toml in {tmp_path / 'my logs'}; next:"
    assert said.splitlines()[1] == f"mtp-bench run stp --env '{path}' -o runs/my-logs"
    card = load_card(path)
    assert (card.ego_motion, card.detector_name, card.task) == (False, "pointrcnn", load_card("MTP-KITTI-v0").task)
    (scene,) = load_scenes(card)
    assert scene.name == "0003"
    cli.ok("run", "stp", "--env", path, "-o", tmp_path / "run", "--jobs", 1)


def test_without_detections_the_next_command_simulates_them(text: KittiText, tmp_path: Path, cli: CommandLine) -> None:
    said = cli.ok("import", "kitti", "--labels", text.labels, "-o", tmp_path / "own")
    path = tmp_path / "own" / "own.toml"
    assert said.splitlines()[1] == f"mtp-bench run stp --env {path} --detector kitti_pointrcnn -o runs/own"
    cli.ok("run", "stp", "--env", path, "--detector", "kitti_pointrcnn", "-o", tmp_path / "run", "--jobs", 1)


def test_a_rate_that_the_card_has_not_is_said_before_anything_is_written(
    text: KittiText, tmp_path: Path, cli: CommandLine
) -> None:
    error = cli("import", "kitti", "--labels", text.labels, "--rate", 5, "-o", tmp_path / "own").error
    assert error.startswith("scene '0003': frames are 0.2 s apart, but MTP-KITTI-v0 has 10 frames per second: take a ")
    assert not (tmp_path / "own").exists()
    given = ("--labels", text.labels, "--rate", 5, "--env", "MTP-KITTI-5Hz-v0")
    cli.ok("import", "kitti", *given, "-o", tmp_path / "own")


@pytest.mark.parametrize("error", [DataError, KeyboardInterrupt])
def test_a_failed_import_leaves_nothing(error: type[BaseException], text: KittiText, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "own"

    def scenes() -> Iterator[Scene]:
        yield only(text)
        raise error

    with pytest.raises(error):
        import_scenes(scenes(), load_card("MTP-KITTI-v0"), folder)
    assert list(folder.parent.iterdir()) == []
    _, path = import_scenes(kitti_scenes(text, CLASSES), load_card("MTP-KITTI-v0"), folder)
    assert sorted(each.name for each in folder.iterdir()) == ["0003", "own.toml"]
    assert path == folder / "own.toml"


def test_a_failed_import_of_tracks_leaves_nothing(text: KittiText, tmp_path: Path) -> None:
    scene = only(text)
    seen = scene.detections
    tracked = replace(scene, tracks=StoredTracks(**vars(seen), object_id=np.arange(len(seen.box))))

    class Source:
        names = ("one", "two")

        def load(self, name: str) -> Scene:
            if name == "two":
                raise DataError("broken")
            return tracked

    with pytest.raises(DataError, match="broken"):
        import_tracks(Source(), Source.names, load_card("MTP-KITTI-v0"), tmp_path / "new" / "tables")
    assert list((tmp_path / "new").iterdir()) == []


MISTAKES = {
    "no labels": ({"labels": "none"}, "none has no labels, expected a file for each sequence, such as 0001.txt"),
    "half of GPS/IMU": ({"oxts": "oxts"}, "GPS/IMU data and its calibration belong together"),
    "two kinds of poses": (
        {"oxts": "a", "calib": "b", "poses": "c"},
        "poses are given twice, by --oxts and by --poses",
    ),
    "no detections": ({"detections": "none"}, "no file .*none/0003.txt"),
}


@pytest.mark.parametrize(("changes", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake(changes: dict[str, str], message: str, text: KittiText, tmp_path: Path) -> None:
    named = {**vars(text), **{name: tmp_path / value for name, value in changes.items()}}
    with pytest.raises(MtpBenchError, match=message):
        list(kitti_scenes(KittiText(**named), CLASSES))


def test_a_mistake_in_a_file_of_detections(text: KittiText, tmp_path: Path) -> None:
    write(tmp_path / "det" / "0003.txt", RESULTS[0], RESULTS[1].replace("Car", "Cars"))
    with pytest.raises(DataError, match=r"0003\.txt, line 2: type 'Cars', expected one of Car, Van"):
        only(text)
    write(tmp_path / "det" / "0003.txt", *LABELS)
    with pytest.raises(DataError, match=r"0003\.txt, line 1: 17 columns, expected 18"):
        only(text)
    write(tmp_path / "det" / "0003.txt", RESULTS[0].replace("0 4", "99999999 4", 1))
    with pytest.raises(DataError, match="the last frame of 0003 is 99999999, expected 0 to 999999"):
        only(text)


@pytest.mark.data
def test_detections_of_kittis_text_are_those_of_the_original(tmp_path: Path, data_root: Path) -> None:
    """AB3DMOT's folders from elsewhere, and the same rows in the columns of the benchmark."""
    stored = data_root / "kitti_tracking" / "detections" / "pointrcnn"
    rows = []
    for code, kind in ((1, "Pedestrian"), (2, "Car"), (3, "Cyclist")):
        for line in (stored / kind / "0012.txt").read_text().splitlines():
            frame, told, *image, score, h, w, l, x, y, z, yaw, alpha = line.split(",")
            assert int(told) == code
            rows.append(" ".join([frame, "-1", kind, "0", "0", alpha, *image, h, w, l, x, y, z, yaw, score]))
    write(tmp_path / "mine" / "0012.txt", *rows)
    card = load_card("MTP-KITTI-v0")
    (original,) = load_scenes(card, data_root, ["0012"])
    digests = {card.digest}
    for folder in (stored, tmp_path / "mine"):
        other = with_detections(card, folder)
        (scene,) = load_scenes(other, data_root, ["0012"])
        for name in ("start", "box", "score", "class_id"):
            found, expected = (getattr(one.detections, name) for one in (scene, original))
            np.testing.assert_array_equal(found, expected)
        assert scene.detector == f"pointrcnn-{folder.name}, stored detections"
        digests.add(other.digest)
    assert len(digests) == 3


@pytest.mark.data
def test_a_nuscenes_submission_becomes_own_scenes(tmp_path: Path, data_root: Path, cli: CommandLine) -> None:
    file = data_root / "nuscenes" / "detections" / "centerpoint_mini_val.json"
    cli.ok("import", "nuscenes", file, "--split", "mini_val", "--data", data_root, "-o", tmp_path / "own")
    card = load_card(tmp_path / "own" / "own.toml")
    given = with_detections(with_split(load_card("MTP-nuScenes-mini-v0"), "mini_val"), file)
    for own, original in zip(load_scenes(card), load_scenes(given, data_root), strict=True):
        np.testing.assert_array_equal(own.detections.box, original.detections.box)
        np.testing.assert_array_equal(own.truth.box, original.truth.box)
    assert card.detector_name == given.detector_name == "megvii-centerpoint_mini_val"


@pytest.mark.data
def test_a_tracking_submission_becomes_tables_that_score_alike(
    tmp_path: Path, data_root: Path, cli: CommandLine
) -> None:
    env = ("--env", "MTP-nuScenes-mini-v0", "--split", "mini_val", "--data", data_root)
    cli.ok("run", "stp", *env, "-o", tmp_path / "stp", "--jobs", 1)
    file = tmp_path / "submission.json"
    cli.ok("export", tmp_path / "stp", "-o", file, "--data", data_root)
    said = cli.ok("import", "tracks", file, *env, "-o", tmp_path / "tables")
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == ["scene-0103.csv", "scene-0916.csv"]
    assert "of 2 scenes in" in said
    said_of = []
    for name, tracks in (("of_json", file), ("of_tables", tmp_path / "tables")):
        cli.ok("run", "given_tracks", *env, "--tracks", tracks, "-o", tmp_path / name, "--jobs", 1)
        said_of.append([_without_ids(rollout) for rollout in load_run(tmp_path / name).rollouts])
    assert said_of[0] == said_of[1]
    assert (
        "tables is not empty: choose another folder"
        in cli("import", "tracks", file, *env, "-o", tmp_path / "tables").error
    )


def _without_ids(rollout: Rollout) -> list[list[list[float]]]:
    """Tracks and forecasts as they stand in each frame, whatever their ids and order."""
    tracks = np.column_stack([rollout.tracks.frame_of_rows, rollout.track_class, rollout.track_box])
    said = rollout.forecast.reshape(len(rollout.object_box), -1)
    objects = np.column_stack([rollout.objects.frame_of_rows, rollout.object_box, rollout.object_confidence, said])
    return [sorted(rows.tolist()) for rows in (tracks, objects)]
