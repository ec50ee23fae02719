"""The gateway with agents that keep the rules: the same rollout as in one process, and what is told about the run."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.core.errors import MtpBenchError, SubmissionError, UnknownNameError
from mtp_bench.core.notice import Progress
from mtp_bench.core.parallel import Workers
from mtp_bench.env.rollouts import digest
from mtp_bench.judge import SceneRun, run_isolated, run_isolated_scenes
from mtp_bench.judge.gateway.exchange import lengthened
from mtp_bench.judge.gateway.run import seal_start
from mtp_bench.judge.gateway.wire import PREFIX, WireError, arrays_of, as_numbers, encode, header_of
from mtp_bench.running.playing import jobs_of, run_jobs
from tests.support.hostile import submission

ENV = "MTP-Intersection-v0"


def in_process(name: str, env_id: str, keywords: dict[str, Any], scene: str, seed: int = 0) -> str:
    return digest(run_jobs(jobs_of(load_submission(name), env_id, keywords, [scene], seed))[0])


def test_the_rollout_is_that_of_one_process() -> None:
    scene = MTPEnv(ENV).scene_names[0]
    run = run_isolated("stp", ENV, {}, scene)
    assert (run.status, run.reason, run.malformed) == ("finished", "", 0)
    assert digest(run.rollout) == in_process("stp", ENV, {}, scene)
    assert len(run.rollout.object_box) > 0
    assert 0 < run.started < 120
    assert (run.rollout.seconds > 0).all()
    assert len(run.seal) == 64


KEYWORDS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "turned": {"rigid_motion": True},
    "other sizes": {"samples": 6, "max_tracks": 3},
}


@pytest.mark.parametrize("keywords", KEYWORDS.values(), ids=KEYWORDS)
@pytest.mark.parametrize("name", ["mtp", "gt_tracks"])
def test_settings_of_the_env_are_kept(card: str, kitti: str, name: str, keywords: dict[str, Any]) -> None:
    given = {"data": kitti, **keywords}
    run = run_isolated(name, card, given, "0006", seed=3)
    assert run.status == "finished", run.reason
    assert digest(run.rollout) == in_process(name, card, given, "0006", seed=3)


def test_parameters_stand_in_place_of_the_manifests(card: str, kitti: str) -> None:
    runs = [run_isolated("mtp", card, {"data": kitti}, "0006", parameters=given) for given in (None, {"hypotheses": 1})]
    most = [int(np.isfinite(run.rollout.hypothesis_log_weight).sum(axis=1).max()) for run in runs]
    assert ([run.status for run in runs], most[1]) == (["finished", "finished"], 1)


def test_several_processes_give_what_one_gives(card: str, kitti: str) -> None:
    runs: list[list[SceneRun]] = []
    for workers in (1, 2):
        done = list[str]()
        scenes = ["0006", "0001"]
        how: Any = {"workers": Workers(workers), "progress": Progress(done=done.append)}
        runs.append(run_isolated_scenes("stp", card, {"data": kitti}, scenes=scenes, **how))
        assert sorted(done) == sorted(scenes)
    assert [run.seal for run in runs[0]] == [run.seal for run in runs[1]]
    assert [digest(run.rollout) for run in runs[0]] == [digest(run.rollout) for run in runs[1]]


def test_an_agent_that_cannot_be_built_says_why(card: str, kitti: str) -> None:
    run = run_isolated("mtp", card, {"data": kitti}, "0006", parameters={"hypothesis": 5})
    assert run.status == "crashed"
    assert "did you mean 'hypotheses'?" in run.reason
    assert run.rollout.frames == 7
    assert len(run.rollout.object_box) == len(run.rollout.track_box) == 0


def test_what_the_user_can_mend_is_an_error(card: str, kitti: str, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown scene '0007'"):
        run_isolated("stp", card, {"data": kitti}, "0007")
    with pytest.raises(UnknownNameError, match="unknown submission"):
        run_isolated("spt", card, {"data": kitti}, "0006")
    around = submission(tmp_path / "around")
    shutil.copytree(kitti, around / "data")
    with pytest.raises(SubmissionError, match="which agents see: move the data elsewhere"):
        run_isolated(around, card, {"data": str(around / "data")}, "0006")
    with pytest.raises(MtpBenchError, match="workers is 0"):
        run_isolated_scenes("stp", card, {"data": kitti}, scenes=["0006"], workers=Workers(0))


def test_the_seal_starts_with_card_scene_and_seed() -> None:
    starts = {seal_start("a", "s", 0), seal_start("b", "s", 0), seal_start("a", "t", 0), seal_start("a", "s", 1)}
    assert len(starts) == 4


def test_an_unanswered_frame_and_an_empty_answer_have_different_seals() -> None:
    actions: tuple[Any, ...] = (None, {}, {"track_id": np.zeros(2)}, {"track_id": np.zeros((2, 1))})
    seals = {lengthened(seal_start("a", "s", 0), 0, action) for action in actions}
    assert len(seals) == len(actions)
    assert lengthened(seal_start("a", "s", 0), 1, None) not in seals


ARRAYS = {
    "numbers": np.arange(6, dtype=np.float32).reshape(2, 3), "turned": np.arange(6.0).reshape(2, 3).T,
    "scalar": np.float64(3.5), "empty": np.zeros((0, 7)), "mask": np.array([True, False]), "list": [1, 2, 3],
    "big-endian": np.arange(3, dtype=">i4"),
}  # fmt: skip


def parts(message: bytes) -> tuple[bytes, bytes]:
    length, body = PREFIX.unpack(message[: PREFIX.size])
    assert len(message) == PREFIX.size + length + body
    return message[PREFIX.size :][:length], message[PREFIX.size + length :]


def test_arrays_survive_the_wire() -> None:
    text, body = parts(encode({"kind": "frame"}, {name: as_numbers(value) for name, value in ARRAYS.items()}))
    arrays = arrays_of(header_of(text), body)
    for name, value in ARRAYS.items():
        array, expected = arrays[name], np.asarray(value)
        assert array is not None
        np.testing.assert_array_equal(array, expected)
        assert (array.shape, array.dtype.kind) == (expected.shape, expected.dtype.kind)
        assert array.flags.writeable


NO_ARRAYS = {"objects": [object()], "text": "car", "dates": np.zeros(2, "M8[s]"), "ragged": [[1], [1, 2]], "none": None}


@pytest.mark.parametrize("value", NO_ARRAYS.values(), ids=NO_ARRAYS)
def test_only_numbers_are_sent(value: object) -> None:
    assert as_numbers(value) is None
    text, body = parts(encode({}, {"field": as_numbers(value)}))
    assert arrays_of(header_of(text), body) == {"field": None}


BROKEN = {
    "object dtype": [["a", "|O", [1]]], "negative": [["a", "<f4", [-1, -1]]], "too long": [["a", "<f4", [3]]],
    "too short": [["a", "<f4", [1]]], "overflow": [["a", "<f4", [2**39] * 4]], "no shape": [["a", "<f4"]],
    "true": [["a", "<f4", [True, 2]]], "no list": 3,
}  # fmt: skip


@pytest.mark.parametrize("entries", BROKEN.values(), ids=BROKEN)
def test_a_header_that_does_not_fit_is_refused(entries: object) -> None:
    with pytest.raises(WireError):
        arrays_of({"arrays": entries}, bytes(8))


@pytest.mark.parametrize("text", [b"", b"[1]", b"{", b"\xff", b"[" * 10_000], ids=repr)
def test_a_header_that_is_no_table_is_refused(text: bytes) -> None:
    with pytest.raises(WireError):
        header_of(text)
