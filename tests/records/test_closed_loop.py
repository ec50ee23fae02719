"""Closed loops: an agent in a process of its own drives alike, and what a loop cannot do is refused at once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench import MTPEnv, compare, evaluate, load_scenes, load_submission
from mtp_bench.cards import load_card
from mtp_bench.env.rollouts import digest
from mtp_bench.errors import MtpBenchError
from mtp_bench.gateway import run_isolated
from mtp_bench.records.inventory import inventory
from mtp_bench.records.storage import record_text
from mtp_bench.records.verifying import verify
from mtp_bench.running.run import agent_task, run_scene
from mtp_bench.running.stored import run
from mtp_bench.training import windows
from mtp_bench.types import Rollout
from tests.support.command_line import CommandLine, write_submission
from tests.support.runs import PATIENT
from tests.support.stored_records import write_record

DRIVE = "MTP-Drive-Intersection-v0"
SCENE = "intersection-010000"


@pytest.fixture(scope="module")
def short() -> Any:
    """The shipped card with short drives through little traffic."""
    card = load_card(DRIVE)
    source = card.source.model_copy(update={"seconds": 9.0, "vehicles": 6, "pedestrians": 4, "parked": 4})
    return card.model_copy(update={"source": source})


@pytest.fixture(scope="module")
def driven(short: Any) -> Rollout:
    env = MTPEnv(short, evaluation=True, rigid_motion=True)
    return run_scene(load_submission("stp").build(agent_task(env, 0)), env, SCENE, 0)


def test_an_agent_in_a_process_of_its_own_drives_as_in_this_one(short: Any, driven: Rollout) -> None:
    sealed = run_isolated("stp", short, {"rigid_motion": True}, SCENE, limits=PATIENT)
    assert sealed.status == "finished", sealed.reason
    assert driven.drive is not None
    assert driven.drive.way > 0
    assert digest(sealed.rollout) == digest(driven)
    again = run_isolated("stp", short, {"rigid_motion": True}, SCENE, limits=PATIENT)
    assert (again.seal, again.scene_digest) == (sealed.seal, sealed.scene_digest)


def test_where_an_agent_fails_the_ego_drives_on_without_forecasts(short: Any, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo", body="raise ValueError('no more')")
    failed = run_isolated(folder, short, {}, SCENE, limits=PATIENT)
    assert failed.status == "crashed"
    assert failed.rollout.drive is not None
    assert not len(failed.rollout.object_class)
    assert failed.rollout.drive.way > 0


COMMANDS = {
    "submit": ("submit stp", "no records yet: `mtp-bench compare`"),
    "seal": ("maintain seal --count 50 -o secret.json", "no hidden scenes: `mtp-bench compare`"),
    "freeze": ("maintain freeze", "event weights are those of one run: `mtp-bench score`"),
    "study": ("study --quick -o study", "there is no study: `mtp-bench compare`"),
    "motion noise": ("train motion-noise", "without scenes to fit to: fit on MTP-Intersection-v0"),
    "predictor": ("train predictor modes", "without scenes to fit to: fit on MTP-Intersection-v0"),
    "noise": ("fit-noise", "without scenes to fit to: fit on MTP-Intersection-v0"),
    "compare": ("compare stp --tracks .", "takes no stored tracks: leave --tracks out"),
    "columns": ("compare stp --columns error", "one table of driving: leave --columns"),
    "tracks": ("import tracks . -o tables", "takes no stored tracks"),
}


@pytest.mark.parametrize(("words", "reason"), COMMANDS.values(), ids=COMMANDS)
def test_a_command_says_at_once_what_a_loop_cannot_do(
    words: str, reason: str, cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    error = cli(*words.split(), "--env", DRIVE).error
    assert error.startswith(f"{DRIVE} is a closed loop, ")
    assert reason in error
    assert not list(tmp_path.iterdir())


CALLS: dict[str, tuple[Callable[[Any], object], str]] = {
    "evaluate": (lambda card: evaluate("stp", card), "do not meet the same scenes"),
    "compare": (lambda card: compare(["stp"], card), "do not meet the same scenes"),
    "windows": (lambda card: windows(DRIVE), "without scenes to fit to"),
    "target_frames": (lambda card: MTPEnv(card, target_frames=True), "no target_frames"),
    "fresh_noise": (lambda card: MTPEnv(card, fresh_noise=True), "which takes no fresh_noise"),
    "track_file": (lambda card: MTPEnv(card, observe="tracks", track_file="."), "no track_file"),
    "load_scenes": (lambda card: next(load_scenes(card)), "before an agent drives in it: run one, and open its run"),
}


@pytest.mark.parametrize(("call", "reason"), CALLS.values(), ids=CALLS)
def test_a_function_says_at_once_what_a_loop_cannot_do(call: Callable[[Any], object], reason: str, short: Any) -> None:
    with pytest.raises(MtpBenchError, match=reason):
        call(short)


def test_a_reward_is_known_after_the_step_alone(short: Any) -> None:
    env = MTPEnv(short)
    env.reset(seed=0)
    with pytest.raises(MtpBenchError, match="whose rewards are known after the step alone"):
        env.reward_of(env.action_space.sample())


def test_no_record_of_a_loop_is_made_or_verified(tmp_path: Path) -> None:
    assert DRIVE not in {piece.env for piece in inventory()}
    path = tmp_path / f"{DRIVE}.json"
    path.write_text(record_text(write_record(1.0, env={"id": DRIVE}), path)[1])
    with pytest.raises(MtpBenchError, match="no records yet"):
        verify(path)


def test_the_tracks_of_a_drive_are_exported(short: Any, tmp_path: Path, cli: CommandLine) -> None:
    run("stp", short, tmp_path / "run", scenes=1)
    assert "tracked position" in cli.ok("export", tmp_path / "run", "-o", tmp_path / "tables")
    assert [path.name for path in (tmp_path / "tables").iterdir()] == [f"{SCENE}.csv"]
