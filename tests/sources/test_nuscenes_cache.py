"""The compact copy of nuScenes is that of the files as they are: changed in place, moved, edited, broken."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.errors import DataError
from mtp_bench.sources import open_source
from mtp_bench.sources.nuscenes import folders
from mtp_bench.sources.nuscenes.folders import file_hash
from tests.support.nuscenes_root import VERSION, make_tables, nuscenes_card, scene, write_root, write_tables

pytestmark = pytest.mark.usefixtures("own_cache")

LONG_AGO = 10**18  # ns
FILES = {"detections": "nuscenes/detections/megvii_all.json", "tables": f"nuscenes/{VERSION}/sample_annotation.json"}


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """The files of the test count as old: their hashes are kept."""
    monkeypatch.setattr(folders, "_SETTLED", -1)


def stored_scene(own_cache: Path, kind: str) -> Path:
    """The copy of a scene of the tables or of the detections."""
    tables, detections = sorted(own_cache.rglob("scene-0003.npz"), key=lambda path: len(path.parent.name))
    return tables if kind == "tables" else detections


def rewrite(path: Path, old: str, new: str) -> None:
    """Change a file in place and restore its size and time; not within the tick of the clock of its last change."""
    before = path.stat().st_ctime_ns
    content = path.read_text().replace(old, new)
    while path.stat().st_ctime_ns == before:
        path.write_text(content)
        os.utime(path, ns=(LONG_AGO, LONG_AGO))


def test_hashes_are_kept(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = data / "nuscenes" / VERSION / "sensor.json"
    os.utime(path, ns=(LONG_AGO, LONG_AGO))
    read: list[int] = []
    fresh = file_hash(path, read.append)
    assert file_hash(path, read.append) == fresh
    assert len(read) == 2  # whatever its time says, it was changed just now: again, perhaps, within the clock's tick
    monkeypatch.setattr(folders, "_SETTLED", -1)
    assert [file_hash(path, read.append) for _ in range(3)] == [fresh] * 3
    assert len(read) == 3
    path.write_text(path.read_text() + " ")
    assert file_hash(path, read.append) != fresh


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize("kind", FILES)
def test_a_file_changed_in_place_with_the_same_size_and_time(data: Path, kind: str) -> None:
    path = data / FILES[kind]
    os.utime(path, ns=(LONG_AGO, LONG_AGO))
    size = path.stat().st_size
    scene(data)
    rewrite(path, "10.0", "77.0")
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (size, LONG_AGO)
    found = scene(data)
    assert 77 in (found.detections.box[:, 0] if kind == "detections" else found.truth.box[:, 0])


@pytest.mark.usefixtures("settled")
def test_another_root_moved_to_the_same_place(data: Path, tmp_path: Path) -> None:
    other = write_root(tmp_path / "other")
    rewrite(other / FILES["detections"], "10.0", "55.0")
    for path in (path for root in (data, other) for path in root.rglob("*.json")):
        os.utime(path, ns=(LONG_AGO, LONG_AGO))
    scene(data)
    shutil.rmtree(data)
    other.rename(data)
    assert scene(data).detections.box[0, 0] == 55


EDITS: dict[str, Callable[[dict[str, Any]], object]] = {
    "without a scene": lambda index: index["scenes"].pop("scene-0003"),
    "without counts": lambda index: index["scenes"].update({"scene-0003": {}}),
    "other counts": lambda index: index.update(instances=1),
    "without digest": lambda index: index.pop("digest"),
    "other digest": lambda index: index.update(digest=3),
}


@pytest.mark.parametrize("change", EDITS.values(), ids=EDITS)
def test_an_edited_index_is_not_believed(data: Path, own_cache: Path, change: Callable[[dict[str, Any]], None]) -> None:
    first = scene(data)
    indices = sorted(path for path in own_cache.rglob("index.json"))
    assert len(indices) == 2  # of the tables and the detections
    content = [path.read_text() for path in indices]
    for path in indices:
        index = json.loads(path.read_text())
        change(index)
        path.write_text(json.dumps(index))
    np.testing.assert_array_equal(scene(data).detections.box, first.detections.box)
    assert [path.read_text() for path in indices] == content


@pytest.mark.parametrize("content", ["{", "[" * 100_000, '{"scenes": ' + "9" * 5000 + "}", "[]", "{}"])
def test_an_index_that_cannot_be_read(data: Path, own_cache: Path, content: str) -> None:
    first = scene(data)
    for path in own_cache.rglob("index.json"):
        path.write_text(content)
    np.testing.assert_array_equal(scene(data).detections.box, first.detections.box)


@pytest.mark.parametrize("content", [b"", b"no archive", None, {}], ids=["empty", "other", "gone", "edited"])
@pytest.mark.parametrize("kind", FILES)
def test_a_broken_file_of_the_cache_is_built_again(data: Path, own_cache: Path, kind: str, content: Any) -> None:
    first, source, broken = scene(data), open_source(nuscenes_card(), data), stored_scene(own_cache, kind)
    if content is None:
        broken.unlink()
    elif isinstance(content, bytes):
        broken.write_bytes(content)
    else:
        with np.load(broken) as file:
            arrays = {name: file[name] for name in file.files}
        np.savez(broken, **{**arrays, "box": arrays["box"] + 1})
    for again in (source.load("scene-0003"), scene(data)):
        np.testing.assert_array_equal(again.truth.box, first.truth.box)
        np.testing.assert_array_equal(again.detections.box, first.detections.box)
    assert not list(own_cache.rglob("*.part"))


@pytest.mark.parametrize("kind", FILES)
def test_a_broken_file_is_not_built_from_other_sources(data: Path, own_cache: Path, kind: str) -> None:
    """The folder is named by the tables as they were; those of today belong in another one."""
    source = open_source(nuscenes_card(), data)
    broken = stored_scene(own_cache, kind)
    broken.write_bytes(b"")
    (data / FILES[kind]).write_text((data / FILES[kind]).read_text().replace("10.0", "77.0"))
    what = "the tables of v1.0-mini" if kind == "tables" else r".*megvii_all\.json"
    with pytest.raises(DataError, match=rf"scene-0003\.npz is broken, and {what} changed .*: open the source again"):
        source.load("scene-0003")
    assert broken.read_bytes() == b""
    assert 77 in np.concatenate([scene(data).truth.box[:, 0], scene(data).detections.box[:, 0]])


def test_a_table_that_vanishes(data: Path, own_cache: Path) -> None:
    source = open_source(nuscenes_card(), data)
    for path in own_cache.rglob("scene-0003.npz"):
        path.unlink()
    (data / FILES["tables"]).unlink()
    with pytest.raises(DataError, match=r"sample_annotation\.json cannot be read: No such file"):
        source.load("scene-0003")


def test_tables_repaired_after_an_error(data: Path) -> None:
    tables = make_tables()
    tables["sample"][0]["timestamp"] = -1
    write_tables(data, tables)
    with pytest.raises(DataError, match="timestamp is -1"):
        scene(data)
    write_tables(data, make_tables())
    assert len(scene(data).time) == 4
