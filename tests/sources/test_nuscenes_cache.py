"""The compact copy of nuScenes follows the files: changed, moved, broken, built by several; status of a root."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.sources import describe, open_source, prepare
from tests.support.nuscenes_root import DETECTIONS, PREDICTION, VERSION, edited, nuscenes_card, scene

LONG_AGO = 10**18  # ns
FILES = {"detections": DETECTIONS, "tables": f"nuscenes/{VERSION}/sample_annotation.json"}


def test_the_cache_is_used_until_a_file_changes(data: Path, own_cache: Path) -> None:
    prepare(nuscenes_card(), data)
    first = scene(data)
    made = {path: path.stat().st_ino for path in own_cache.rglob("*.npz")}
    assert len(made) == 9  # three scenes, their samples and an index; detections of three scenes and an index
    np.testing.assert_array_equal(scene(data).truth.box, first.truth.box)
    assert {path: path.stat().st_ino for path in own_cache.rglob("*.npz")} == made
    with edited(data / PREDICTION) as targets:
        del targets["scene-0001"], targets["scene-0003"]
    assert open_source(nuscenes_card(truth="targets"), data).names == ("scene-0301",)


@pytest.mark.parametrize("kind", FILES)
def test_a_file_changed_in_place_with_the_same_size_and_time(data: Path, own_cache: Path, kind: str) -> None:
    path = data / FILES[kind]
    os.utime(path, ns=(LONG_AGO, LONG_AGO))
    before = path.stat()
    scene(data)
    while path.stat().st_ctime_ns == before.st_ctime_ns:
        path.write_text(path.read_text().replace("10.0", "77.0"))
        os.utime(path, ns=(LONG_AGO, LONG_AGO))
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (before.st_size, LONG_AGO)
    found = scene(data)
    assert 77 in (found.detections.box[:, 0] if kind == "detections" else found.truth.box[:, 0])


@pytest.mark.parametrize(
    "content", [b"", b"no archive", None, {}, "file"], ids=["empty", "other", "gone", "edited", "folder"]
)
@pytest.mark.parametrize("name", ["scene-0003", "all.index", "all.samples"])
def test_a_broken_file_of_the_cache_is_made_again(
    data: Path, own_cache: Path, name: str, content: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr("mtp_bench.core.files.say_once", said.append)
    first, source = scene(data), open_source(nuscenes_card(), data)
    files = sorted(own_cache.rglob(f"{name}.npz"))
    for broken in files:
        if content is None:
            broken.unlink()
        elif isinstance(content, str):
            broken.unlink()
            broken.mkdir()
            (broken / content).touch()
        elif isinstance(content, bytes):
            broken.write_bytes(content)
        else:
            with np.load(broken) as file:
                arrays = {key: file[key] for key in file.files}
            np.savez(broken, **{**arrays, "box": np.ones((2, 7))})
    for again in (source.load("scene-0003"), scene(data)):
        np.testing.assert_array_equal(again.truth.box, first.truth.box)
        np.testing.assert_array_equal(again.detections.box, first.detections.box)
    assert not list(own_cache.rglob("*.part"))
    needed = [] if name == "all.samples" else files  # it is needed where detections are read
    assert sorted(said) == [f"{file.parent} was damaged and is made anew" for file in needed]


def test_many_may_build_at_once(data: Path, own_cache: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        boxes = list(pool.map(lambda _: scene(data).detections.box, range(8)))
    for box in boxes:
        np.testing.assert_array_equal(box, boxes[0])
    assert len(list(own_cache.rglob("*.npz"))) == 9


def test_the_cache_names_no_folder_of_the_machine(data: Path, own_cache: Path) -> None:
    scene(data)
    for path in (path for path in own_cache.rglob("*") if path.is_file()):
        assert str(data).encode() not in path.read_bytes()


def test_status_names_missing_and_wrong_files(data: Path) -> None:
    status = describe(nuscenes_card(), data)
    assert (status.usable, status.root) == (True, data / "nuscenes")
    missing: dict[str, dict[str, Any]] = {
        "has no folder 'v1.0-trainval'; found: v1.0-mini": {"version": "v1.0-trainval"},
        "has no file x*.json; found: megvii_all.json": {"detector": "x"},
        "no file or folder none.json": {"detections": "none.json", "detections_sha256": "0" * 64},
    }
    for text, source in missing.items():
        assert text in describe(nuscenes_card(**source), data).missing[0]
    assert "no scene of split 'mini_val'" in describe(nuscenes_card(split="mini_val"), data).problems[0]
    with edited(data / DETECTIONS) as content:
        del content["results"]["scene-0003-t0"]
    assert "no entry for sample 'scene-0003-t0'" in describe(nuscenes_card(), data).problems[0]
    with edited(data / f"nuscenes/{VERSION}/sample.json") as records:
        records[1]["timestamp"] = -1
    assert "sample.json" in describe(nuscenes_card(), data).problems[0]
    (data / PREDICTION).unlink()
    assert "prediction_scenes.json" in describe(nuscenes_card(truth="targets"), data).missing[0]
