"""Sentences and tables from reports made by hand."""

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from mtp_bench import load_submission
from mtp_bench.core import Table, to_latex, to_text
from mtp_bench.scoring import SUBSETS, Report
from mtp_bench.scoring.report_tables import main_table
from mtp_bench.scoring.rows import PairedRow, Row
from mtp_bench.viz.terminal.output import TEXT_WIDTH, show, show_command, show_lines, show_table
from mtp_bench.viz.terminal.paper import paper_figures, paper_gap
from mtp_bench.viz.terminal.tables import chosen_table, full_tables, notes, paper_table, warnings
from mtp_bench.viz.terminal.verdict import CONTROL_DRAWS, short_verdict, verdict
from tests.support.command_line import TERMINAL
from tests.support.report_rows import detail, pair, row, rows

STP, TRUTH, CONTROL = ("stp", 1, 20, "equal"), ("gt_tracks", 1, 20, "equal"), ("stp_same_samples", 1, 20, "equal")
MTP, MINE = ("mtp", 20, 20, "equal"), ("mine", 3, 20, "equal")
FREE = ("mtp", 20, 400, "free")
CLEAR = {"interval": (-0.6, -0.2), "p": 0.0123}


def report(table: list[Row], paired: list[PairedRow] | None = None, env: str = "MTP-KITTI-v0") -> Report:
    settings = dict.fromkeys((r.agent, r.hypotheses, r.samples, r.budget) for r in table)
    condition = {"truth": "complete", "weights": "none"}
    return Report(env, "2.0", table, paired or [], [detail(setting) for setting in settings], condition)


CHANCE = ", could be chance"
AGAINST: dict[str, tuple[dict[str, Any], str]] = {
    "clear": ({"interval": (-0.6, -0.2), "p": 0.01}, "−0.400 m, 95 % −0.600 to −0.200, p = 0.010"),
    "chance": ({"interval": (-0.6, 0.2), "p": 0.2}, f"−0.400 m, 95 % −0.600 to +0.200, p = 0.200{CHANCE}"),
    "one recording": ({"interval": None, "p": 1.0}, "−0.400 m, too few recordings for an interval"),
}


@pytest.mark.parametrize(("values", "text"), AGAINST.values(), ids=AGAINST)
def test_an_agent_and_ground_truth_tracks_against_stp(values: dict[str, Any], text: str) -> None:
    paired = [pair(agent, "stp", error=-0.4, **values) for agent in (TRUTH, MINE)]
    sentences = verdict(report(rows(TRUTH, STP, MINE), paired), ["mine"])
    turned = text.replace("−0.400", "+0.400").replace("−0.600 to −0.200", "+0.200 to +0.600")
    turned = turned.replace("−0.600 to +0.200", "−0.200 to +0.600")
    assert sentences[0] == f"Over all targets detection and tracking together cost {turned.replace(' m, ', ' m (')})."
    assert f"mine (H = 3) against stp, one hypothesis with k samples: over all targets {text}." in sentences


def test_what_association_costs_is_said_of_perfect_association_alone() -> None:
    perfect = ("perfect_association_same_samples", 1, 20, "equal")
    paired = [pair(TRUTH, "stp", subset, error=-0.4, interval=(-0.6, -0.2), p=0.01) for subset in ("all", "ids")]
    paired += [pair(perfect, "stp_same_samples", "ids", error=-0.1, interval=(-0.3, 0.1), p=0.2)]
    (sentence,) = verdict(report(rows(STP), paired), ["stp"])
    together = "detection and tracking together cost +0.400 m (95 % +0.200 to +0.600, p = 0.010)"
    assert sentence == (
        f"Over all targets {together}. On identity switches {together}, of which association +0.100 m "
        f"(95 % −0.100 to +0.300, p = 0.200{CHANCE}). The cost of association is that to perfect association of the "
        "same detections. It is a lower bound: duplicate detections still make switches."
    )


def test_an_agent_against_the_controls_with_one_hypothesis() -> None:
    paired = [
        pair(MTP, "stp_same_samples", "all", error=-0.1, interval=(-0.3, 0.1), p=0.4),
        pair(MTP, "stp_same_samples", "ids", error=-0.42, **CLEAR),
        pair(MTP, "stp_neighbours", "ids", error=-0.4, **CLEAR),
    ]
    samples, neighbours = verdict(report(rows(MTP), paired), ["mtp"])
    assert samples == (
        "mtp (H = 20) against stp_same_samples, one hypothesis with 20 times k samples: over all targets −0.100 m, "
        f"95 % −0.300 to +0.100, p = 0.400{CHANCE}; on identity switches −0.420 m, 95 % −0.600 to −0.200, p = 0.012."
    )
    assert neighbours == (
        "mtp (H = 20) against stp_neighbours, as many, a third of them a near neighbour's (hypotheses must gain beyond "
        "both): on identity switches −0.400 m, 95 % −0.600 to −0.200, p = 0.012."
    )


def test_the_control_draws_as_many_samples_as_stated() -> None:
    control = load_submission("stp_same_samples")
    assert control.parameters[str(control.compare.draws)] == CONTROL_DRAWS


def test_the_gap_between_both_reference_pairs_and_in_the_paper() -> None:
    ends = rows(TRUTH, plain_error=1.0) + rows(STP, plain_error=2.0)
    closed = {"gap_closed": 0.345, "gap_interval": (0.101, 0.404), "plain_error": 1.25}
    (sentence,) = verdict(report(ends + rows(MTP, **closed, gap_closed_same_predictor=0.2)), ["mtp"])[-1:]
    shares = "34.5 % (95 % 10.1 % to 40.4 %) over all targets and 34.5 % (95 % 10.1 % to 40.4 %) on identity switches"
    gap = f"the gap between stp and ground-truth tracks by {shares}"
    assert sentence == (
        f"mtp (H = 20) closes {gap}; the same gap with its own predictor and presence by 20.0 % over all targets and "
        "20.0 % on identity switches (in the paper, by minADE on IDS: 76.2 %)."
    )
    more = {"gap_closed_same_predictor": 0.345, "gap_same_predictor_interval": (0.101, 0.404)}
    worse = {"association_gap_closed": -0.1, "association_gap_interval": (-0.3, 0.1)}
    widened = "10.0 % (95 % −10.0 % to 30.0 %)"
    assert verdict(report(ends + rows(MINE, **closed, **more, **worse)), ["mine"])[-1] == (
        f"mine (H = 3) closes {gap}. mine (H = 3) widens the association gap by {widened} over all targets and "
        f"{widened} on identity switches."
    )
    blank = {"gap_blank_because": "no gap", "association_gap_blank_because": "not run"}
    assert verdict(report(ends + rows(MINE, **blank)), ["mine"])[-1] == (
        "mine (H = 3) closes no share of the gap between stp and ground-truth tracks: no gap; the association gap: not "
        "run."
    )


def test_one_sentence_says_what_perfect_association_wins_and_what_hypotheses_win_beyond_both_controls() -> None:
    perfect = ("perfect_association_same_samples", 1, 20, "equal")
    cost = pair(perfect, "stp_same_samples", "ids", error=-0.5, interval=(-0.9, -0.1), p=0.01)
    paired = [
        cost,
        pair(MTP, "stp_same_samples", "ids", error=-0.42, **CLEAR),
        pair(MTP, "stp_neighbours", "ids", error=0.1, interval=(-0.1, 0.3), p=0.2),
    ]
    assert short_verdict(report(rows(MTP), paired), ["mtp"]) == (
        "On identity switches perfect association wins 0.500 m against stp_same_samples (95 % 0.100 to 0.900, p = "
        "0.010); mtp wins 0.420 m against stp_same_samples (95 % 0.200 to 0.600, p = 0.012) and loses 0.100 m against "
        f"stp_neighbours (95 % −0.100 to 0.300, p = 0.200{CHANCE})."
    )
    assert short_verdict(report(rows(MINE), [cost]), ["mine"]) == ""


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


def test_one_table_of_80_columns() -> None:
    paired = [pair(s, "stp", subset, error=-10.5, interval=(-13.123, 10.111), minADE=-10.2)
              for s in (MTP, CONTROL) for subset in SUBSETS]  # fmt: skip
    for table in full_tables(report(LARGE, paired)):
        text = render(table)
        assert max(map(len, text.splitlines())) <= TEXT_WIDTH, text
        assert "…" not in text
    text = render(next(full_tables(report(LARGE))))
    assert lines_of(text, "stp")[0] == ["stp", "1", "20", "0.345", "2", "to", "2", "0.345", "2", "to", "2"]
    # other numbers of samples than k have a mark of their own
    assert [line[:3] for line in lines_of(text, "mtp")] == [["mtp", "20", "20"], ["mtp", "20", "400"]]
    assert lines_of(render(paper_table(report(LARGE))), "mtp")[0] == [
        "mtp", "20", "0.123/0.234", "0.162/0.238", "0.123/0.234", "0.747/1.173", "0.123/0.234", "1.335/1.688",
    ]  # fmt: skip


def test_the_main_table_has_a_row_per_agent_and_thirteen_lines() -> None:
    few = ("mtp", 5, 20, "equal")
    names = [TRUTH, ("perfect_association_same_samples", 1, 20, "equal"), STP, CONTROL]
    known = report([*rows(*names), *rows(few, error=0.1), *rows(MTP, rank_range=(1, 2), error=12.345), *rows(FREE)])
    lines = to_text(main_table(known)).splitlines()
    assert (len(lines), max(map(len, lines)) <= TEXT_WIDTH) == (13, True)
    assert lines[0] == "MTP-KITTI-v0, 11 scenes, 3 seeds: m, less is better"
    (mtp,) = [line for line in lines if line.startswith("mtp")]
    assert " ".join(mtp.split()) == "mtp 20 12.345 0.31–0.38 1–2 0.12/0.23 90 % 12.345 0.31–0.38 1–2"

    broken = replace(known, failures={"mine": "failed on scene 'x'"}, shown=["mtp", "stp"])
    assert [line.split()[0] for line in to_text(main_table(broken)).splitlines()[4:7]] == ["stp", "mtp", "mine"]
    assert next(warnings(broken)) == "! mine failed on scene 'x'"
    own = replace(
        known, condition={**known.condition, "folder": "logs", "detections": "own detections, settings of x (2 scenes)"}
    )
    assert main_table(own).title == "logs, own detections, 11 scenes, 3 seeds: m, less is better"


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
    show("3 scenes in /tmp/[bold]/[/oh] " + "x" * 300)
    assert capsys.readouterr().out == "3 scenes in /tmp/[bold]/[/oh] " + "x" * 300 + "\n"
    show_lines(["word " * 20], "- ")
    assert capsys.readouterr().out == "- " + " ".join(["word"] * 15) + "\n  " + " ".join(["word"] * 5) + "\n"
    show_command("mtp-bench view run --scene seq:x:1")  # no emoji either: commands are pasted
    assert "--scene seq:x:1" in capsys.readouterr().out


def test_the_figures_of_the_paper() -> None:
    assert paper_figures("MTP-KITTI-v0", row(STP, "all"))["ids"] == [2.820, 4.514]
    assert paper_figures("MTP-KITTI-v0", row(MTP, "all"))["ids"] == [0.747, 1.173]
    assert paper_figures("MTP-KITTI-v0", row(FREE, "all"))["ids"] == [0.707, 1.093]
    assert paper_figures("MTP-KITTI-v0", row(("mtp", 7, 20, "equal"), "all")) == {}
    assert paper_figures("MTP-nuScenes-v0", row(("mtp", 20, 10, "equal"), "all"))["frag"] == [8.476, 12.105]
    assert paper_figures("MTP-WILDTRACK-v0", row(STP, "all")) == {"all": [1.024, 1.335]}
    gaps = {"MTP-KITTI-v0": 0.762, "MTP-nuScenes-v0": 0.562}  # protocol, "gap closed"
    for env, gap in gaps.items():
        assert paper_gap(env, row(MTP, "all")) == pytest.approx(gap, abs=5e-4)
    assert paper_gap("MTP-WILDTRACK-v0", row(MTP, "all")) is None


def test_the_paper_stands_beside_its_own_scenes_alone() -> None:
    known = report([*rows(TRUTH), *rows(STP), *rows(MTP)], env="MTP-nuScenes-v0")
    own = replace(known, condition={**known.condition, "card": "0" * 64})
    assert ("the paper's" in notes(known)[0], "13.89" in render(paper_table(known))) == (True, True)
    assert ("the paper's" in notes(own)[0], "13.89" in render(paper_table(own))) == (False, False)
    assert "the paper's" not in notes(report(rows(MINE)))[0]  # the paper has no such agent


def test_every_figure_of_the_paper_is_in_its_table(repository: Path) -> None:
    text = (repository / "mtp_bench/viz/terminal/paper.toml").read_text().split("# Below:")[0]
    figures = re.findall(r"^(\w+) = \[([\d.]+), ([\d.]+)\]$", text, flags=re.MULTILINE)
    assert len(figures) == 42  # KITTI 23, nuScenes 17, WILDTRACK 2
    assert all(float(ade) < float(fde) for _, ade, fde in figures)
