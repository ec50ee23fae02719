"""Files and folders that appear complete or not at all, and what a killed writer leaves."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.core.errors import MtpBenchError
from mtp_bench.core.files import remove_leftovers, require_folder, whole_file, whole_folder, write_text
from mtp_bench.sources.cache import read_arrays, write_arrays
from tests.support.broken_files import cut_head, flips

ARRAYS = {"box": np.arange(14.0).reshape(2, 7), "name": np.array(["car"])}


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
    assert ([path.name for path in target.iterdir()], said(link)) == (["said"], "new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]
    assert [path.name for path in target.parent.iterdir()] == ["runs"]


def test_a_link_to_where_nothing_can_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "out").symlink_to(tmp_path / "file" / "runs")
    with pytest.raises(MtpBenchError, match="file is a file, expected a folder"):
        require_folder(tmp_path / "out")


def test_a_failed_replacement_leaves_the_earlier_folder(tmp_path: Path) -> None:
    path = tmp_path / "a.rollouts"
    fill(path, "old")
    with pytest.raises(RuntimeError), whole_folder(path):
        raise RuntimeError
    assert (said(path), [each.name for each in tmp_path.iterdir()]) == ("old", ["a.rollouts"])


def test_leftovers_of_killed_writers_go(tmp_path: Path) -> None:
    fill(tmp_path / "a.rollouts", "old")
    for name in (".a.7.0a.part.rollouts", ".b.7.0a.part.rollouts"):
        (tmp_path / name).mkdir()
    (tmp_path / ".a.7.0b.part.json").touch()
    remove_leftovers(tmp_path / "a.rollouts", tmp_path / "a.json")
    assert sorted(each.name for each in tmp_path.iterdir()) == [".b.7.0a.part.rollouts", "a.rollouts"]


def in_whole(path: Path, text: str) -> None:
    with whole_file(path) as part:
        part.write_text(text)


@pytest.mark.parametrize("write", [write_text, in_whole])
def test_a_device_or_a_pipe_is_never_replaced(tmp_path: Path, write: Callable[[Path, str], None]) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(MtpBenchError, match=r"cannot write .*pipe: it is not an ordinary file; choose another name"):
        write(pipe, "text")
    assert pipe.is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]
