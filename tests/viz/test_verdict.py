"""Sentences and tables from reports made by hand."""

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from mtp_bench import load_submission
from mtp_bench.core import Table, to_json, to_latex, to_text
from mtp_bench.scoring import SUBSETS, Report
from mtp_bench.scoring.report_tables import main_table
from mtp_bench.scoring.rows import PairedRow, Row
from mtp_bench.viz.terminal.chosen_table import chosen_table
from mtp_bench.viz.terminal.notes import notes, warnings
from mtp_bench.viz.terminal.output import TEXT_WIDTH, show, show_command, show_lines, show_table
from mtp_bench.viz.terminal.paper import paper_errors
from mtp_bench.viz.terminal.tables import full_tables, paper_table
from mtp_bench.viz.terminal.verdict import CONTROL_DRAWS, short_verdict, verdict
from tests.support.command_line import TERMINAL
from tests.support.report_rows import detail, pair, row, rows

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
CLEAR_TEXT = "95 % −0.600 to −0.200, p = 0.010"
CHANCE = {"error": 0.1, "interval": (-0.1, 0.3), "p": 0.2}
CHANCE_TEXT = "95 % −0.100 to +0.300, p = 0.200, could be chance"
AGAINST: dict[str, tuple[dict[str, Any], str, str]] = {  # values, difference, and cost of the agent's control
    "clear": (CLEAR, f"−0.400 m, {CLEAR_TEXT}", "+0.400 m (95 % +0.200 to +0.600, p = 0.010)"),
    "chance": (
        CHANCE, f"+0.100 m, {CHANCE_TEXT}", "−0.100 m (95 % −0.300 to +0.100, p = 0.200, could be chance)"
    ),
    "one recording": (
        {"error": -0.4, "interval": None, "p": 1.0}, "−0.400 m, too few recordings for an interval",
        "+0.400 m (too few recordings for an interval)",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("values", "difference", "cost"), AGAINST.values(), ids=AGAINST)
def test_an_agent_and_ground_truth_tracks_against_stp(values: dict[str, Any], difference: str, cost: str) -> None:
    paired = [pair(agent, "stp", **values) for agent in (TRUTH, MINE)]
    sentences = verdict(report(rows(TRUTH, STP, MINE), paired), ["mine"])
    assert sentences[0] == f"Over all targets detection and tracking together cost {cost}."
    assert f"mine (H = 3) against stp, one hypothesis with k samples: over all targets {difference}." in sentences


def test_what_association_costs_is_said_of_perfect_association_alone() -> None:
    paired = [pair(TRUTH, "stp", subset, **CLEAR) for subset in ("all", "ids")]
    paired += [pair(PERFECT, "stp_same_samples", "ids", **CHANCE)]
    (sentence,) = verdict(report(rows(STP), paired), ["stp"])
    first, second, *bound = sentence.split(". ")
    assert first.startswith("Over all targets detection and tracking together cost ")
    assert second.endswith(f", of which association {AGAINST['chance'][2]}")
    assert bound[-1] == "It is a lower bound: duplicate detections still make switches."


def test_an_agent_against_the_controls_with_one_hypothesis() -> None:
    paired = [
        pair(MTP, "stp_same_samples", "all", **CHANCE),
        pair(MTP, "stp_same_samples", "ids", **CLEAR),
        pair(MTP, "stp_neighbours", "ids", **CLEAR),
        pair(("mtp", 5, 20, "equal"), "stp_neighbours", "ids", **CHANCE),  # the most hypotheses are stated
    ]
    samples, neighbours = verdict(report(rows(MTP), paired), ["mtp"])
    assert samples.startswith(f"mtp (H = 20) against stp_same_samples, one hypothesis with {CONTROL_DRAWS} times k ")
    assert samples.endswith(
        f": over all targets {AGAINST['chance'][1]}; on identity switches {AGAINST['clear'][1]}."
    )  # fmt: skip
    assert neighbours.startswith("mtp (H = 20) against stp_neighbours, as many, a third of them a near neighbour's")
    assert neighbours.endswith(f": on identity switches {AGAINST['clear'][1]}.")
    control = load_submission("stp_same_samples")
    assert control.parameters[str(control.compare.draws)] == CONTROL_DRAWS


def test_one_sentence_says_what_perfect_association_and_hypotheses_win() -> None:
    association = pair(PERFECT, "stp_same_samples", "ids", **CLEAR)
    paired = [association, pair(MTP, "stp_same_samples", "ids", **CLEAR), pair(MTP, "stp_neighbours", "ids", **CHANCE)]
    won = "wins 0.400 m against stp_same_samples (95 % 0.200 to 0.600, p = 0.010)"
    assert short_verdict(report(rows(MTP), paired), ["mtp"]) == (
        f"On identity switches perfect association {won}; mtp {won} and loses 0.100 m against stp_neighbours (95 % "
        "−0.100 to 0.300, p = 0.200, could be chance)."
    )
    assert short_verdict(report(rows(MINE), [association]), ["mine"]) == ""


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
    assert lines_of(render(tables["paper"]), "mtp")[0] == [
        "mtp", "20", "0.123/0.234", "0.162/0.238", "0.123/0.234", "0.747/1.173", "0.123/0.234", "1.335/1.688",
    ]  # fmt: skip


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


def test_columns_and_subsets_of_a_table_can_be_chosen() -> None:
    known = report([*rows(MTP), *rows(FREE)])
    table = chosen_table(known, ["MOTA", "error", "interval", "samples"], ["ids", "all"], all_settings=False)
    assert [column.key for column in table.columns] == [
        "agent", "hypotheses", "samples", "ids_error", "ids_interval", "error", "interval", "MOTA",
    ]  # fmt: skip
    assert r"mtp & 20 & 20 & 0.345 [0.310, 0.380] & 0.345 [0.310, 0.380] & 0.890 \\" in to_latex(table)
    assert len(chosen_table(known, ["error"], ["all"], all_settings=True).rows) == 2


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


# ---- the paper
def test_the_figures_of_the_paper() -> None:
    assert paper_errors("MTP-KITTI-v0", row(STP, "all"))["ids"] == [2.820, 4.514]
    assert paper_errors("MTP-KITTI-v0", row(MTP, "all"))["ids"] == [0.747, 1.173]
    assert paper_errors("MTP-KITTI-v0", row(FREE, "all"))["ids"] == [0.707, 1.093]
    assert paper_errors("MTP-KITTI-v0", row(("mtp", 7, 20, "equal"), "all")) == {}
    assert paper_errors("MTP-WILDTRACK-v0", row(STP, "all")) == {"all": [1.024, 1.335]}


def test_the_paper_stands_beside_its_own_scenes_alone() -> None:
    known = report([*rows(TRUTH), *rows(STP), *rows(MTP)], env="MTP-nuScenes-v0")
    own = replace(known, condition={**known.condition, "card": "0" * 64})
    assert ("the paper's" in notes(known)[0], "13.89" in render(paper_table(known))) == (True, True)
    assert ("the paper's" in notes(own)[0], "13.89" in render(paper_table(own))) == (False, False)
    assert "the paper's" not in notes(report(rows(MINE)))[0]  # the paper has no such agent


def test_every_figure_of_the_paper_is_in_its_table(repository: Path) -> None:
    text = (repository / "mtp_bench/viz/terminal/paper.toml").read_text()
    figures = re.findall(r"^(\w+) = \[([\d.]+), ([\d.]+)\]$", text, flags=re.MULTILINE)
    assert len(figures) == 42  # KITTI 23, nuScenes 17, WILDTRACK 2
    assert all(float(ade) < float(fde) for _, ade, fde in figures)
