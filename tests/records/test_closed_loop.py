"""Closed loops: an agent in a process of its own drives alike, records hold, and what a loop cannot do is refused."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv, compare, evaluate, load_scenes, load_submission
from mtp_bench.cards import load_card
from mtp_bench.commands.verify import _as_json, _verdict
from mtp_bench.core import Rollout
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.env.rollouts import actions_of, assemble, digest
from mtp_bench.judge import Record, digest_of, open_seal, run_isolated, seal, submit, verify
from mtp_bench.judge.records.consistency import checked_record
from mtp_bench.judge.records.rerun import drive_again
from mtp_bench.judge.records.storage import content_digest
from mtp_bench.judge.records.targets import drive_targets
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.rollout_files import load_run, save_run
from mtp_bench.running.stored import run
from mtp_bench.scoring import read_reference
from mtp_bench.training import windows
from mtp_bench.viz.board.columns import board_json
from mtp_bench.viz.board.entries import LinkedRecord, entries_of
from mtp_bench.viz.board.page import board_files
from mtp_bench.viz.board.tables import board_tables
from tests.support.command_line import CommandLine, write_submission
from tests.support.runs import PATIENT
from tests.support.small_scenes import write_short_card
from tests.support.stored_records import write_record

DRIVE = "MTP-Drive-Intersection-v0"
SCENE = "intersection-010000"


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_short_card(tmp_path_factory.mktemp("card"), DRIVE, 8.0)


@pytest.fixture(scope="module")
def short(path: str) -> Any:
    return load_card(path)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, path: str) -> Path:
    folder = tmp_path_factory.mktemp("records") / "standing"
    submit("standing", path, RunOptions(seeds=(0, 1)), folder)
    return folder / f"{DRIVE}.json"


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
    "study": ("study --quick -o study", "there is no study: `mtp-bench compare`"),
    "compare": ("compare stp --tracks .", "takes no stored tracks: leave --tracks out"),
    "forecasts": ("import forecasts . --form table -o run", "has no stored forecasts"),
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
    "target_frames": (lambda card: MTPEnv(card, target_frames=True), "no target_frames"),
    "fresh_noise": (lambda card: MTPEnv(card, fresh_noise=True), "which takes no fresh_noise"),
    "tracks": (lambda card: MTPEnv(card, observe="tracks", tracks="."), "no tracks"),
    "load_scenes": (lambda card: next(load_scenes(card)), "before an agent drives in it: run one, and open its run"),
}


@pytest.mark.parametrize(("call", "reason"), CALLS.values(), ids=CALLS)
def test_a_function_says_at_once_what_a_loop_cannot_do(call: Callable[[Any], object], reason: str, short: Any) -> None:
    with pytest.raises(MtpBenchError, match=reason):
        call(short)


def test_networks_learn_from_traffic_in_which_no_agent_drives(path: str) -> None:
    learnt = windows(path, "val", scenes=1)
    assert learnt.names == (SCENE,)
    assert len(learnt.frame) > 20


def test_a_reward_is_known_after_the_step_alone(short: Any) -> None:
    env = MTPEnv(short)
    env.reset(seed=0)
    with pytest.raises(MtpBenchError, match="whose rewards are known after the step alone"):
        env.reward_of(env.action_space.sample())


def test_a_record_holds_by_its_answers_alone(made: Path, path: str, tmp_path: Path) -> None:
    record = checked_record(made)
    assert record.driving is not None
    assert record.drives is not None
    assert [1 - sum(scores) / 2 for scores in record.drives.scores] == pytest.approx(record.unit_error("all"))
    assert record.driving.drive_score == pytest.approx(1 - (record.row.error or 0.0))
    copied = Path(shutil.copytree(made.parent, tmp_path / "standing")) / made.name
    run = load_run(folder := copied.with_suffix(".rollouts") / "seed-0")
    forged = [replace(each, drive=replace(each.drive, way=999.0)) for each in run.rollouts if each.drive is not None]
    save_run(folder, run.info, forged)
    checked = verify(copied, RunOptions(), path)
    assert (checked.level, checked.differences, checked.notes) == ("re-scored", (), ())


ANSWERS: dict[str, tuple[Callable[[Rollout], dict[str, Any]], str]] = {  # stored ones that no env records
    "heavy samples": (lambda r: {"forecast_log_weight": r.forecast_log_weight + 1.0}, "add up to more than 1"),
    "no numbers": (lambda r: {"forecast_log_weight": r.forecast_log_weight * np.nan}, "add up to more than 1"),
    "sure twice": (lambda r: {"object_confidence": r.object_confidence + 1.0}, r"expected values in \[0, 1\]"),
    "short": (lambda r: {"forecast": r.forecast[:, :, :1]}, "future frames is 1, expected 12"),
}


@pytest.mark.parametrize(("change", "reason"), ANSWERS.values(), ids=ANSWERS)
def test_the_answers_of_a_drive_are_checked(
    change: Callable[[Rollout], dict[str, Any]], reason: str, short: Any, driven: Rollout
) -> None:
    with pytest.raises(MtpBenchError, match=reason):
        drive_again(short, replace(driven, **change(driven)))


def test_a_drive_has_as_many_answers_as_frames(short: Any, driven: Rollout) -> None:
    assert digest(drive_again(short, driven)) == digest(driven)
    actions = list(actions_of(driven))
    for others in (actions[:-1], [*actions, actions[0]]):
        with pytest.raises(MtpBenchError, match=f"{len(others)} stored answers do not end with the drive"):
            drive_again(short, assemble(SCENE, others, np.zeros(len(others), dtype=int)))


def without_a_scene(content: Any) -> None:
    content["targets"]["scenes"].pop()
    content["targets"]["scene_units"].pop()
    for part in content["targets"]["subsets"].values():
        part["weight"].pop()


REFUSED: dict[str, tuple[Callable[[Any], Any], str]] = {  # a change of a record, and what is wrong then
    "drive score": (lambda c: c["drives"].update(drive_score=0.99), "unknown key 'drives.drive_score'"),
    "seed too few": (lambda c: c["drives"]["scores"][0].pop(), r"drives\.scores are not 2 scores of each scene"),
    "scene too few": (without_a_scene, r"drives\.scores has 2 units, its targets 1"),
    "no drives": (lambda c: c.update(drives=None), "error has no sums of all"),
    "other env": (lambda c: c["env"].update(id="MTP-Merge-v0"), "drives are given, MTP-Merge-v0 is not a closed loop"),
    "faults": (lambda c: c["drives"].update(collisions=50.0), r"drives\.collisions is 50\.0, and 0 % of the scores"),
    "way": (lambda c: c["drives"].update(comfort=0.5, progress=0.0), r"drives\.progress is 0\.0, the scores need 0\."),
    "too far": (lambda c: c["drives"].update(progress=1.5), r"drives\.progress: got .*less than or equal to 1"),
    "other scene": (
        lambda c: c["targets"]["scenes"].__setitem__(0, "intersection-010007"), "scenes are not those of the record"),
}  # fmt: skip
FORGED: dict[str, Callable[[Any], Any]] = {  # what differs when its drives are scored again
    "drives.scores[0][0]": lambda c: c["drives"]["scores"][0].__setitem__(0, c["drives"]["scores"][0][0] * 0.999),
    "reference.hash": lambda c: c["reference"].update(hash="00" * 32),
    "drives.near_misses": lambda c: c["drives"].update(near_misses=1e3),
    "env.data_manifest": lambda c: c["env"].update(data_manifest="00" * 32),
}


def changed(path: Path, *changes: Callable[[Any], Any]) -> None:
    content = json.loads(path.read_text())
    for change in changes:
        change(content)
    content["targets_sha256"] = digest_of(content["targets"])
    content["digest"] = content_digest(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("what", REFUSED)
def test_a_changed_record_is_refused(what: str, made: Path, path: str, tmp_path: Path) -> None:
    copied = Path(shutil.copytree(made.parent, tmp_path / "standing")) / made.name
    change, reason = REFUSED[what]
    changed(copied, change)
    with pytest.raises(MtpBenchError, match=reason):
        verify(copied, RunOptions(), path)


def test_a_forged_record_does_not_hold(made: Path, path: str, tmp_path: Path) -> None:
    copied = Path(shutil.copytree(made.parent, tmp_path / "standing")) / made.name
    changed(copied, *FORGED.values())
    assert FORGED.keys() <= {each.what for each in verify(copied, RunOptions(), path).differences}


@pytest.mark.needs("sandbox")
def test_hidden_drives(made: Path, path: str, tmp_path: Path) -> None:
    seal(path, 2, tmp_path / "s.json")
    sealed = open_seal(tmp_path / "s.json")
    checked = verify(made, RunOptions(), path, rerun=True, sealed=sealed)
    assert (checked.level, checked.differences) == ("hidden", ())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mtp_bench.judge.records.verifying.drive_again", None)  # own drives are not made again
        checked = verify(made, RunOptions(), path, rerun=True, sealed=sealed, made_here=True)
    assert (checked.level, checked.differences) == ("hidden", ())
    assert checked.hidden is not None
    assert checked.hidden.driving is not None
    score = checked.hidden.driving.drive_score
    assert f": holds, hidden. drive score {score:.3f} on 2 hidden scenes, too few to rank" in _verdict(checked)
    assert score == pytest.approx(1 - _as_json(checked)["hidden_error"])
    assert str(sealed.seeds.first)[:-1] not in checked.hidden.model_dump_json()
    ways = read_reference(tmp_path / "s.weights.json")
    assert (ways.digest, ways.agent, ways.totals["targets"]) == (checked.hidden.weights, "gt_tracks", 2)
    assert min(ways.ways(sealed.shuffled(f"intersection-{sealed.seeds.first + i}" for i in range(2))).values()) > 0
    (tmp_path / "s.json").write_text((tmp_path / "s.weights.json").read_text().replace('"way": ', '"way": 1'))
    with pytest.raises(MtpBenchError, match="hash is "):
        read_reference(tmp_path / "s.json")


def test_a_board_of_drives(made: Path) -> None:
    def record(name: str, *scores: float) -> Record:
        drives = {**json.loads(made.read_text())["drives"], "scores": [[score] * 3 for score in scores]}
        targets = drive_targets([f"s{i}" for i in range(len(scores))])
        of_targets: dict[str, Any] = {"targets": targets.model_dump(), "targets_sha256": targets.digest}
        results = {"error": {}, "numbers": {}, "drives": drives}
        record = write_record(1.0, name=name, env={"id": DRIVE, "scenes_of_split": len(scores)}, **of_targets)
        return Record.model_validate(record.model_dump() | results)

    records = [record("stp", *[0.5] * 30), record("best", *[0.7] * 25, *[0.4] * 5)]
    entries = entries_of([LinkedRecord(each) for each in records])
    assert [entry.name for entry in entries] == ["best", "stp"]
    (table, _), (row, _) = board_tables(entries)[0], board_json(entries)[DRIVE]
    assert "drive score" in table.title
    assert (row["submission"], row["error"]) == ("best", None)
    assert row["drive_score"] == pytest.approx(0.65)
    page = board_files(entries)
    assert all(text in page.page for text in ("drive score", "0.650", "at fault", "Closed loop"))


def test_the_tracks_of_a_drive_are_exported(short: Any, tmp_path: Path, cli: CommandLine) -> None:
    run("stp", short, tmp_path / "run", scenes=1)
    assert "tracked position" in cli.ok("export", tmp_path / "run", "-o", tmp_path / "tables")
    assert [path.name for path in (tmp_path / "tables").iterdir()] == [f"{SCENE}.csv"]
