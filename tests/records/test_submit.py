"""Records made behind the gateway and checked again: nothing that was changed holds."""

import json
import re
import shutil
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent import load_submission
from mtp_bench.core.errors import MtpBenchError, RecordError, RolloutError, SubmissionError, UnknownNameError
from mtp_bench.judge import Record, SceneRun, digest_of, load_record, submit, verify
from mtp_bench.judge.records import rerun
from mtp_bench.judge.records.attestation import Checked
from mtp_bench.judge.records.running import Plan
from mtp_bench.judge.records.submitting import require_target
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run, save_run
from mtp_bench.scoring import SUBSETS, targets
from mtp_bench.scoring.definitions import KNOWN_SUBSETS
from tests.support.command_line import CommandLine, read_json, write_submission
from tests.support.small_scenes import CARD, CARD_ID
from tests.support.stored_records import save_record, write_record

pytestmark = pytest.mark.usefixtures("light_fork_servers")

Content = dict[str, Any]


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_submission(
        tmp_path_factory.mktemp("submissions") / "echo",
        tables='training_data = ["drives"]\n[parameters]\nnoise = 0.1\n',
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, submission: Path, card: str, kitti: str) -> Path:
    folder = tmp_path_factory.mktemp("records") / "echo"
    submit(submission, card, RunOptions(kitti, seeds=(0, 1)), folder)
    return folder / f"{CARD_ID}.json"


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made.parent, tmp_path / "echo")) / made.name


def state_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def resign(path: Path, change: Callable[[Content], Any]) -> None:
    """Change a record and give it the digest of its new content, as a forger would."""
    content = json.loads(path.read_text())
    change(content)
    content["targets_sha256"] = digest_of(content["targets"])
    save_record(Record.model_validate(content), path)


def test_what_a_record_says(made: Path, submission: Path, card: str) -> None:
    record = load_record(made)
    assert (record.submission.name, record.submission.parameters, record.status) == ("echo", {"noise": 0.1}, "finished")
    assert (record.seeds, record.samples, len(record.scenes), record.training_data) == ([0, 1], 4, 3, ["drives"])
    assert (record.subsets, record.runs) == (SUBSETS, 6)
    assert record.measured.latency.p50_ms is not None
    assert record.measured.peak_memory_mib > 1
    assert record.missed.model_dump() == {"malformed": 0, "reasons": {}}
    assert (record.reference.name, record.reference.frozen) == ("stp", False)
    assert record.reference.origin.startswith("event weights of 48 runs of 'stp' on these scenes")
    assert not any(each in made.read_text() for each in (str(submission.parent), str(Path(card).parent)))


def test_a_record_holds(made: Path, card: str, kitti: str) -> None:
    checked = verify(made, RunOptions(kitti), card)
    assert (checked.level, checked.differences, checked.notes) == ("re-scored", (), ())


RERUN: dict[str, tuple[Callable[[Content], Any], str]] = {  # a change of the record, the difference that a run finds
    "unanswered frames": (lambda c: c["missed"].update(malformed=1), "missed.malformed"),
    "other references of its gap": (
        lambda c: c["submission"].update(gap_references="controls"),
        "submission.gap_references",
    ),
    "other training data": (lambda c: c.update(training_data=["KITTI"]), "training_data[0]"),
    "another limit": (lambda c: c["limits"].update(frame=3600.0), "limits.frame"),
    "more memory": (lambda c: c["limits"].update(memory=1 << 36), "limits.memory"),
    "another H": (lambda c: with_hypotheses(c, 20), "submission.hypotheses"),
}


def with_hypotheses(content: Content, count: int) -> None:
    for part in (content, content["submission"]):
        part["hypotheses"] = count


@pytest.mark.needs("sandbox")
def test_a_run_again_finds_what_differs(path: Path, submission: Path, card: str, kitti: str) -> None:
    resign(path, lambda content: [change(content) for change, _ in RERUN.values()])
    checked = verify(path, RunOptions(kitti), card, submission=submission, rerun=True)
    assert sorted(difference.what for difference in checked.differences) == sorted(what for _, what in RERUN.values())


@pytest.mark.needs("sandbox")
def test_the_commit_of_a_submission(submission: Path, card: str, kitti: str, tmp_path: Path, cli: CommandLine) -> None:
    """In the folder it would change the digest of what it names."""
    words = ["submit", submission, "--env", card, "--data", kitti, "--scenes", 1, "--seeds", 1, "-o", tmp_path]
    assert "--commit: got 'main', expected 7 to 64 hex digits" in cli(*words, "--commit", "main").err
    cli.ok(*words, "--commit", "0123abc")
    record = load_record(tmp_path / f"{CARD_ID}.json")
    assert (record.submission.commit, record.submission.digest) == ("0123abc", load_submission(submission).digest)
    path = tmp_path / f"{CARD_ID}.json"
    assert verify(path, RunOptions(kitti), card, submission=submission, rerun=True).holds


def test_hypotheses_are_those_that_the_manifest_declares(card: str, kitti: str, tmp_path: Path) -> None:
    tables = '[parameters]\nhypotheses = 1\nwidth = 20\n[compare]\nhypotheses = "hypotheses"\n'
    folder = write_submission(tmp_path / "counted", "counted", tables=tables)
    assert submit(folder, card, RunOptions(kitti, 1, (0,)), tmp_path / "out").submission.hypotheses == 1


@pytest.mark.needs("sandbox")
def test_secret_crashes(path: Path, submission: Path, card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def dies_where_the_seed_is_secret(plan: Plan, seed: int) -> list[SceneRun]:
        first, *others = shuffled(plan, seed)
        return [first, *others] if seed in (0, 1) else [replace(first, status="crashed", reason="crashed: no"), *others]

    shuffled = rerun._run_shuffled
    monkeypatch.setattr(rerun, "_run_shuffled", dies_where_the_seed_is_secret)
    with pytest.raises(RecordError, match=r"^echo: 1 runs under a secret motion .* \(crashed\), expected 0$"):
        verify(path, RunOptions(kitti), card, submission=submission, rerun=True)


@pytest.mark.needs("sandbox")
def test_another_submission_is_not_run_in_its_place(path: Path, card: str, kitti: str) -> None:
    with pytest.raises(RecordError, match="name the right folder with --submission"):
        verify(path, RunOptions(kitti), card, submission="stp", rerun=True)
    with pytest.raises(UnknownNameError, match="unknown submission 'echo'"):
        verify(path, RunOptions(kitti), card, rerun=True)


def lower(content: Content) -> None:
    content["numbers"]["all"]["minADE"] -= 1e-6


FORGED: dict[str, Callable[[Content], Any]] = {  # what differs -> how it was changed
    "numbers.all.minADE": lower,
    "error.all[0]": lambda content: content["error"]["all"].__setitem__(0, content["error"]["all"][0] + 1e-6),
    "brier": lambda content: content.update(brier=0.5),
    "targets.nothing_predicted": lambda content: content["targets"].update(nothing_predicted=9.0),
    "targets.subsets.ids.events": lambda content: content["targets"]["subsets"]["ids"].update(events=99.0),
    "env.data_manifest": lambda content: content["env"].update(data_manifest="00" * 32),
    "env.split": lambda content: content["env"].update(split="train"),
    "measured.latency.p95_ms": lambda content: content["measured"]["latency"].update(p95_ms=1e-3),
    "measured.ms_per_frame": lambda content: content["measured"].update(ms_per_frame=1e-3),
    "hashes.rollouts": lambda content: content["hashes"].update(rollouts="00" * 32),
}


@pytest.mark.parametrize("what", FORGED)
def test_a_forged_record_does_not_hold(what: str, path: Path, card: str, kitti: str) -> None:
    resign(path, FORGED[what])
    checked = verify(path, RunOptions(kitti), card)
    assert what in [difference.what for difference in checked.differences]
    assert checked.level == "scored"


def test_the_command_says_what_differs(cli: CommandLine, path: Path, card: str, kitti: str) -> None:
    resign(path, lower)
    found = path.parent / "found.txt"
    output = cli("verify", path, "--env", card, "--data", kitti, "--jobs", 1, "--json", found)
    assert output.error == f"{path}: 1 difference to what was found here"
    assert all(text in output.out for text in ("numbers.all.minADE", "does not hold"))
    verdict = read_json(found)["records"][0]
    assert (verdict["holds"], verdict["level"]) == (False, "scored")
    assert verdict["differences"][0]["what"] == "numbers.all.minADE"


def test_a_changed_rollout_does_not_hold(path: Path, card: str, kitti: str) -> None:
    folder = path.with_suffix(".rollouts") / "seed-0"
    run = load_run(folder)
    run.rollouts[0].forecast[0] = 0
    save_run(folder, run.info, run.rollouts)  # with a digest that fits
    checked = verify(path, RunOptions(kitti), card)
    assert [difference.what for difference in checked.differences] == ["hashes.rollouts"]
    stored = folder / "0001.npz"
    stored.write_bytes(stored.read_bytes()[:-40])
    with pytest.raises(RolloutError, match=r"0001\.npz"):
        verify(path, RunOptions(kitti), card)


def test_no_record_is_of_forecasts_that_were_read_from_a_file(path: Path, card: str, kitti: str) -> None:
    run = path.with_suffix(".rollouts") / "seed-0" / "run.json"
    run.write_text(run.read_text().replace('"observe": "detections"', '"observe": "file"'))
    with pytest.raises(RecordError, match=r"made with observe 'file', the record .* says 'detections'"):
        verify(path, RunOptions(kitti), card)
    path.write_text(path.read_text().replace('"observe":"detections"', '"observe":"file"'))
    with pytest.raises(RecordError, match="observe"):
        load_record(path)


def test_rollouts_that_are_missing_or_of_another_seed_are_refused(path: Path, card: str, kitti: str) -> None:
    rollouts = path.with_suffix(".rollouts")
    shutil.rmtree(rollouts / "seed-1")
    with pytest.raises(RecordError, match=r"rollouts of seed 1 are not stored .* --rerun"):
        verify(path, RunOptions(kitti), card)
    shutil.copytree(rollouts / "seed-0", rollouts / "seed-1")
    with pytest.raises(RecordError, match=r"made with seed 0, the record .* says 1"):
        verify(path, RunOptions(kitti), card)


@pytest.mark.parametrize(
    ("part", "key", "what"), [("scorer", "source_digest", "scorer"), ("reference", "hash", "event weights")]
)
def test_a_changed_scorer_is_noted(part: str, key: str, what: str, path: Path, card: str, kitti: str) -> None:
    resign(path, lambda content: content[part].update({key: "00" * 32}))
    (note,) = verify(path, RunOptions(kitti), card).notes
    assert note.startswith(f"changed since it was made: the {what};")


def test_a_crash_is_a_record_and_an_error(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    """Half of a letter in its text would be a record that nobody can store; an escape code, a screen that lies."""
    body = r"raise ValueError('\ud800 \x1b[2J \u202e' + 100_000 * 'x')"
    folder = write_submission(tmp_path / "bad", "bad", body=body)
    output = cli("submit", folder, "--env", card, "--data", kitti, "--seeds", 1, "--jobs", 1, "-o", tmp_path / "out")
    assert output.error.startswith(f"{CARD_ID}: crashed: no scene was finished: ")
    assert output.error.isprintable()
    assert len(output.error) < 2000
    record = load_record(tmp_path / "out" / f"{CARD_ID}.json")
    assert (record.status, record.missed.crashed_scenes, record.row.coverage) == ("crashed", 3, 0)
    reasons = record.missed.reasons.values()
    assert all("\ufffd" in reason and reason.isprintable() and len(reason) <= 1100 for reason in reasons)
    assert verify(tmp_path / "out" / f"{CARD_ID}.json", RunOptions(kitti), card).holds


def test_a_later_record_replaces_an_earlier_one(path: Path, submission: Path, card: str, kitti: str) -> None:
    for scenes, force in ((None, True), (1, True), (2, False), (3, False)):  # finished, partial, partial, finished
        submit(submission, card, RunOptions(kitti, scenes=scenes), path.parent, replace=force)
        assert [folder.name for folder in path.with_suffix(".rollouts").iterdir()] == ["seed-0"]
        assert verify(path, RunOptions(kitti), card).holds


@pytest.mark.parametrize("resume", [True, False])
def test_a_finished_record_is_not_lost(resume: bool, path: Path, submission: Path, card: str, kitti: str) -> None:
    before = state_of(path.parent)
    for seeds, scenes, less in (((0, 1), 1, "seeds 0, 1, 1 scenes"), ((0,), None, "seeds 0, all scenes")):
        with pytest.raises(RecordError, match=rf"seeds 0, 1, all 3 scenes\) with another \({less}\)"):
            submit(submission, card, RunOptions(kitti, scenes, seeds), path.parent, resume=resume)
    assert state_of(path.parent) == before


def test_the_command_says_so_at_once(cli: CommandLine, path: Path, submission: Path, card: str, kitti: str) -> None:
    other = path.parent / "MTP-Other-v0.toml"
    other.write_text(Path(card).read_text().replace(CARD_ID, "MTP-Other-v0"))
    before = state_of(path.parent)
    part = ("--seeds", 1, "--scenes", 1, "--data", kitti, "--jobs", 1, "-o", path.parent)
    words = ("submit", submission, "--env", other, "--env", card, *part)
    assert f"{path}: would overwrite a finished record (seeds 0, 1, all 3" in cli(*words).error
    assert state_of(path.parent) == before
    cli.ok(*words, "--force")
    assert {load_record(path.parent / f"{name}.json").status for name in (CARD_ID, "MTP-Other-v0")} == {"partial"}
    assert [folder.name for folder in path.with_suffix(".rollouts").iterdir()] == ["seed-0"]


def test_a_record_is_not_written_into_the_submission(submission: Path, card: str, kitti: str) -> None:
    with pytest.raises(MtpBenchError, match=r"inside the submission .* name another folder"):
        submit(submission, card, RunOptions(kitti), submission / "records")
    assert not (submission / "records").exists()


@pytest.mark.parametrize(("table", "options", "reason"), [
    ("", {"seeds": range(51)}, "seeds: got [0, 1"),
    (f"[parameters]\nlarge = {2**53 + 1}", {}, "less than or equal to 9007199254740992"),
    (f'[parameters]\ntext = "{"x" * 2001}"', {}, "at most 2000 characters"),
    ("", {"card": CARD.replace(CARD_ID, "MTP Small")}, "env.id: got 'MTP Small'"),
], ids=["seeds", "number", "parameter", "card"])  # fmt: skip
def test_impossible_records(table: str, options: Content, reason: str, card: str, kitti: str, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "mine", "mine", tables=table)
    if "card" in options:
        (tmp_path / "MTP Small.toml").write_text(options["card"])
        card = str(tmp_path / "MTP Small.toml")
    said = rf"(a record of mine on MTP|submission\.toml).*{re.escape(reason)}"
    with pytest.raises((RecordError, SubmissionError), match=said):
        submit(folder, card, RunOptions(kitti, seeds=options.get("seeds", (0,))), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("changed", [{"detector": "clean"}, {"presence": "scores"}], ids=str)
def test_a_record_has_no_other_detector(
    submission: Path, card: str, kitti: str, tmp_path: Path, changed: dict[str, Any]
) -> None:
    with pytest.raises(MtpBenchError, match="no other detector and no presence model can be chosen"):
        submit(submission, card, RunOptions(kitti, **changed), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("seeds", "kept"), [((0, 1, 2), True), (range(5), False), ((3, 4, 5), False)])
def test_a_ranked_record_is_not_lost(seeds: Sequence[int], kept: bool, submission: Path, tmp_path: Path) -> None:
    target = tmp_path / "echo.json"
    save_record(write_record(1.0, 2.0), target)
    asked = (target, load_submission(submission), RunOptions(seeds=seeds))
    require_target(*asked, resume=False, replace=True)
    with nullcontext() if kept else pytest.raises(RecordError, match="would overwrite a finished record"):
        require_target(*asked, resume=False, replace=False)


@pytest.mark.needs("sandbox")
def test_turning_targets_are_in_new_records_and_older_ones_hold_without_them(
    path: Path, submission: Path, card: str, kitti: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = load_record(path)
    assert old.subsets == SUBSETS  # nobody turns there
    monkeypatch.setattr(targets, "TURNING", -1.0)  # everybody does
    assert verify(path, RunOptions(kitti), card).holds
    new = submit(submission, card, RunOptions(kitti, seeds=(0, 1)), tmp_path / "new")
    assert new.subsets == KNOWN_SUBSETS
    assert new.row_of("turning").error == pytest.approx(new.row.error)
    assert verify(
        tmp_path / "new" / f"{CARD_ID}.json", RunOptions(kitti), card, submission=submission, rerun=True
    ).holds
    assert Checked(new).conditions == Checked(old).conditions
