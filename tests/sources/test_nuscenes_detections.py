"""nuScenes detections: submission files, the scenes that they cover, one clear error for everything that is wrong."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Detections
from mtp_bench.core.errors import DataError
from mtp_bench.sources import open_source
from tests.support.nuscenes_root import PREDICTION, SCENES, detection, edited, nuscenes_card, write_detections

T = "scene-0003-t1"
NAN = float("nan")


def stored(data: Path, name: str = "megvii_all.json") -> Path:
    return data / "nuscenes/detections" / name


def load(data: Path, classes: tuple[str, ...] = ("car", "pedestrian"), **source: Any) -> Detections:
    return open_source(nuscenes_card(classes, **source), data).load("scene-0003").detections


def test_velocity_and_score(data: Path) -> None:
    with edited(stored(data)) as content:
        content["results"][T] = [
            detection(T, velocity=[3.0, -1.0]), detection(T, velocity=[0, 0]), detection(T, velocity=[NAN, NAN]),
            detection(T, velocity=[0.0, 2.0], rotation=[2 ** -0.5 * 1.005, 0, 0, 2 ** -0.5 * 1.005], detection_score=1),
        ]  # fmt: skip
    found = load(data)
    rows = found.rows(1)
    np.testing.assert_array_equal(found.velocity[rows], [[3, -1], [NAN, NAN], [NAN, NAN], [0, 2]])
    np.testing.assert_allclose(found.box[rows, 3], np.pi / 2)  # half a percent off a unit quaternion is rounding
    assert found.score[rows].tolist() == [0.5, 0.5, 0.5, 1.0]


def test_all_files_of_a_detector_are_used_and_other_samples_ignored(data: Path) -> None:
    write_detections(stored(data), SCENES[:2])
    write_detections(stored(data, "megvii_val.json"), ("scene-0003", "scene-0555"))
    stored(data, "other.json").write_text(json.dumps({"results": {T: "broken"}}))
    source = open_source(nuscenes_card(), data)
    assert [len(source.load(name).detections.box) for name in source.names] == [6, 6, 6]


def test_a_scene_may_be_spread_over_files(data: Path) -> None:
    with edited(stored(data)) as content:
        rest = {token: content["results"].pop(token) for token in (T, "scene-0003-t3")}
    stored(data, "megvii_a.json").write_text(json.dumps({"results": rest}))
    assert load(data).start.tolist() == [0, 2, 4, 6, 6]


def test_a_named_file_is_used_alone(data: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    write_detections(path)
    with edited(path) as content:
        content["results"][T] = [detection(T, x=11.0)]
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    card = nuscenes_card(detections=str(path), detector="mine", detections_sha256=digest)
    np.testing.assert_array_equal(open_source(card, data).load("scene-0003").detections.rows(1), slice(2, 3))
    assert open_source(card, data).load("scene-0003").detector == "mine, stored detections"
    other = nuscenes_card(detections=str(path), detector="mine", detections_sha256="0" * 64)
    with pytest.raises(DataError, match=rf"mine\.json has the sha256 {digest}, expected 0000"):
        open_source(other, data)
    with pytest.raises(DataError, match=r"sha256 0000.*--detections"):
        open_source(nuscenes_card(detections_sha256="0" * 64), data)
    with pytest.raises(DataError, match=r"none\.json, expected a JSON file"):
        open_source(nuscenes_card(detections="none.json", detections_sha256="0" * 64), data)


@pytest.mark.parametrize("number", ["Infinity", "-Infinity", "1e999"])
def test_a_number_without_end_names_its_sample(number: str, data: Path) -> None:
    with edited(stored(data)) as content:
        content["results"][T] = [detection(T), detection(T, velocity=[0, "number"])]
    stored(data).write_text(stored(data).read_text().replace('"number"', number))
    with pytest.raises(DataError, match=rf"megvii_all\.json, sample '{T}', \[1\]\.velocity\[1\]: "):
        load(data)


def test_flat_boxes_are_left_out_and_counted(data: Path) -> None:
    before = load(data)
    with edited(stored(data)) as content:
        content["results"][T] += [detection(T, size=size) for size in ([0, 1, 1], [1, -2, 1], [1, 1, 1e-9])]
    scene = open_source(nuscenes_card(), data).load("scene-0003")
    np.testing.assert_array_equal(scene.detections.box, before.box)
    assert scene.skipped == {"detection size not above 0": 3}


def test_scenes_that_are_not_covered(data: Path) -> None:
    write_detections(stored(data), SCENES[1:])
    expected = (
        r"megvii_all\.json: no entry for sample 'scene-0301-t0' of scene-0301: detections cover 2 of the 3 scenes; "
        r"choose another split with --split"
    )
    with pytest.raises(DataError, match=expected):
        open_source(nuscenes_card(), data)
    assert open_source(nuscenes_card(split="val"), data).names == ("scene-0003",)
    write_detections(stored(data), frames=3)
    with pytest.raises(DataError, match=r"sample 'scene-0001-t3' of scene-0001: "):
        open_source(nuscenes_card(), data)


def test_only_scenes_with_targets_need_detections(data: Path) -> None:
    with edited(data / PREDICTION) as targets:
        del targets["scene-0301"], targets["scene-0001"]
    write_detections(stored(data), ("scene-0003",))
    assert open_source(nuscenes_card(truth="targets"), data).names == ("scene-0003",)


def test_two_files_with_the_same_sample(data: Path) -> None:
    write_detections(stored(data, "megvii_val.json"), ("scene-0003",))
    with pytest.raises(DataError, match=r"megvii_all\.json and .*megvii_val\.json both have sample 'scene-0003-t0'"):
        open_source(nuscenes_card(), data)
    assert open_source(nuscenes_card(split="train"), data).names == ("scene-0301",)


def test_a_file_that_the_split_does_not_need_is_not_read(data: Path) -> None:
    write_detections(stored(data), ("scene-0003",))
    path = stored(data, "megvii_train.json")
    write_detections(path, SCENES[:2])
    path.write_text(path.read_text()[:-20])
    assert open_source(nuscenes_card(split="val"), data).names == ("scene-0003",)
    with pytest.raises(DataError, match=r"megvii_train\.json cannot be read as JSON: .*is the file cut off"):
        open_source(nuscenes_card(split="train"), data)


def test_quaternions_with_w_last_are_refused_and_a_single_tilted_box_is_not(data: Path) -> None:
    with edited(stored(data)) as content:
        content["results"][T] += [detection(T) for _ in range(30)]
        content["results"][T][-1].update(rotation=[0.0, 0.0, 0.6, 0.8])
    assert len(load(data).box) > 30
    with edited(stored(data)) as content:
        for box in (box for boxes in content["results"].values() for box in boxes[:3]):  # all but the 29 others
            box.update(rotation=[0.0, 0.0, 0.6, 0.8])
    with pytest.raises(DataError, match=r"rotation is \[0.0, 0.0, 0.6, 0.8\], expected w, .*: is w written last"):
        open_source(nuscenes_card(), data)
