"""``mtp-bench events``: every event with the command that shows it, and a count that is the score's."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.main

from docs.generate import json_keys
from mtp_bench.commands.app import app
from mtp_bench.viz.incident import Incident
from mtp_bench.viz.terminal.event_table import Listed, in_order
from tests.support.command_line import CommandLine, on_terminal, read_json
from tests.support.scoring_scenes import make_scene

ROW = re.compile(r"(\S+) +([\d–]+) +(\S+-\d+\*?) +(.+?) +(\S+ → \S+|\S+) +([\d.–]+) +([\d.–]+) +(.+?) +([\d.–]+) *")


@pytest.fixture
def known(kitti: str) -> list[str]:
    """The options of a run of the small card, whose few boxes are no sound recording."""
    return ["--data", kitti, "--no-doctor"]


def rows_of(printed: str) -> list[list[str]]:
    return [list(row.groups()) for line in printed.splitlines() if (row := ROW.fullmatch(line))]


def test_the_events_are_listed_by_scene_and_frame(cli: CommandLine, events_run: Path, known: list[str]) -> None:
    printed = cli.ok("events", events_run, *known)
    assert rows_of(printed) == [
        ["0001", "4", "ids-0", "car 7", "7 → 8", "–", "2.00", "no forecast 2.0 m", "–"],
        ["0001", "5", "lost-0", "car 7", "8 → –", "–", "2.00", "no forecast 2.0 m", "–"],
        ["0001", "7", "reacquired-0", "car 7", "8 → 8", "–", "–", "–", "–"],
        ["0006", "1–3", "spurious-0", "car", "90", "–", "–", "–", "1.00"],
    ]
    assert printed.splitlines()[-1] == (
        "1 identity switch, 1 lost (0 of them with their track elsewhere), 1 reacquired; 3 false forecasts in "
        "1 run; 3 scenes"
    )


def test_the_costliest_events_come_first() -> None:
    def row(name: str, error: float | None, before: float | None = None, far: float | None = None) -> Listed:
        parts = None if error is None else {"rest": error, "below threshold": 20.0 - error}
        incident = Incident("ids", 1, 1, 0, 0, (0.0, 0.0, 0.0), name, parts=parts, error_before=before, minADE=far)
        return Listed(make_scene([[]]), "car", incident, "")

    rows = [
        row("no target", None), row("cheap", 0.5, 0.0), row("capped", 10.0, 9.0, 30.0),
        row("capped and far", 10.0, 9.0, 40.0), row("capped at once", 10.0, 0.0, 12.0), row("free", 0.0),
    ]  # fmt: skip
    names = [one.incident.name for one in in_order(rows, "cost")]
    assert names == ["capped at once", "capped and far", "capped", "cheap", "free", "no target"]
    assert in_order(rows, "time") == rows


def test_only_the_first_of_them(cli: CommandLine, events_run: Path, known: list[str], tmp_path: Path) -> None:
    arguments = ["--sort", "cost", "--top", "2", "--json", tmp_path / "a.json"]
    printed = cli.ok("events", events_run, *known, *arguments)
    assert [row[2] for row in rows_of(printed)] == ["ids-0", "lost-0"]
    assert printed.splitlines()[-1].startswith("1 identity switch, 1 lost"), "all of them are counted"
    assert [event["event"] for event in read_json(tmp_path / "a.json")["events"]] == ["ids-0", "lost-0"]
    assert cli("events", events_run, *known, "--sort", "error").status == 2
    assert cli("events", events_run, *known, "--top", "0").status == 2


def test_nothing_is_cut_off_at_80_columns(events_run: Path, known: list[str]) -> None:
    printed = on_terminal(80, "events", events_run, *known)
    (command,) = [line for line in printed if line.startswith("mtp-bench view")]  # long, to be pasted
    assert command.endswith(f"--data {known[1]}")
    assert max(len(line) for line in printed if line != command) <= 80
    assert not [line for line in printed if "…" in line]
    assert len(rows_of("\n".join(printed))) == 4


def test_the_command_of_an_event_can_be_pasted(cli: CommandLine, events_run: Path, known: list[str]) -> None:
    printed = cli.ok("events", events_run, *known).splitlines()
    words = shlex.split(next(line for line in printed if line.startswith("mtp-bench view")))
    assert words[:2] == ["mtp-bench", "view"]
    assert words[2:] == [str(events_run), "--scene", "0001", "--at", "ids-0", "--data", known[1]]
    commands: Any = typer.main.get_command(app)
    commands.get_command(None, "view").make_context("view", words[2:])  # parses and checks, runs nothing


def test_only_a_scene_or_a_kind(cli: CommandLine, events_run: Path, known: list[str]) -> None:
    printed = cli.ok("events", events_run, *known, "--scene", "0006")
    assert [row[2] for row in rows_of(printed)] == ["spurious-0"]
    assert printed.splitlines()[-1].endswith("; 1 scene")
    printed = cli.ok("events", events_run, *known, "--kind", "ids", "--kind", "lost")
    assert [row[2] for row in rows_of(printed)] == ["ids-0", "lost-0"]
    printed = cli.ok("events", events_run, *known, "--scene", "0008")
    assert rows_of(printed) == []
    assert printed.startswith("0 identity switches, 0 lost")


def test_the_file_has_what_is_listed(cli: CommandLine, events_run: Path, known: list[str], tmp_path: Path) -> None:
    cli.ok("events", events_run, *known, "--json", tmp_path / "a.json")
    content = read_json(tmp_path / "a.json")
    assert (content["env"], content["agent"], content["scenes"]) == ("MTP-Small-v0", "drawn", 3)
    ones = dict.fromkeys(("ids", "lost", "reacquired", "spurious"), 1) | {"collision": 0}
    assert content["counts"] == {**ones, "wrong": 0, "spurious_forecasts": 3}
    switch, *_, ghost = content["events"]
    assert switch.keys() <= json_keys.EVENT.keys(), "the page of keys explains them"
    assert [type(value) for value in switch.pop("position")] == [float] * 3
    assert switch.pop("view").startswith("mtp-bench view ")
    assert switch == {
        "scene": "0001", "frame": 4, "until": 4, "time": pytest.approx(0.41, abs=0.01), "event": "ids-0", "kind": "ids",
        "object": 7, "class": "car", "old_id": 7, "new_id": 8, "wrong": False, "minADE": None, "error": 2.0,
        "parts": {"no forecast": 2.0}, "object_id": "7", "error_before": 2.0, "confidence": None,
        "old_id_in_file": None, "new_id_in_file": None, "cause": None, "at_fault": None,
    }  # fmt: skip
    assert (ghost["frame"], ghost["until"], ghost["object"], ghost["new_id"]) == (1, 3, None, 90)
