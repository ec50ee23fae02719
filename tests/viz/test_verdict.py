"""Sentences and tables from reports made by hand."""

import io
from dataclasses import replace
from typing import Any

import pytest
from rich.console import Console

from mtp_bench.core import Table, to_json, to_latex, to_text
from mtp_bench.scoring import SUBSETS, Report
from mtp_bench.scoring.report_tables import main_table
from mtp_bench.scoring.rows import PairedRow, Row
from mtp_bench.viz.terminal.notes import warnings
from mtp_bench.viz.terminal.output import TEXT_WIDTH, show, show_command, show_lines, show_table
from mtp_bench.viz.terminal.settings_table import settings_table
from mtp_bench.viz.terminal.tables import full_tables
from mtp_bench.viz.terminal.verdict import cost_lines, verdict
from tests.support.command_line import TERMINAL
from tests.support.report_rows import detail, pair, rows

STP, TRUTH, CONTROL = ("stp", 1, 20, "equal"), ("gt_tracks", 1, 20, "equal"), ("stp_same_samples", 1, 20, "equal")
PERFECT = ("perfect_association_same_samples", 1, 20, "equal")
MTP, MINE = ("mtp", 20, 20, "equal"), ("mine", 3, 20, "equal")
FREE = ("mtp", 20, 400, "free")


def report(table: list[Row], paired: list[PairedRow] | None = None, env: str = "MTP-KITTI-v0") -> Report:
    settings = dict.fromkeys((r.agent, r.hypotheses, r.samples, r.budget) for r in table)
    condition = {"truth": "complete", "weights": "none"}
    return Report(env, "2.0", table, paired or [], [detail(setting) for setting in settings], condition)


# ---- sentences
CLEAR = {"error": -0.4, "interval": (-0.6, -0.2), "p": 0.01}
CHANCE = {"error": 0.1, "interval": (-0.1, 0.3), "p": 0.2}
AGAINST: dict[str, tuple[dict[str, Any], str]] = {  # difference to stp, and cost of detection and tracking
    "clear": (CLEAR, "+0.400 m (95 % +0.200 to +0.600, p = 0.010)"),
    "chance": (CHANCE, "−0.100 m (95 % −0.300 to +0.100, p = 0.200, could be chance)"),
    "one recording": ({"error": -0.4, "interval": None, "p": 1.0}, "+0.400 m (too few recordings for an interval)"),
}


@pytest.mark.parametrize(("values", "cost"), AGAINST.values(), ids=AGAINST)
def test_what_detection_and_tracking_cost(values: dict[str, Any], cost: str) -> None:
    sentences = cost_lines(report(rows(TRUTH, STP), [pair(TRUTH, "stp", **values)]))
    assert list(sentences) == [f"Over all targets detection and tracking together cost {cost}."]


def test_what_association_costs_is_said_of_perfect_association_alone() -> None:
    paired = [pair(TRUTH, "stp", subset, **CLEAR) for subset in ("all", "ids")]
    paired += [pair(PERFECT, "stp_same_samples", "ids", **CHANCE)]
    (sentence,) = cost_lines(report(rows(STP), paired))
    first, second, *bound = sentence.split(". ")
    assert first.startswith("Over all targets detection and tracking together cost ")
    assert second.endswith(f", of which association {AGAINST['chance'][1]}")
    assert bound[-1] == "It is a lower bound: duplicate detections still make switches."


def test_one_sentence_says_what_perfect_association_and_hypotheses_win() -> None:
    association = pair(PERFECT, "stp_same_samples", "ids", **CLEAR)
    paired = [association, pair(MTP, "stp_same_samples", "ids", **CLEAR), pair(MTP, "stp_neighbours", "ids", **CHANCE)]
    won = "wins 0.400 m against stp_same_samples (95 % 0.200 to 0.600, p = 0.010)"
    assert verdict(report(rows(MTP), paired), ["mtp"]) == (
        f"On identity switches perfect association {won}; mtp {won} and loses 0.100 m against stp_neighbours (95 % "
        "−0.100 to 0.300, p = 0.200, could be chance)."
    )
    assert verdict(report(rows(MINE), [association]), ["mine"]) == ""


def test_few_switches_tell_nothing() -> None:
    association = pair(PERFECT, "stp_same_samples", "ids", error=-6.817, interval=None, p=1.0)
    gain = pair(MTP, "stp_same_samples", "ids", **CLEAR)
    few = report(rows(MTP, effective_objects=19.9), [association, gain])
    assert verdict(few, ["mtp"]) == ""
    assert list(cost_lines(few)) == []


# ---- tables
LARGE = [
    *rows(TRUTH, minADE=0.100, minFDE=0.171),
    *rows(STP, rank_range=(2, 2), gap_closed=0.0),
    *rows(MTP, rank_range=(10, 12), error=12.345, interval=(11.25, 13.75)),
    *rows(FREE, minADE=None, minFDE=None, error=None, interval=None, coverage=None),
    *rows(("a_submission_with_quite_a_long_name noise=0.5", 100, 20, "equal"), minADE=98.765, minFDE=123.456),
]


def render(content: Table, width: int = TEXT_WIDTH) -> str:
    console = Console(file=io.StringIO(), width=width, markup=False, highlight=False)
    show_table(content, console)
    stream: Any = console.file
    return str(stream.getvalue())


def lines_of(text: str, agent: str) -> list[list[str]]:
    """Words of the lines of a rendered table that begin with ``agent``."""
    return [line.split() for line in text.splitlines() if line.split()[:1] == [agent]]


def test_tables_of_80_columns_with_names_of_their_own() -> None:
    paired = [pair(s, "stp", subset, error=-10.5, interval=(-13.123, 10.111), minADE=-10.2)
              for s in (MTP, CONTROL) for subset in SUBSETS]  # fmt: skip
    tables = {table.name: table for table in full_tables(report(LARGE, paired))}
    assert len(tables) == len(list(full_tables(report(LARGE, paired)))), "they are names of files"
    for table in tables.values():
        text = render(table)
        assert max(map(len, text.splitlines())) <= TEXT_WIDTH, text
        assert "…" not in text
        assert '"key": ""' not in to_json(table)
    text = render(tables["settings"])
    assert lines_of(text, "stp")[0] == ["stp", "1", "20", "0.345", "2", "to", "2", "0.345", "2", "to", "2"]
    # other numbers of samples than k have a mark of their own
    assert [line[:3] for line in lines_of(text, "mtp")] == [["mtp", "20", "20"], ["mtp", "20", "400"]]


def test_the_main_table_has_a_row_per_agent_and_thirteen_lines() -> None:
    few = ("mtp", 5, 20, "equal")
    best = rows(MTP, rank_range=(1, 2), error=12.345)
    known = report([*rows(TRUTH, PERFECT, STP, CONTROL), *rows(few, error=0.1), *best, *rows(FREE)])
    lines = to_text(main_table(known)).splitlines()
    assert (len(lines), max(map(len, lines)) <= TEXT_WIDTH) == (13, True)
    assert lines[0] == "MTP-KITTI-v0, 11 scenes, 3 seeds: m, less is better"
    (mtp,) = [line for line in lines if line.startswith("mtp")]
    assert " ".join(mtp.split()) == "mtp 20 12.345 0.31–0.38 1–2 0.12/0.23 90 % 12.345 0.31–0.38 1–2"
    broken = replace(known, failures={"mine": "failed on scene 'x'"}, shown=["mtp", "stp"])
    assert [line.split()[0] for line in to_text(main_table(broken)).splitlines()[4:7]] == ["stp", "mtp", "mine"]
    assert next(warnings(broken)) == "! mine failed on scene 'x'"
    own = {"folder": "logs", "detections": "own detections, settings of x (2 scenes)"}
    title = main_table(replace(known, condition={**known.condition, **own})).title
    assert title == "logs, own detections, 11 scenes, 3 seeds: m, less is better"


def test_a_table_of_settings_has_columns_of_subsets_then_of_agents() -> None:
    known = report([*rows(MTP), *rows(FREE)])
    table = settings_table(known, "chosen", "Chosen", ["MOTA", "error", "interval"], "all", "ids")
    assert [column.key for column in table.columns] == [
        "agent", "hypotheses", "samples", "error", "interval", "ids_error", "ids_interval", "MOTA",
    ]  # fmt: skip
    assert r"mtp & 20 & 20 & 0.345 [0.310, 0.380] & 0.345 [0.310, 0.380] & 0.890 \\" in to_latex(table)
    assert len(table.rows) == 2


def test_names_are_no_markup(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in TERMINAL:
        monkeypatch.delenv(name, raising=False)
    assert "[red]x[/x]" in render(main_table(report(rows(("[red]x[/x]", 1, 20, "equal")))))
    long = "3 scenes in /tmp/[bold]/[/oh] " + "x" * 300
    show(long)
    show_lines(["word " * 20], "- ")
    show_command("mtp-bench view run --scene seq:x:1")  # no emoji either: commands are pasted
    wrapped = ["- " + " ".join(["word"] * 15), "  " + " ".join(["word"] * 5)]
    assert capsys.readouterr().out.splitlines() == [long, *wrapped, "mtp-bench view run --scene seq:x:1"]
