"""The compact copy of nuScenes: when it is made, what happens to broken files; and what `mtp-bench data` says."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources import describe, open_source, prepare
from mtp_bench.sources.nuscenes import folders
from tests.support.nuscenes_root import (
    PREDICTION,
    SCENES,
    VERSION,
    detection,
    make_detections,
    make_tables,
    make_targets,
    nuscenes_card,
    sample,
    scene,
    write_json,
    write_tables,
)


def test_the_cache_is_used_until_a_file_changes(data: Path, own_cache: Path) -> None:
    first = scene(data)
    made = {path: path.stat().st_ino for path in own_cache.rglob("*.npz")}
    assert len(made) == 7  # three scenes and the tokens of all samples; detections of three scenes
    np.testing.assert_array_equal(scene(data).truth.box, first.truth.box)
    assert {path: path.stat().st_ino for path in own_cache.rglob("*.npz")} == made

    tables = make_tables()
    tables["sample_annotation"][0]["translation"] = [11.0, 0.0, 1.0]
    write_tables(data, tables)
    assert scene(data, "scene-0301").truth.box[0, 0] == 11
    content = make_detections()
    content["results"][sample("scene-0003", 0)] = [detection(sample("scene-0003", 0), x=12.0)]
    write_json(data / "nuscenes/detections/megvii_all.json", content)
    assert scene(data).detections.box[0, 0] == 12
    write_json(data / PREDICTION, make_targets(SCENES[:1]))
    assert open_source(nuscenes_card(truth="targets"), data).names == ("scene-0301",)
    assert not list(own_cache.rglob("*.part"))


def test_a_cache_that_cannot_be_written(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "file"))
    with pytest.raises(DataError, match=r"cannot be kept in .*file.nuscenes: Not a directory; MTP_BENCH_CACHE names"):
        open_source(nuscenes_card(), data)


def test_many_may_build_at_once(data: Path, own_cache: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        boxes = list(pool.map(lambda _: scene(data).detections.box, range(8)))
    for box in boxes:
        np.testing.assert_array_equal(box, boxes[0])
    assert len(list(own_cache.rglob("*.npz"))) == 7
    assert not list(own_cache.rglob("*.part"))


def test_the_cache_names_no_folder_of_the_machine(data: Path, own_cache: Path) -> None:
    scene(data)
    for path in (path for path in own_cache.rglob("*") if path.is_file() and path.parent.name != "stamps"):
        assert str(data).encode() not in path.read_bytes()


def test_prepare_tells_its_pieces(data: Path, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    totals: list[int] = []
    names: list[str] = []
    prepare(nuscenes_card(), data, started=totals.append, progress=names.append)
    assert totals == [len(names)]
    assert {"sample_annotation.json", VERSION, "megvii_all.json"} <= set(names)
    monkeypatch.setattr(folders, "_SETTLED", -1)  # as if the files were not new
    prepare(nuscenes_card(), data, started=totals.append, progress=names.append)  # hashes again, reads nothing
    assert totals == [len(names) // 2] * 2
    prepare(nuscenes_card(), data, started=totals.append, progress=names.append)
    assert totals[2:] == [0]


def test_status(data: Path) -> None:
    status = describe(nuscenes_card(), data)
    assert (status.usable, status.verified, status.root) == (True, False, data / "nuscenes")
    assert {check.what: (check.found, check.expected) for check in status.checks} == {
        "scenes": (3, 10), "keyframes": (12, 404),
        "prediction targets of mini_train": (0, 742), "prediction targets of mini_val": (0, 61),
    }  # fmt: skip
    assert status.notes[:2] == [
        "v1.0-mini has the splits train (1 scene), train_val (1 scene), val (1 scene)",
        "detections: megvii_all.json",
    ]
    assert "CC BY-NC-SA 4.0" in status.about.licence
    assert "Caesar" in status.about.citation


def test_status_names_what_is_missing(data: Path) -> None:
    other = describe(nuscenes_card(version="v1.0-trainval", detector="x"), data)
    assert other.missing == ["v1.0-trainval/", "detections/x*.json"]
    assert other.notes == ["versions found: v1.0-mini"]
    (data / PREDICTION).unlink()
    (data / "nuscenes/detections/megvii_all.json").unlink()
    status = describe(nuscenes_card(truth="targets"), data)
    assert status.missing == ["maps/prediction/prediction_scenes.json", "detections/megvii*.json"]
    assert [check.found for check in status.checks] == [3, 12]
    (line,) = describe(nuscenes_card(detections_file="none.json", detections_sha256="0" * 64), data).missing
    assert "no file none.json" in line
    (data / "nuscenes" / VERSION / "scene.json").unlink()
    assert describe(nuscenes_card(), data).missing == ["v1.0-mini/scene.json", "detections/megvii*.json"]


def test_status_names_what_is_wrong(data: Path) -> None:
    status = describe(nuscenes_card(split="mini_val"), data)
    assert (status.missing, status.problems) == (["scenes of split 'mini_val' in v1.0-mini/"], [])
    write_json(data / "nuscenes/detections/megvii_all.json", make_detections(SCENES[:2]))
    (problem,) = describe(nuscenes_card(), data).problems
    assert "no entry for sample 'scene-0003-t0'" in problem
    tables = make_tables()
    tables["sample"][1]["timestamp"] = -1
    write_tables(data, tables)
    status = describe(nuscenes_card(), data)
    assert (status.usable, status.checks) == (False, [])
    assert "sample.json" in status.problems[0]
