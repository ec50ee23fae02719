"""All records of a leaderboard in one go: what is there is kept, what cannot be made says why."""

import re
from pathlib import Path

import pytest

from mtp_bench.cards import load_card
from mtp_bench.commands.submit import Line, make_all
from mtp_bench.core.bundle import baseline_names, card_ids
from mtp_bench.core.errors import UnknownNameError
from mtp_bench.judge import Record
from mtp_bench.judge.records.inventory import inventory, standing_record
from mtp_bench.running.options import RunOptions
from tests.support.command_line import CommandLine, write_submission
from tests.support.small_scenes import CARD_ID
from tests.support.stored_records import write_record

pytestmark = pytest.mark.usefixtures("light_fork_servers")


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_submission(tmp_path_factory.mktemp("submissions") / "echo")


def outcomes(printed: str) -> list[int]:
    """Numbers of all records by outcome: made, kept, not here, failed."""
    return list(map(int, re.findall(r"\d+", printed.splitlines()[-1])))


def test_every_baseline_on_every_environment_the_ends_of_gaps_first() -> None:
    listed = inventory()
    names = [piece.submission.name for piece in listed if piece.env == "MTP-nuScenes-v0"]
    assert (names[:2], sorted([*names, "given_tracks"])) == (["stp", "gt_tracks"], sorted(baseline_names()))
    envs = list(dict.fromkeys(piece.env for piece in listed))
    recordable = [env_id for env_id in card_ids() if load_card(env_id).drive is None]
    assert sorted(envs) == recordable
    simulated = [env_id for env_id in recordable if load_card(env_id).simulated]
    assert len(simulated) >= 7
    assert envs[-len(simulated) :] == simulated
    with pytest.raises(UnknownNameError, match="MTP-KITTI-v0"):
        inventory(["MTP-KITI-v0"])


def test_a_record_is_made_once_kept(cli: CommandLine, tmp_path: Path, submission: Path, card: str, kitti: str) -> None:
    words = ("submit", "--all", submission, "--env", card, "--data", kitti, "--seeds", 1, "--jobs", 1, "-o", tmp_path)
    assert outcomes(cli(*words).out) == [1, 0, 0, 0]
    target = tmp_path / "echo" / f"{CARD_ID}.json"
    before = target.read_bytes()
    assert outcomes(cli(*words).out) == [0, 1, 0, 0]
    refused = cli(*words, "--scenes", 1)
    assert refused.status == 1
    assert "seeds 0, all 3 scenes) with another (seeds 0, 1 scenes)" in refused.err
    assert target.read_bytes() == before
    (piece,) = inventory([card], [str(submission)], tmp_path)
    assert standing_record(piece, RunOptions(kitti, seeds=(0,))) is not None
    assert standing_record(piece, RunOptions(kitti, seeds=(0, 1))) is None
    assert standing_record(piece, RunOptions(kitti, 2, seeds=(0,))) is None
    cli(*words, "--scenes", 1, "--force")
    assert target.read_bytes() != before


def test_a_failure_stays_one_when_its_record_is_there(cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> None:
    broken = write_submission(tmp_path / "broken", body="raise ValueError('no')")
    words = ("submit", "--all", broken, "--env", card, "--data", kitti, "--seeds", 1, "--jobs", 1, "-o", tmp_path / "r")
    first, again = cli(*words), cli(*words)
    assert first.status == again.status == 1
    assert "crashed: no scene was finished" in first.err
    assert (again.err, outcomes(again.out)) == (first.err, [0, 0, 0, 1])


def test_scenes_that_were_cut_short_are_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such a record is finished, and never ranked."""
    (piece,) = inventory(["MTP-Merge-v0"], ["stp"], tmp_path)

    def line_of(record: Record) -> Line:
        monkeypatch.setattr("mtp_bench.commands.submit._make_record", lambda *_: record)
        (line,) = make_all([piece], RunOptions(), {})
        return line

    cut = {"malformed": 0, "reasons": {"a|0": "crashed: no"}}
    line = line_of(write_record(1.0, 2.0, missed=cut))
    assert (line.outcome, line.note) == ("failed", "1 of 6 scenes and seeds were not finished: crashed: no")
    assert line_of(write_record(1.0, 2.0)).outcome == "made"


def test_says_why(cli: CommandLine, tmp_path: Path, card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path / "none"))
    out = tmp_path / "records"
    done = cli("submit", "--all", "stp_modes", "--env", card, "--data", kitti, "--jobs", 1, "-o", out)
    assert done.status == 1  # it was the only one
    assert all(text in done.err for text in (f"stp_modes on {card}: not here: ", "mtp-bench train predictor modes"))
    done = cli("submit", "--all", "stp", "--env", card, "--data", tmp_path, "-o", out)
    assert (done.status, f"stp on {card}: not here: no data: " in done.err) == (1, True)
    assert not out.exists()


@pytest.mark.needs("sandbox")
def test_what_does_not_ship_runs_in_the_sandbox_alone(cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> None:
    """Were it built in this process, it could write here."""
    ran = tmp_path / "ran"
    folder = write_submission(tmp_path / "mine", name="mine")
    code = (folder / "agent.py").read_text()
    note = f"import contextlib, pathlib\nwith contextlib.suppress(OSError):\n    pathlib.Path({str(ran)!r}).touch()\n"
    (folder / "agent.py").write_text(code + "\n" + note)
    words = ("submit", "--all", folder, "--env", card, "--data", kitti, "--seeds", 1, "--scenes", 1, "--jobs", 1)
    cli(*words, "-o", tmp_path / "out")
    assert (tmp_path / "out" / "mine" / f"{CARD_ID}.json").exists()
    assert not ran.exists()
