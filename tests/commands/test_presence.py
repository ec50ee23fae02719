"""A presence model of own detections: confidences that do not come true are named, and a fit mends them."""

from pathlib import Path

import pytest

import mtp_bench
from mtp_bench.prediction.presence import MODELS
from mtp_bench.running.stored import open_run

from ..support.command_line import CommandLine, read_json
from ..support.planted_faults import write_log

ENV = ("--env", "MTP-nuScenes-mini-v0")
pytestmark = pytest.mark.usefixtures("few_event_runs")


def with_ghosts(folder: Path) -> Path:
    """Add three cars that are not there, with half the scores of the others."""
    table = write_log(folder) / "log" / "detections.csv"
    lines = table.read_text().splitlines()
    ghosts = [
        f"{frame},car,{20 + 15 * number},-{30 + 9 * number},0,4.5,1.8,1.6,0.4"
        for frame in range(41)
        for number in range(3)
    ]
    table.write_text("\n".join([*lines, *ghosts]) + "\n")
    return folder


def shown(text: str) -> str:
    return " ".join(text.split())


def test_a_fitted_model_mends_confidences_that_do_not_come_true(cli: CommandLine, tmp_path: Path) -> None:
    logs, model = with_ghosts(tmp_path / "logs"), tmp_path / "mine.json"
    printed = cli.ok("train", "presence", *ENV, "--files", logs, "-o", model)
    assert "boxes of tracks; Brier score on those held out" in printed
    assert {each["scenes"][0] for each in read_json(model)["fitted_on"]} == {"log"}
    note, runs = "the mean confidence is", {}
    for name, option in {"shipped": (), "fitted": ("--presence", model), "scores": ("--presence", "scores")}.items():
        runs[name] = tmp_path / name
        cli.ok("run", "stp", *ENV, "--files", logs, *option, "-o", runs[name])
        assert (note in shown(cli.ok("score", runs[name]))) == (name == "shipped"), name
    report = mtp_bench.score(runs["shipped"]).report
    assert note in str(report)
    assert "--presence scores takes scores as they are" in str(report)
    errors = {name: mtp_bench.score(run).report.details[0].brier or 0.0 for name, run in runs.items()}
    assert 0.0 < errors["fitted"] < errors["scores"] < errors["shipped"]
    stated = {name: open_run(run).run.info.keywords.get("presence") for name, run in runs.items()}
    assert stated == {"shipped": None, "fitted": str(model), "scores": "scores"}


def test_detections_far_from_the_truth_are_not_said_to_need_another_model(cli: CommandLine, tmp_path: Path) -> None:
    logs, run = write_log(tmp_path / "logs"), tmp_path / "run"
    table = logs / "log" / "detections.csv"
    head, *rows = [line.split(",") for line in table.read_text().splitlines()]
    x = head.index("x")
    moved = [[*row[:x], str(float(row[x]) + 500), *row[x + 1 :]] for row in rows]
    table.write_text("\n".join(map(",".join, [head, *moved])) + "\n")
    assert "have no detection of their class within one gate" in cli("run", "stp", *ENV, "--files", logs, "-o", run).err
    printed = shown(cli.ok("score", run))
    assert "no forecast is near a target" in printed
    assert "presence was not fitted" not in printed


def test_a_run_is_scored_without_the_file_of_its_model(cli: CommandLine, tmp_path: Path) -> None:
    logs, model, run = with_ghosts(tmp_path / "logs"), tmp_path / "mine.json", tmp_path / "run"
    model.write_text((MODELS / "default.json").read_text())
    command = ("run", "stp", *ENV, "--files", logs, "--presence", model, "--force", "-o", run)
    cli.ok(*command)
    model.unlink()
    assert "stp" in cli.ok("score", run)
    assert "mine.json, expected one of `mtp-bench train presence`, or the word 'scores'" in shown(cli(*command).err)
