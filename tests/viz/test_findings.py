"""Sentences and tables from reports made by hand."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from mtp_bench.running.reading import skipped_line, total_skipped
from mtp_bench.scoring import SUBSETS, Report
from mtp_bench.scoring.rows import Clear, Details, Errors, PairedRow, Parts, RankRow, Row, Tracking
from mtp_bench.viz.terminal.findings import findings
from mtp_bench.viz.terminal.output import show, show_numbers
from mtp_bench.viz.terminal.tables import (
    displacement_table,
    error_table,
    paper_figures,
    parts_table,
    subset_line,
)
from tests.support.command_line import TERMINAL
from tests.support.stored_records import make_row

Setting = tuple[str, int, int, str]
STP, TRUTH, CONTROL = ("stp", 1, 20, "equal"), ("truth_past", 1, 20, "equal"), ("stp_same_budget", 1, 20, "equal")
MTP = ("mtp", 20, 20, "equal")


def row(setting: Setting, subset: str, **values: Any) -> Row:
    agent, hypotheses, samples, budget = setting
    events = None if subset == "all" else 34
    base = make_row(agent, subset, 0.345, hypotheses=hypotheses, samples=samples, budget=budget, events=events)
    shown = {"minADE": 0.123, "minFDE": 0.234, "coverage": 0.9, "interval": [0.31, 0.38], "ms_per_frame": 1.5}
    return Row.model_validate({**base, **shown, **values})


def rows(*settings: Setting, **values: Any) -> list[Row]:
    return [row(setting, subset, **values) for setting in settings for subset in SUBSETS]


def changed(old: Row, **values: Any) -> Row:
    return old.model_copy(update=values)


def pair(setting: Setting, other: str, subset: str = "all", **values: Any) -> PairedRow:
    base: dict[str, Any] = {
        "agent": setting[0], "hypotheses": setting[1], "samples": setting[2], "other": other, "subset": subset,
        "missing_aware": None, "interval": None, "p": 0.5, "minADE": None, "minADE_interval": None, "targets": 40,
        "shared": 30, "scenes": 11, "gap_interval": None,
    }  # fmt: skip
    return PairedRow.model_validate({**base, **values})


def detail(setting: Setting) -> Details:
    """Details of which only those have a value that are shown."""
    tracking = Clear.model_construct(MOTA=0.89)
    return Details.model_construct(
        agent=setting[0], hypotheses=setting[1], samples=setting[2], budget=setting[3],
        parts=Parts(localisation=0.567, missed=0.678, false=None), spurious_per_frame=None, EPA=0.78,
        forecasts_per_frame=12.3, silence=20.0, tracking=Tracking.model_construct(all=tracking),
        own_events={"ids": 34, "lost": 462}, own={"all_h_ids": Errors.model_construct(targets=17)},
    )  # fmt: skip


def report(table: list[Row], paired: list[PairedRow] | None = None, ranks: list[RankRow] | None = None) -> Report:
    settings = dict.fromkeys((r.agent, r.hypotheses, r.samples, r.budget) for r in table)
    return Report("MTP-KITTI-v0", "1.0", table, ranks or [], paired or [], [detail(setting) for setting in settings])


def test_the_gap_that_is_closed() -> None:
    table = rows(STP, TRUTH) + rows(CONTROL, gap_closed=0.123) + rows(MTP, gap_closed=0.345)
    known = pair(MTP, "stp", gap_interval=[0.101, 0.404])
    assert (
        "all: MTP (H = 20, equal k) closes 34 % of the gap between STP and true pasts (95 % interval 10 to 40 %, 11 "
        "scenes); as many samples from one hypothesis close 12 %."
    ) in findings(report(table, [known]))
    no_gap, too_few = (rows(STP, TRUTH, CONTROL, MTP), [known]), (table, [pair(MTP, "stp")])
    for given, paired in (no_gap, too_few):
        assert not any("closes" in sentence for sentence in findings(report(given, paired)))


NOTHING_TO_SAY: dict[str, tuple[list[Row], list[PairedRow]]] = {
    "no rows": ([], []),
    "one agent": (rows(("mine", 1, 20, "equal")), []),
    "no error of true pasts": ([row(TRUTH, "ids", minADE=None), row(STP, "ids", minADE=0.5)], []),
    "no error of tracks": ([row(TRUTH, "ids", minADE=0.1), row(STP, "ids", minADE=None)], []),
    "no error to divide by": ([row(TRUTH, "ids", minADE=0.0), row(STP, "ids", minADE=0.5)], []),
    "free samples": ([row(TRUTH, "ids", minADE=0.1), row(("stp", 1, 400, "free"), "ids", minADE=0.01)], []),
    "a gain without a control": (rows(MTP), [pair(MTP, "stp", minADE=-0.1)]),
    "a control without a number": (rows(MTP), [pair(MTP, "stp", minADE=-0.1), pair(CONTROL, "stp", minADE=None)]),
}


@pytest.mark.parametrize(("table", "paired"), NOTHING_TO_SAY.values(), ids=NOTHING_TO_SAY)
def test_nothing_is_said_without_the_numbers(table: list[Row], paired: list[PairedRow]) -> None:
    assert findings(report(table, paired)) == []


@pytest.mark.parametrize("subset", ["ids", "lost", "reacquired"])
def test_what_tracking_errors_cost(subset: str) -> None:
    table = [
        row(TRUTH, subset, minADE=0.11, targets=34, objects=28),
        row(STP, subset, minADE=0.55, targets=34, objects=28),
    ]
    assert findings(report(table)) == [
        f"{subset}: minADE is 0.55 m from tracks and 0.11 m from true pasts (5.0 times), 34 targets on 28 objects."
    ]


WHO = "all: MTP (H = 20, equal k)"
ONE = "as many samples from one hypothesis"
OF = "of the global gain is sampling"
GLOBAL = {
    "a part is sampling": (
        -0.020,
        -0.013,
        f"{WHO} lowers minADE by 0.020 m; {ONE} lower it by 0.013 m. So 65 % {OF}, not hypotheses.",
    ),
    "more than all of it is sampling": (
        -0.020,
        -0.024,
        f"{WHO} lowers minADE by 0.020 m; {ONE} lower it by 0.024 m. So 120 % {OF}, not hypotheses.",
    ),
    "none of it is sampling": (
        -0.020,
        0.004,
        f"{WHO} lowers minADE by 0.020 m; {ONE} do not lower it (+0.004 m): none {OF}.",
    ),
    "no gain": (0.003, -0.013, f"{WHO} does not lower minADE (+0.003 m)."),
}


@pytest.mark.parametrize(("gain", "sampling", "sentence"), GLOBAL.values(), ids=GLOBAL.keys())
def test_the_share_of_sampling(gain: float, sampling: float, sentence: str) -> None:
    paired = [pair(MTP, "stp", minADE=gain), pair(CONTROL, "stp", minADE=sampling)]
    assert findings(report(rows(MTP), paired)) == [sentence]


def test_a_single_sample_has_no_control_of_sampling() -> None:
    """One sample per object is a mean: the same-budget control says what STP says."""
    single = ("mtp", 20, 1, "equal")
    table = rows(("stp", 1, 1, "equal"), ("truth_past", 1, 1, "equal"), gap_closed=0.0)
    table += rows(("stp_same_budget", 1, 1, "equal"), gap_closed=0.0) + rows(single, gap_closed=0.345)
    paired = [pair(single, "stp", minADE=-0.1, gap_interval=[0.1, 0.5]), pair(CONTROL, "stp", minADE=0.0)]
    text = " ".join(findings(report(table, paired)))
    assert "closes 34 % of the gap" in text
    assert "as many samples" not in text


def test_the_largest_number_of_hypotheses_with_equal_k_is_spoken_of() -> None:
    small, free = ("mtp", 5, 20, "equal"), ("mtp", 40, 800, "free")
    paired = [pair(s, "stp", minADE=value) for s, value in ((small, -0.1), (MTP, -0.2), (free, -0.3))]
    paired.append(pair(CONTROL, "stp", minADE=-0.1))
    (sentence,) = findings(report(rows(small, MTP, free), paired))
    assert sentence.startswith("all: MTP (H = 20, equal k) lowers minADE by 0.200 m")


CERTAINTY: dict[str, tuple[dict[str, Any], str]] = {
    "clear": (
        {"missing_aware": -0.42, "interval": [-0.6, -0.2], "p": 0.01, "scenes": 8},
        "-0.42 m (95 % interval -0.60 to -0.20, p = 0.010, 8 scenes)",
    ),
    "worse": (
        {"missing_aware": 0.1, "interval": [0.05, 0.2], "p": 0.03, "scenes": 8},
        "+0.10 m (95 % interval +0.05 to +0.20, p = 0.030, 8 scenes)",
    ),
    "covers zero": (
        {"missing_aware": -0.1, "interval": [-0.3, 0.1], "p": 0.4, "scenes": 3},
        "-0.10 m (95 % interval -0.30 to +0.10, p = 0.400, 3 scenes, the interval covers 0)",
    ),
    "one scene": (
        {"missing_aware": -0.1, "interval": None, "p": 1.0, "scenes": 1},
        "-0.10 m (1 scene: too few for an interval)",
    ),
}


@pytest.mark.parametrize(("values", "text"), CERTAINTY.values(), ids=CERTAINTY.keys())
def test_what_hypotheses_add_to_the_control(values: dict[str, Any], text: str) -> None:
    paired = [pair(MTP, "stp_same_budget", "ids", **values)]
    expected = f"ids: beyond the same-budget control MTP (H = 20) changes the missing-aware error by {text}."
    assert findings(report(rows(MTP), paired)) == [expected]


def test_small_subsets_are_named() -> None:
    table = rows(STP)
    table[1], table[3] = changed(table[1], objects=8), changed(table[3], objects=19)
    assert findings(report(table)) == ["Shown but not ranked, with fewer than 20 objects: ids, reacquired."]
    table[0] = changed(table[0], objects=3)  # "all" is no event subset
    assert len(findings(report(table))) == 1


def test_sentences_come_in_one_order() -> None:
    table = [*rows(TRUTH, minADE=0.1), *rows(STP, minADE=0.2), *rows(MTP, objects=1)]
    paired = [pair(MTP, "stp", minADE=-0.02), pair(CONTROL, "stp", minADE=-0.01)]
    paired += [pair(MTP, "stp_same_budget", subset, missing_aware=-0.1) for subset in SUBSETS]
    starts = [sentence.split(" ")[0] for sentence in findings(report(table, paired))]
    assert starts == ["ids:", "lost:", "reacquired:", "all:", "ids:", "lost:", "reacquired:", "Shown"]


def test_the_words_of_skipped_rows() -> None:
    assert total_skipped([{}, {"b": 1}, {"a": 2, "b": 1}]) == {"a": 2, "b": 2}
    assert skipped_line({}) is None
    assert skipped_line({"a": 1}) == "skipped 1 row of the data that cannot be used: a (1)"


LARGE = [
    *rows(TRUTH, minADE=0.100, minFDE=0.171),
    *rows(STP, gap_closed=0.0),
    *rows(MTP, gap_closed=0.198, missing_aware=12.345, interval=[11.25, 13.75]),
    *rows(("mtp", 20, 400, "free"), minADE=None, minFDE=None, missing_aware=None, interval=None, coverage=None),
    *rows(("a_submission_with_quite_a_long_name noise=0.5", 100, 2000, "free")),
]
RANKS = [
    RankRow(agent=s[0], hypotheses=s[1], samples=s[2], subset=subset, rank=rank)
    for s, rank in ((STP, 2), (MTP, 1), (TRUTH, None))
    for subset in SUBSETS
]


def render(content: Any, width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    show_numbers(content, console)
    stream: Any = console.file
    return str(stream.getvalue())


@pytest.mark.parametrize("width", [80, 180])
@pytest.mark.parametrize(
    ("make", "numbers"),
    [
        (
            lambda r: error_table(r, "title"),
            ["0.345", "0.31–0.38", "12.345", "11.25–13.75", "90.0 %", "0.20 / 0.20", "0.00 / 0.00", "– / –", "1.5",
             "2000", "34 events, 40 targets on 25 objects in 11 scenes", "Definitions 1.0"],
        ),
        (
            displacement_table,
            ["0.100 / 0.171", "0.123 / 0.234", "0.747 / 1.173", "2.820 / 4.514", "1.621 / 2.155", "– / –", "0.146 / "],
        ),
        (parts_table, ["0.567", "0.678", "0.78", "0.89", "34", "462", "17", "–"]),
    ],
    ids=["errors", "displacements", "parts"],
)  # fmt: skip
def test_tables_hold_every_number_whatever_the_width(make: Any, numbers: list[str], width: int) -> None:
    text = render(make(report(LARGE, ranks=RANKS)), width)
    for number in [*numbers, "truth_past", "mtp (all samples)", "a_submission_with_quite_a_long_name noise=0.5"]:
        assert number in text, number
    assert "…" not in text


def test_what_cannot_be_measured_is_said_in_words() -> None:
    known = report(LARGE)
    partly = replace(known, condition={"truth": "prediction targets only: false positives are not measurable"})
    assert "not measurable" not in render(parts_table(known), 180)
    row_of = lines_of(render(parts_table(partly), 250), "stp")[0]
    assert row_of[3:10] == ["0.567", "0.678", "not measurable", "12.3", "not measurable", "0.78", "0.89"]
    assert "nobody pays for false forecasts" in render(error_table(partly, "title"), 250)


def test_a_wide_terminal_is_not_filled() -> None:
    table = displacement_table(report(LARGE))
    assert render(table, 180) == render(table, 400)


def lines_of(text: str, agent: str) -> list[list[str]]:
    """Cells of the rows of a rendered table that begin with ``agent``."""
    cells = [[cell.strip() for cell in line.strip("│ ").split("│")] for line in text.splitlines() if "│" in line]
    return [line for line in cells if line[0] == agent]


def test_ranks_stand_beside_ranked_rows_only() -> None:
    text = render(error_table(report(LARGE, ranks=RANKS), "title"), 180)
    rank = {agent: [line[-2] for line in lines_of(text, agent)] for agent in ("truth_past", "stp", "mtp")}
    assert rank == {"truth_past": ["–"], "stp": ["2"], "mtp": ["1"]}
    assert [line[-2] for line in lines_of(text, "mtp (all samples)")] == ["–"]


def test_the_figures_of_the_paper() -> None:
    assert paper_figures("MTP-KITTI-v0", row(STP, "all"))["ids"] == [2.820, 4.514]
    assert paper_figures("MTP-KITTI-v0", row(MTP, "all"))["ids"] == [0.747, 1.173]
    assert paper_figures("MTP-KITTI-v0", row(("mtp", 20, 400, "free"), "all"))["ids"] == [0.707, 1.093]
    assert paper_figures("MTP-KITTI-v0", row(("mtp", 7, 20, "equal"), "all")) == {}
    assert paper_figures("MTP-KITTI-v0", row(CONTROL, "all")) == {}
    assert paper_figures("MTP-KITTI-5Hz-v0", row(STP, "all")) == {}
    assert paper_figures("MTP-nuScenes-v0", row(("mtp", 20, 10, "equal"), "all"))["frag"] == [8.476, 12.105]
    assert paper_figures("MTP-nuScenes-mini-v0", row(STP, "all")) == {}
    assert paper_figures("MTP-WILDTRACK-v0", row(STP, "all")) == {"all": [1.024, 1.335]}


def test_the_counts_of_subsets_in_words() -> None:
    table = rows(STP)
    table[1] = changed(table[1], events=1, targets=1, objects=1, scenes=1)
    lines = subset_line(report(table)).splitlines()
    assert lines[0] == "all: 40 targets on 25 objects"
    assert lines[1] == "ids: 1 event, 1 target on 1 object in 1 scene, not ranked"
    assert lines[2] == "lost: 34 events, 40 targets on 25 objects in 11 scenes"


def test_names_are_no_markup(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in TERMINAL:
        monkeypatch.delenv(name, raising=False)
    assert "[red]run[/x]" in render(error_table(report(LARGE), "[red]run[/x]"), 180)
    show("3 scenes in /tmp/[bold]/[/oh] " + "x" * 300)
    assert capsys.readouterr().out == "3 scenes in /tmp/[bold]/[/oh] " + "x" * 300 + "\n"


def test_every_figure_of_the_paper_is_in_its_table(repository: Path) -> None:
    text = (repository / "mtp_bench/viz/terminal/paper.toml").read_text()
    figures = re.findall(r"^(\w+) = \[([\d.]+), ([\d.]+)\]$", text, flags=re.MULTILINE)
    assert len(figures) == 42  # KITTI 23, nuScenes 17, WILDTRACK 2
    assert all(float(ade) < float(fde) for _, ade, fde in figures)


@pytest.mark.parametrize(
    ("stp", "mtp", "worse"),
    [(20.5, 19.5, "stp"), (20.5, 21.0, "stp, mtp"), (20.0, 19.9, None), (None, 19.0, None)],
    ids=["one", "both", "equal is not worse", "no number"],
)
def test_who_would_score_better_by_saying_nothing(stp: float | None, mtp: float, worse: str | None) -> None:
    # rows of other subsets and with more samples do not count
    table = [
        row(STP, "all", missing_aware=stp),
        row(MTP, "all", missing_aware=mtp),
        row(STP, "ids", missing_aware=99.0),
        row(("free", 20, 400, "free"), "all", missing_aware=99.0),
    ]
    said = [sentence for sentence in findings(report(table)) if "says nothing" in sentence]
    assert said == ([] if worse is None else [said[0]])
    if worse is not None:
        assert f"scores 20.00 m. Worse than that: {worse};" in said[0]
