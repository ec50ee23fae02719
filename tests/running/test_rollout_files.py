"""Rollouts on disk: complete or not at all, and every change is noticed."""

import contextlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from mtp_bench.core import Rollout
from mtp_bench.core.errors import MtpBenchError, RolloutError
from mtp_bench.env.rollouts import assemble, digest
from mtp_bench.running.rollout_files import RunInfo, differences, load_run, save_run, undone
from tests.support.broken_files import cut_head, flips
from tests.support.small_scenes import decode, empty_action, full_action, task

INFO = RunInfo(
    env_id="MTP-Small-v0", card_digest="0123456789abcdef", observe="detections", samples=4, split="val",
    keywords={"rigid_motion": False}, agent="echo", parameters={"noise": 0.5, "classes": ["car"]},
    submission_digest="ab", seed=3, definitions="2.0", versions={"numpy": "2"},
)  # fmt: skip


def make_rollout(name: str = "one", frames: int = 3) -> Rollout:
    full, empty = decode(full_action(task()), task()), decode(empty_action(task()), task())
    rollout = assemble(name, [full if t != 1 else empty for t in range(frames)], np.arange(frames))
    return replace(rollout, seconds=np.linspace(0.1, 0.2, frames))


def assert_equal(one: Rollout, other: Rollout) -> None:
    assert one.scene == other.scene
    for field in fields(Rollout):
        if field.name not in ("scene", "drive"):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
            assert getattr(one, field.name).dtype == getattr(other, field.name).dtype


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    rollouts = [make_rollout("one"), make_rollout("two/part 1", frames=1), make_rollout("..", frames=2)]
    save_run(tmp_path / "runs" / "echo", INFO, rollouts)
    run = load_run(tmp_path / "runs" / "echo")
    assert (run.info, [rollout.scene for rollout in run.rollouts]) == (INFO, ["one", "two/part 1", ".."])
    for got, want in zip(run.rollouts, rollouts, strict=True):
        assert_equal(got, want)
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["echo"]
    assert sorted(path.name for path in (tmp_path / "runs/echo").iterdir()) == [
        "%2E..npz", "one.npz", "run.json", "two%2Fpart%201.npz",
    ]  # fmt: skip


@given(arrays(np.int16, array_shapes(min_dims=4, max_dims=4, min_side=0, max_side=5)))
def test_differences_are_undone_to_the_bit(forecast: NDArray[np.int16]) -> None:
    found = undone(differences(forecast))
    assert (found.dtype, found.shape) == (forecast.dtype, forecast.shape)
    np.testing.assert_array_equal(found, forecast)


@pytest.mark.parametrize("names", [["thesis.tex"], ["run.json", "notes.txt"], ["one.npz"]], ids=str)
def test_a_folder_that_is_no_run_is_left_alone(names: list[str], tmp_path: Path) -> None:
    for name in names:
        (tmp_path / name).write_text("precious")
    with pytest.raises(RolloutError, match="it is not a run: choose another folder"):
        save_run(tmp_path, INFO, [make_rollout()])
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert all((tmp_path / name).read_text() == "precious" for name in names)


def test_an_earlier_run_is_replaced_unless_writing_fails(tmp_path: Path) -> None:
    save_run(tmp_path / "run", INFO, [make_rollout("one"), make_rollout("two")])
    save_run(tmp_path / "run", INFO, [make_rollout("three")])

    def failing() -> Any:
        yield make_rollout("two")
        raise OSError(28, "No space left on device")

    with pytest.raises(MtpBenchError, match="No space left on device"):
        save_run(tmp_path / "run", INFO, failing())
    assert [rollout.scene for rollout in load_run(tmp_path / "run").rollouts] == ["three"]
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["run.json", "three.npz"]


def edit_json(change: Callable[[Any], Any]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        content = json.loads((folder / "run.json").read_text())
        change(content)
        (folder / "run.json").write_text(json.dumps(content))

    return apply


def edit_array(name: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        arrays = dict(np.load(folder / "one.npz"))
        arrays[name] = change(arrays[name])
        np.savez_compressed(folder / "one.npz", allow_pickle=False, **arrays)

    return apply


def cut(name: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_bytes(
        (folder / name).read_bytes()[: (folder / name).stat().st_size // 2]
    )


def flip_byte(folder: Path) -> None:
    content = bytearray((folder / "one.npz").read_bytes())
    content[content.index(b"forecast.npy") + 60] ^= 0xFF  # inside of what is packed
    (folder / "one.npz").write_bytes(bytes(content))


def without(name: str, content: bytes = b"") -> Callable[[Path], None]:
    """Takes an array out; ``content``: what stands in its place."""

    def apply(folder: Path) -> None:
        arrays = dict(np.load(folder / "one.npz"))
        del arrays[name]
        np.savez_compressed(folder / "one.npz", allow_pickle=False, **arrays)
        if content:
            with zipfile.ZipFile(folder / "one.npz", "a") as archive:
                archive.writestr(f"{name}.npy", content)

    return apply


def encrypt(folder: Path) -> None:
    content = bytearray((folder / "one.npz").read_bytes())
    for head, flags in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        content[content.index(head) + flags] |= 1
    (folder / "one.npz").write_bytes(bytes(content))


def pickled(folder: Path) -> None:
    arrays = dict(np.load(folder / "one.npz"))
    arrays["track_id"] = np.array([{}], dtype=object)
    np.savez_compressed(folder / "one.npz", **arrays)


SPOILED: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no run.json": (lambda folder: (folder / "run.json").unlink(), "no run.json there"),
    "no scene": (lambda folder: (folder / "one.npz").unlink(), r"one\.npz is missing"),
    "run.json cut": (cut("run.json"), r"run\.json: not valid JSON"),
    "unknown key": (edit_json(lambda content: content.update(scene=1)), "unknown key 'scene': did you mean 'scenes'"),
    "earlier format": (
        edit_json(lambda content: content.update(format=1)),
        "has the format 1, and this version of the library reads format 3: run the agent again",
    ),
    "frames changed": (edit_json(lambda content: content["scenes"][0].update(frames=4)), "track_start has shape"),
    "scene cut": (cut("one.npz"), "truncated or not a rollout"),
    "byte flipped": (flip_byte, r"one\.npz"),
    "array missing": (without("member"), "member"),
    "no array inside": (without("forecast", b"no array"), "truncated or not a rollout"),
    "encrypted": (encrypt, "truncated or not a rollout .*is encrypted"),
    "head cut": (lambda folder: cut_head(folder / "one.npz", "track_box"), "truncated or not a rollout"),
    "pickle inside": (pickled, "truncated or not a rollout"),
    "box changed": (edit_array("track_box", lambda array: array + np.float32(0.01)), "it was changed after the run"),
    "dtype changed": (edit_array("track_class", lambda array: array.astype(np.int32)), "track_class has dtype int32"),
    "rows gone": (edit_array("track_id", lambda array: array[1:]), "track_box has shape"),
    "frames out of order": (edit_array("object_start", lambda array: array[::-1]), "object_start does not divide"),
}


@pytest.mark.parametrize("case", SPOILED, ids=str)
def test_a_spoiled_run_is_one_clear_error(case: str, tmp_path: Path) -> None:
    spoil, text = SPOILED[case]
    save_run(tmp_path / "run", INFO, [make_rollout("one")])
    spoil(tmp_path / "run")
    with pytest.raises(RolloutError, match=text):
        load_run(tmp_path / "run")


def test_one_other_byte_is_no_traceback(tmp_path: Path) -> None:
    save_run(tmp_path / "run", INFO, [make_rollout("one")])
    for _ in flips(tmp_path / "run" / "one.npz", 200):
        with contextlib.suppress(RolloutError):
            load_run(tmp_path / "run")


def test_the_digest_is_of_all_values_but_times() -> None:
    rollout = make_rollout()
    for field in fields(Rollout):
        if field.name not in ("scene", "seconds", "drive"):
            array = getattr(rollout, field.name)
            changed = ~array if array.dtype == bool else np.where(np.isfinite(array), array + 1, array)
            assert digest(replace(rollout, **{field.name: changed})) != digest(rollout), field.name
    assert digest(replace(rollout, scene="other")) != digest(rollout)
    box, same = (
        rollout.track_box,
        dict[str, Any](seconds=rollout.seconds + 1, track_id=rollout.track_id.astype(np.int32)),
    )
    assert digest(replace(rollout, track_box=np.asfortranarray(box), **same)) == digest(rollout)
    zeros = [replace(rollout, track_box=np.where(box == 0, np.float32(zero), box)) for zero in (-0.0, 0.0)]
    assert digest(zeros[0]) == digest(zeros[1])


def test_the_digest_stays() -> None:
    assert digest(make_rollout()) == "61a4a7ede357ccfb8cdb1bdff89c2cff6c56370c87777eb5e34d166b9c048b1c"
