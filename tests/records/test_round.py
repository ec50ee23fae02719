"""A whole round: all records of a folder, each as far as it can be checked; started again, it goes on."""

import errno
import shutil
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent.loader import load_submission
from mtp_bench.core.errors import RecordError
from mtp_bench.judge import SceneRun, load_record, submit, verify
from mtp_bench.judge.records import rerun
from mtp_bench.judge.records.rerun import run_again
from mtp_bench.judge.records.running import Plan, plan_run, rollouts_hash, rollouts_of, run_seed
from mtp_bench.judge.records.storage import ROLLOUTS_SUFFIX
from mtp_bench.judge.records.verifying import Verification
from mtp_bench.running.options import RunOptions
from tests.support.command_line import CommandLine, read_json, write_submission
from tests.support.leaderboards import SIGNER
from tests.support.small_scenes import CARD_ID
from tests.support.stored_records import save_record


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Path:
    """A folder with submissions and their records: one that holds, one whose submission changed, one of a baseline."""
    root = tmp_path_factory.mktemp("round")
    for name in ("echo", "moved"):
        submit(write_submission(root / "submissions" / name, name), card, RunOptions(kitti), root / "records" / name)
    with (root / "submissions" / "moved" / "agent.py").open("a") as file:
        file.write("# later\n")
    assert submit("stp", card, RunOptions(kitti), root / "records" / "stp").status == "finished"
    return root


@pytest.mark.needs("sandbox")
def test_a_round_goes_through_all_records_and_goes_on_when_started_again(
    made: Path, cli: CommandLine, card: str, kitti: str, tmp_path: Path, leaderboard: Path, key: Path
) -> None:
    records, found = tmp_path / "records", tmp_path / "found.json"
    shutil.copytree(made / "records", records)
    (records / "broken").mkdir()
    (records / "broken" / f"{CARD_ID}.json").write_text("{")
    arguments = (
        "verify", records, "--env", card, "--data", kitti, "--jobs", 1, "--json", found, "--base", leaderboard,
        "--rerun", "--submission", made / "submissions", "--sign", key, "--signer", SIGNER,
    )  # fmt: skip
    output = cli(*arguments)
    assert output.status == 1
    assert all(text in output.error for text in ("not valid JSON", "the submission 'moved' has"))
    verdicts = {Path(each["record"]).parent.name: each for each in read_json(found)["records"]}
    assert {name: each.get("level") for name, each in verdicts.items()} == {
        "broken": None, "echo": "re-run", "moved": None, "stp": "re-run",
    }  # fmt: skip
    signed, made_of = (folder / "echo" / f"{CARD_ID}.json" for folder in (records, made / "records"))
    before = signed.stat().st_mtime_ns
    again = cli(*arguments)
    assert again.out.count(f"signed by {SIGNER}") == 2
    assert "not valid JSON" in again.error
    assert signed.stat().st_mtime_ns == before, "what is reached is not run again"
    shutil.copy(made_of, signed)
    (records / "broken" / f"{CARD_ID}.json").unlink()
    shutil.rmtree(records / "moved")
    assert "re-run, signed by" in " ".join(cli.ok(*arguments).split())
    assert "level" in read_json(signed)


def test_a_failing_disk(made: Path, cli: CommandLine, card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(path: Path, *arguments: Any, **keywords: Any) -> Verification:
        if path.parent.name == "echo":
            raise OSError(errno.ENOSPC, "No space left on device", "/cache/scene.npz")
        return verify(path, *arguments, **keywords)

    monkeypatch.setattr("mtp_bench.commands.verify.check_record", failing)
    output = cli("verify", made / "records", "--env", card, "--data", kitti, "--jobs", 1)
    assert output.error.startswith("/cache/scene.npz: No space left on device")
    assert output.out.count("holds, re-scored") == 2


def test_without_a_key_nothing_is_written(made: Path, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    shutil.copytree(made / "records" / "stp", tmp_path / "stp")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    cli.ok("verify", tmp_path, "--env", card, "--data", kitti, "--jobs", 1)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


@pytest.mark.needs("sandbox")
def test_a_baseline_made_here_is_run_in_secret_alone(
    made: Path, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(name: str) -> Verification:
        path, submission = records / name / f"{CARD_ID}.json", submissions.get(name)
        return verify(path, RunOptions(kitti), card, submission, rerun=True, made_here=True)

    records, submissions = Path(shutil.copytree(made / "records", tmp_path / "r")), {"echo": made / "submissions/echo"}
    ran = list[int]()

    def noted(plan: Plan, seed: int) -> list[SceneRun]:
        ran.append(seed)
        return run_seed(plan, seed)

    monkeypatch.setattr(rerun, "run_seed", noted)
    checked = check("stp")
    assert (checked.level, checked.differences, len(ran)) == ("re-run", (), 1)
    assert ran[0] not in checked.record.seeds
    with pytest.raises(RecordError, match=(refused := "leave --made-here out")):
        check("echo")
    other = "0" * 64
    save_record(checked.record.model_copy(update={"plan": other}), checked.path)
    with pytest.raises(RecordError, match=refused):
        check("stp")
    hashes = checked.record.hashes.model_copy(update={"rollouts": other})
    save_record(checked.record.model_copy(update={"hashes": hashes}), checked.path)
    assert [each.what for each in check("stp").differences] == ["hashes.rollouts"]
    assert len(ran) == 1
    shutil.rmtree(checked.path.with_suffix(ROLLOUTS_SUFFIX))
    unscored = check("stp")
    assert (unscored.level, unscored.differences, len(ran)) == ("re-run", (), 2)
    assert "rollouts are not stored here" in unscored.notes[0]
    scorer = checked.record.scorer.model_copy(update={"source_digest": other})
    save_record(checked.record.model_copy(update={"scorer": scorer}), checked.path)
    with pytest.raises(RecordError, match="changed since it was made: the scorer"):
        check("stp")


def test_a_random_order_changes_no_answer(made: Path, card: str, kitti: str) -> None:
    plan = plan_run(load_submission(made / "submissions" / "echo"), card, RunOptions(kitti))
    record = load_record(made / "records" / "echo" / f"{CARD_ID}.json")
    for _ in range(3):
        runs = run_again(plan, record.seeds)
        assert [run.rollout.scene for run in runs[0]] == record.scenes
        assert rollouts_hash(rollouts_of(runs)) == record.hashes.rollouts
