"""Files and folders that appear complete or not at all, and what a killed writer leaves."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.errors import MtpBenchError
from mtp_bench.files import content_digest, remove_leftovers, require_folder, whole_folder
from mtp_bench.sources.cache import read_arrays, write_arrays
from tests.support.broken_files import cut_head, flips

ARRAYS = {"box": np.arange(14.0).reshape(2, 7), "name": np.array(["car"])}
LATIN = os.fsdecode(b"caf\xe9")  # no name in UTF-8


def fill(path: Path, text: str) -> None:
    with whole_folder(path) as part:
        (part / "said").write_text(text)


def said(path: Path) -> str:
    return (path / "said").read_text()


@pytest.mark.parametrize("brief", [True, False])
def test_one_other_byte_in_the_cache_is_no_error(brief: bool, tmp_path: Path) -> None:
    path = tmp_path / "kept.npz"
    write_arrays(path, ARRAYS, brief)
    broken = 0
    for place in flips(path):
        arrays = read_arrays(path)
        broken += arrays is None
        if arrays is not None:  # a byte that says nothing of the arrays, such as of the time of writing
            assert arrays.keys() == ARRAYS.keys()
            for name, array in arrays.items():
                np.testing.assert_array_equal(array, ARRAYS[name], err_msg=f"byte {place}")
    assert broken > 200


def test_a_cut_head_in_the_cache_is_no_error(tmp_path: Path) -> None:
    write_arrays(tmp_path / "kept.npz", ARRAYS)
    cut_head(tmp_path / "kept.npz", "box")
    assert read_arrays(tmp_path / "kept.npz") is None


def test_a_folder_behind_a_link_is_replaced_and_the_link_stays(tmp_path: Path) -> None:
    target, link = tmp_path / "disk" / "runs", tmp_path / "out"
    target.mkdir(parents=True)
    (target / "old").touch()
    link.symlink_to(target)
    fill(link, "new")
    assert link.is_symlink()
    assert [path.name for path in target.iterdir()] == ["said"]
    assert said(link) == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]
    assert [path.name for path in target.parent.iterdir()] == ["runs"]


def test_a_link_to_nothing_is_filled(tmp_path: Path) -> None:
    (tmp_path / "out").symlink_to(Path("disk", "runs"))
    fill(tmp_path / "out", "new")
    assert said(tmp_path / "disk" / "runs") == "new"
    assert (tmp_path / "out").is_symlink()


def test_a_link_to_where_nothing_can_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "out").symlink_to(tmp_path / "file" / "runs")
    with pytest.raises(MtpBenchError, match="file is a file, expected a folder"):
        require_folder(tmp_path / "out")


def killed(folder: Path) -> Path:
    """What is left of ``folder`` where its writer is killed between the two steps of replacing it."""
    part = folder.with_name(f".{folder.stem}.7.0a.part{folder.suffix}")
    fill(part, "new")
    return folder.rename(part.with_name(f"{part.name}.earlier"))


@pytest.mark.parametrize("linked", [False, True])
def test_the_only_copy_comes_back_from_a_killed_replacement(linked: bool, tmp_path: Path) -> None:
    real = path = tmp_path / "a.rollouts"
    if linked:
        real = tmp_path / "disk" / "a"
        real.parent.mkdir()
        path.symlink_to(real)
    fill(path, "old")
    killed(real)
    remove_leftovers(path)
    assert said(path) == "old"
    assert list(real.parent.glob(".*")) == []


def test_leftovers_go_where_the_folder_is_there(tmp_path: Path) -> None:
    path = tmp_path / "a.rollouts"
    fill(path, "old")
    killed(path)
    fill(path, "new")
    (tmp_path / ".b.7.0a.part.rollouts").mkdir()  # of another one
    remove_leftovers(path, tmp_path / "a.json")
    assert said(path) == "new"
    assert sorted(each.name for each in tmp_path.iterdir()) == [".b.7.0a.part.rollouts", "a.rollouts"]


def test_names_of_any_bytes_have_a_digest(tmp_path: Path) -> None:
    (tmp_path / "Zürich.txt").write_bytes(b"one")
    content = f"Zürich.txt|{hashlib.sha256(b'one').hexdigest()}\n"
    assert content_digest(tmp_path) == hashlib.sha256(content.encode()).hexdigest()
    (tmp_path / LATIN).write_bytes(b"two")
    first = content_digest(tmp_path)
    (tmp_path / LATIN).rename(tmp_path / os.fsdecode(b"caf\xe8"))
    assert content_digest(tmp_path) != first
