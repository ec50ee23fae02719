"""Runs on disk: the same numbers as a comparison, complete or not there at all, and no word of a changed one taken."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent.loader import load_submission
from mtp_bench.cards import load_card
from mtp_bench.running import stored
from mtp_bench.running.comparison import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run
from mtp_bench.scoring import SUBSETS
from tests.running.test_rollout_files import edit_json
from tests.support.command_line import CommandLine, plain_environment
from tests.support.small_scenes import CARD, write_card

pytestmark = pytest.mark.usefixtures("remembered_weights")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "stp"
    stored.run("stp", card, folder, RunOptions(kitti))
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))


def without_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What does not depend on who else is there."""
    beside = ("difference_to_stp", "difference_interval", "p")
    return [{k: v for k, v in row.items() if k not in beside and "gap" not in k and k[:5] != "cost_"} for row in rows]


def digests(folder: Path) -> dict[str, str]:
    return {entry["scene"]: entry["digest"] for entry in json.loads((folder / "run.json").read_text())["scenes"]}


def test_a_stored_run_says_what_was_trained_on_its_scenes(tmp_path: Path, card: str, kitti: str) -> None:
    folder = tmp_path / "mine"
    shutil.copytree(load_submission("stp").path, folder)
    manifest = folder / "submission.toml"
    text = manifest.read_text(encoding="utf-8").replace(
        "[trained_on_scored]", f'[trained_on_scored]\n"{load_card(card).id}" = "presence"'
    )
    manifest.write_text(text, encoding="utf-8")
    stored.run(str(folder), card, tmp_path / "run", RunOptions(kitti, scenes=1))
    report = stored.score(tmp_path / "run", RunOptions(kitti)).report
    assert report.condition["trained"] == "presence trained on scored scenes: stp"


@pytest.mark.usefixtures("few_event_runs")
@pytest.mark.parametrize(("agent", "seed"), [("mtp", 3), ("gt_tracks", 0)])
def test_scores_as_compared(agent: str, seed: int, cli: CommandLine, tmp_path: Path, shipped: str, kitti: str) -> None:
    cli.ok("maintain", "freeze", "--env", shipped, "--data", kitti, "--jobs", 1)
    cli.ok("run", agent, "--env", shipped, "--data", kitti, "-o", tmp_path / "run", "--jobs", 1, "--seed", seed)
    scored = stored.score(tmp_path / "run", RunOptions(kitti)).report.to_json()["rows"]
    rows = compare([agent], shipped, RunOptions(kitti, seeds=[seed]), full=False).report.to_json()["rows"]
    hypotheses = 20 if agent == "mtp" else 1  # more than the 3 of the card
    same = [r for r in rows if (r["agent"], r["hypotheses"], r["budget"]) == (agent, hypotheses, "equal")]
    assert (len(same), without_times(scored)) == (len(SUBSETS), without_times(same))
    lost = next(row for row in scored if row["subset"] == "paper_frag")
    assert (lost["events"], lost["targets"]) == (6, 2)


def test_answers_are_the_same_in_every_process(tmp_path: Path, card: str, kitti: str) -> None:
    command = [sys.executable, "-m", "mtp_bench", "run", "mtp", "--env", card, "--data", kitti]
    command += ["-o", str(tmp_path / "there"), "--jobs", "1"]
    other = plain_environment() | {"PYTHONHASHSEED": "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"}
    done = subprocess.run(command, env=other, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    stored.run("mtp", card, tmp_path / "here", RunOptions(kitti))
    assert digests(tmp_path / "there") == digests(tmp_path / "here")
    assert len(set(digests(tmp_path / "here").values())) == 3


CHANGES: dict[str, tuple[Callable[[Path], Any], str]] = {  # what a file may hold: tests of rollouts
    "npz missing": (lambda folder: (folder / "0006.npz").unlink(), "0006.npz is missing"),
    "fewer samples than stored": (
        edit_json(lambda content: content["info"].update(samples=3)), "states 3 samples per object, scene '0001' has 4",
    ),
    "a scene twice": (
        edit_json(lambda content: content["scenes"].append(content["scenes"][0])),
        "expected at least one, and each once"),
    "another card": (
        edit_json(lambda content: content["info"].update(card_digest="0" * 16)),
        "made for MTP-Small-v0 with card digest 0000000000000000, .*run the agent again"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message"), CHANGES.values(), ids=CHANGES.keys())
def test_a_changed_run_is_one_clear_error(
    change: Callable[[Path], Any], message: str, cli: CommandLine, folder: Path, tmp_path: Path, card: str, kitti: str
) -> None:
    file = tmp_path / "a.json"
    change(folder)
    assert re.search(message, cli("score", folder, "--data", kitti, "--json", file).error)
    assert not file.exists()


def test_a_run_for_an_earlier_card(cli: CommandLine, folder: Path, tmp_path: Path, shipped: str, kitti: str) -> None:
    said = cli.ok("score", folder, "--data", kitti)
    write_card(tmp_path / "bundle" / "envs", CARD.replace("miss_error = 2.0", "miss_error = 3.0"))
    again = cli.ok("score", folder, "--data", kitti)
    assert "MTP-Small-v0, changed, 2 scenes, 1 seed: m, less is better" in again, "it is not the card that ships"
    assert again.splitlines()[1:] == said.splitlines()[1:], "a run is scored by the card that it keeps"


def test_a_run_without_its_card(cli: CommandLine, folder: Path, card: str, kitti: str) -> None:
    edit_json(lambda run: run["info"].pop("card"))(folder)
    assert f"{folder}, card: " in cli("score", folder, "--data", kitti).error
    assert stored.score(folder, RunOptions(kitti), load_card(card))


def test_replacing_an_earlier_run(cli: CommandLine, folder: Path, tmp_path: Path, card: str, kitti: str) -> None:
    before = digests(folder)
    command = ("run", "ab3dmot", "--env", card, "--data", kitti, "-o", folder, "--jobs", 1)
    said = f"{folder} holds an earlier run: choose another folder, or replace it (--force, replace=True)"
    assert said in cli(*command).error
    assert digests(folder) == before
    (tmp_path / "empty").mkdir()
    cli.ok(*command[:-3], tmp_path / "empty", "--jobs", 1)
    cli.ok(*command, "--force")
    assert load_run(folder).info.agent == "ab3dmot"
    (tmp_path / "link").symlink_to(folder)
    cli.ok("run", "stp", "--env", card, "--data", kitti, "-o", tmp_path / "link", "--jobs", 1, "--force")
    assert (tmp_path / "link").is_symlink()
    assert load_run(folder).info.agent == "stp"
