"""Runs whose forecasts were read from a file, and runs without tracks: shown, never ranked, and no number made up."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Rollout
from mtp_bench.running import stored
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run, save_run
from mtp_bench.running.stored import open_run, run_scores
from mtp_bench.scoring import AgentScores, summarise
from mtp_bench.scoring.rank import FROM_FILE
from mtp_bench.viz.terminal.notes import warnings
from tests.support.command_line import CommandLine

pytestmark = pytest.mark.usefixtures("remembered_weights")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "stp"
    stored.run("stp", card, folder, RunOptions(kitti))
    return folder


@pytest.fixture(scope="module")
def from_file(finished: Path) -> Path:
    """The same forecasts, as if they had been read from a file."""
    changes = {
        "agent": "theirs",
        "observe": "file",
        "submission_digest": "",
        "folder": "",
        "parameters": {"form": "own"},
    }
    return _copied(finished, "file", changes, lambda rollout: rollout)


@pytest.fixture(scope="module")
def untracked(finished: Path) -> Path:
    """The same forecasts without tracks."""
    return _copied(finished, "untracked", {"agent": "untracked"}, without_tracks)


def _copied(finished: Path, name: str, changes: dict[str, Any], change: Callable[[Rollout], Rollout]) -> Path:
    run, folder = load_run(finished), finished.with_name(name)
    save_run(folder, run.info.model_copy(update=changes), map(change, run.rollouts))
    return folder


def without_tracks(rollout: Rollout) -> Rollout:
    rows = {name: getattr(rollout, name)[:0] for name in ("track_id", "track_box", "track_class", "member")}
    return replace(rollout, track_start=np.zeros_like(rollout.track_start), **rows)


def rows_of(folder: Path, card: str, kitti: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = stored.score(folder, RunOptions(kitti)).report.to_json()["rows"]
    return rows


def test_a_run_from_a_file_has_the_numbers_of_the_run_but_no_rank(
    from_file: Path, finished: Path, card: str, kitti: str
) -> None:
    row, original = rows_of(from_file, card, kitti)[0], rows_of(finished, card, kitti)[0]
    for name in ("error", "minADE", "coverage", "missed", "targets"):
        assert row[name] == original[name]
    assert (row["place"], row["unranked_because"]) == (None, FROM_FILE)
    opened = open_run(from_file, kitti)
    shown, recorded = opened.scene("0001").detections, opened.recorded("0001").detections
    assert len(shown.box)
    assert np.array_equal(shown.box, recorded.box)


def test_a_run_from_a_file_has_no_place_among_others(from_file: Path, finished: Path, card: str, kitti: str) -> None:
    opened = [open_run(folder, kitti) for folder in (finished, from_file)]
    report = summarise([run_scores(run) for run in opened], opened[0].card)
    reasons = {row.agent: row.unranked_because for row in report.rows if row.subset == "all"}
    assert reasons["theirs"] == FROM_FILE
    assert reasons["stp"] != FROM_FILE
    assert [line for line in warnings(report) if "never" in line] == [f"theirs: never ranked, {FROM_FILE}"]


def test_every_command_takes_a_run_from_a_file(
    cli: CommandLine, from_file: Path, finished: Path, tmp_path: Path, kitti: str
) -> None:
    printed = cli.ok("score", from_file, "--data", kitti)
    assert f"theirs: never ranked, {FROM_FILE}" in " ".join(printed.split())
    worst = " ".join(cli.ok("worst", from_file, "--data", kitti, "--no-doctor").split())
    assert (
        "The error of forecasts is not split, but stands under rest: they were read from a file, and no submission can "
        "be run again."
    ) in worst
    events, original = (
        json.loads(cli.ok("events", run, "--data", kitti, "--json", "-")) for run in (from_file, finished)
    )
    assert events["counts"] == original["counts"]
    at = ("--scene", "0001", "--at", "5")
    cli.ok("view", from_file, "--data", kitti, *at, "--png", tmp_path / "a.png")
    cli.ok("video", from_file, "--data", kitti, "--scene", "0001", "-o", tmp_path / "a.gif")
    assert (tmp_path / "a.png").stat().st_size > 0


def test_a_run_without_tracks_has_no_tracking_numbers(
    cli: CommandLine, untracked: Path, finished: Path, card: str, kitti: str
) -> None:
    assert rows_of(untracked, card, kitti)[0]["error"] == rows_of(finished, card, kitti)[0]["error"]
    report = stored.score(untracked, RunOptions(kitti)).report
    (detail,) = report.details
    assert {*detail.own_events.values(), *detail.own.values(), detail.guessed_parents} == {None}
    assert {*detail.tracking.all.model_dump().values(), detail.tracking.false_tracks} == {None}
    assert {row["identity_switches"] for row in report.per_scene()} == {None}
    full = cli.ok("score", untracked, "--data", kitti, "--full")
    line = next(line for line in _table(full, "Tracking of the first seed") if line.startswith("untracked"))
    assert set(line.split()[3:]) == {"–"}, line
    tracked = cli.ok("score", finished, "--data", kitti, "--full")
    line = next(line for line in _table(tracked, "Tracking of the first seed") if line.startswith("stp"))
    assert "–" not in line


def _table(printed: str, title: str) -> list[str]:
    return printed.partition(title)[2].split("\n\n")[0].splitlines()


def test_one_tracked_scene_is_enough(finished: Path, card: str, kitti: str) -> None:
    opened = open_run(finished, kitti)
    scores = run_scores(opened)
    (run,) = scores.seeds
    some = (run[0], *(replace(score, has_tracks=False) for score in run[1:]))
    (detail,) = summarise([AgentScores("stp", 1, scores.samples, "equal", (some,))], opened.card).details
    assert detail == summarise([scores], opened.card).details[0]


def test_events_of_a_run_without_tracks_are_not_counted(
    cli: CommandLine, untracked: Path, tmp_path: Path, kitti: str
) -> None:
    printed = cli.ok("events", untracked, "--data", kitti, "--json", tmp_path / "a.json")
    assert "– identity switches, – lost, – reacquired, as no track is stated; " in printed
    assert " in " not in printed.splitlines()[-1].partition("false forecast")[2].partition(";")[0]
    counts = json.loads((tmp_path / "a.json").read_text())["counts"]
    assert {counts[name] for name in ("ids", "lost", "wrong", "reacquired", "spurious")} == {None}
    assert counts["collision"] == 0
