"""Agents side by side: what is run, what is written, and that it stays the same."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent import load_submission
from mtp_bench.cards import Card, load_card
from mtp_bench.core.errors import MtpBenchError, SubmissionError
from mtp_bench.running.comparison import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.running.settings import expand
from mtp_bench.scoring import DEFINITIONS, SUBSETS
from tests.support.command_line import CommandLine, read_json, write_submission

pytestmark = pytest.mark.usefixtures("remembered_weights")
KEYS = [
    "agent", "hypotheses", "samples", "budget", "subset", "minADE", "minFDE", "error", "interval", "localisation",
    "missed", "error_by_score", "cost_ground_truth", "cost_localisation", "cost_history", "cost_association",
    "cost_rest", "cost_below_threshold", "cost_no_forecast", "cost_other_class", "cost_off_place",
    "cost_undetected_new", "cost_undetected_seen", "plain_error", "fixed_error", "energy_score", "coverage",
    "difference_to_stp", "difference_interval", "p", "gap_closed", "gap_interval", "gap_closed_same_predictor",
    "gap_same_predictor_interval", "association_gap_closed", "association_gap_interval", "gap_blank_because",
    "association_gap_blank_because", "place", "rank_range", "unranked_because",
    "targets", "effective_targets", "events", "objects", "effective_objects", "scenes", "effective_units", "seeds",
]  # fmt: skip
CONTROLS = [
    ("gt_tracks", 1, 4, "equal"), ("gt_tracks draws=20", 1, 4, "equal"), ("stp", 1, 4, "equal"),
    ("stp_same_samples", 1, 4, "equal"), ("stp_neighbours", 1, 4, "equal"), ("stp_bends", 1, 4, "equal"),
    ("perfect_association", 1, 4, "equal"), ("perfect_association_same_samples", 1, 4, "equal"),
]  # fmt: skip
MTP = [("mtp", h, 4, "equal") for h in (5, 10, 20)] + [("mtp", h, 4 * h, "free") for h in (5, 10, 20)]


@pytest.fixture(scope="module")
def loaded(card: str) -> Card:
    return load_card(card)


def written(cli: CommandLine, file: Path, card: str, kitti: str, *arguments: object) -> Any:
    cli.ok("compare", *arguments, "--env", card, "--data", kitti, "--seeds", 1, "--json", file)
    return read_json(file)


Once = Callable[..., Any]


@pytest.fixture(scope="module")
def kept() -> dict[tuple[str, ...], Any]:
    """What was compared once: tests must not change it."""
    return {}


@pytest.fixture
def once(kept: dict[tuple[str, ...], Any], cli: CommandLine, tmp_path: Path, card: str, kitti: str) -> Once:
    """The content of a comparison with one process, run for the first test that asks for it."""

    def content(*agents: str) -> Any:
        if agents not in kept:
            kept[agents] = written(cli, tmp_path / "once.json", card, kitti, *agents, "--jobs", 1)
        return kept[agents]

    return content


def test_the_file_has_the_keys_that_others_script_against(once: Once) -> None:
    content = once("stp", "mtp")
    assert list(content) == [
        "env",
        "definitions",
        "rows",
        "condition",
        "paired",
        "details",
        "failures",
        "ms_per_frame",
        "skipped",
        "doubts",
    ]
    assert (content["condition"]["split"], content["condition"]["detector"]) == ("val", "pointrcnn")
    assert (content["env"], content["definitions"], content["skipped"]) == ("MTP-Small-v0", DEFINITIONS, {})
    rows = content["rows"]
    assert all([key for key in row if key in KEYS] == KEYS for row in rows)  # a new metric adds a key
    for row in rows:
        parts = [value for key, value in row.items() if key.startswith("cost_") and value is not None]
        assert sum(parts) == pytest.approx(row["error"] or 0.0, abs=1e-9)
    blocks = [(r["agent"], r["hypotheses"], r["samples"], r["budget"]) for r in rows if r["subset"] == "all"]
    assert (blocks, [row["subset"] for row in rows]) == (CONTROLS + MTP, list(SUBSETS) * len(CONTROLS + MTP))
    everything = rows[0]
    assert (everything["targets"], everything["objects"], everything["scenes"]) == (24, 6, 2)
    assert (everything["events"], everything["unranked_because"]) == (None, "saw the truth")
    assert len(content["ms_per_frame"]) == len(rows)
    assert content["ms_per_frame"][0] > 0


def test_equal_runs_write_equal_bytes(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    files = [tmp_path / f"{jobs}.json" for jobs in (1, 2)]
    for jobs, file in enumerate(files, 1):
        cli.ok("compare", "stp", "--env", card, "--data", kitti, "--jobs", jobs, "--no-times", "--json", file)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_what_an_interpreter_prints_is_short(card: str, kitti: str) -> None:
    comparison = compare(["stp"], card, RunOptions(kitti), full=False)
    report = comparison.report
    shown = [report, comparison.reference, *comparison.settings, *report.tables, *report.rows, *report.paired]
    shown += [*report.details, load_card(card), load_submission("stp"), report.tables[0].setting]
    assert {type(each).__name__: len(repr(each)) for each in shown if len(repr(each)) > 1200} == {}
    assert len(repr(comparison.report.tables)) < 1200
    assert comparison.to_markdown() == report.to_markdown()
    assert comparison.to_markdown().startswith("| agent")
    assert r"\begin{tabular}" in comparison.to_latex()
    assert comparison.to_frame().equals(report.to_frame())


def test_more_seeds_are_more_draws_of_the_same_targets(card: str, kitti: str) -> None:
    runs = [RunOptions(kitti, seeds=seeds) for seeds in ((0,), (1,), (0, 1))]
    one, other, both = (compare([], card, options, full=False).report.to_json()["rows"] for options in runs)
    pair = [next(row for row in rows if row["agent"] == "stp") for rows in (one, other, both)]
    assert [row["targets"] for row in pair] == [24, 24, 24]
    assert pair[0]["error"] != pair[1]["error"]
    assert pair[2]["error"] == pytest.approx((pair[0]["error"] + pair[1]["error"]) / 2)


@pytest.mark.parametrize("names", [["echo", "echo"], ["stp"]], ids=["each other", "a baseline"])
def test_two_submissions_of_one_name_are_refused(names: list[str], tmp_path: Path, card: str, kitti: str) -> None:
    folders = [str(write_submission(tmp_path / str(i), name, body="1 / 0")) for i, name in enumerate(names)]
    with pytest.raises(MtpBenchError, match=f"two submissions are called '{names[0]}': .*give them different names"):
        compare(folders, card, RunOptions(kitti))


H = '[compare]\nhypotheses = "hypotheses"\n'
SWEEPS: dict[str, tuple[str, list[tuple[Any, ...]]]] = {
    "nothing said": ("", [("echo", None, 4, "equal")]),
    "sweep times budgets": (
        H + 'sweep = {hypotheses = [2, 3]}\nsamples = ["equal", "free"]',
        [("echo", 2, 4, "equal"), ("echo", 3, 4, "equal"), ("echo", 2, 8, "free"), ("echo", 3, 12, "free")],
    ),
    "a free row needs more samples than k": (
        H + 'sweep = {hypotheses = [1, 2]}\nsamples = ["free", "equal"]',
        [("echo", 2, 8, "free"), ("echo", 1, 4, "equal"), ("echo", 2, 4, "equal")],
    ),
    "nothing is free with one draw": ('[compare]\nsamples = ["free", "equal"]', [("echo", None, 4, "equal")]),
    "draws count among the free samples": (
        "[parameters]\nhypotheses = 2\n" + H + 'draws = "draws"\nsweep = {draws = [1, 5]}\nsamples = ["free"]',
        [("echo draws=1", 2, 8, "free"), ("echo draws=5", 2, 40, "free")],
    ),
    "only what is not the default shows": (
        "[parameters]\nnoise = 0.5\n[compare]\nsweep = {noise = [0.5, 1.0]}",
        [("echo", None, 4, "equal"), ("echo noise=1.0", None, 4, "equal")],
    ),
}


@pytest.mark.parametrize(("tables", "expected"), SWEEPS.values(), ids=SWEEPS.keys())
def test_the_settings_of_a_submission(tables: str, expected: list[Any], tmp_path: Path, loaded: Card) -> None:
    settings = expand(load_submission(write_submission(tmp_path / "mine", tables=tables)), loaded)
    assert [(s.label, s.hypotheses, s.samples, s.budget) for s in settings] == expected


def test_swept_values_reach_the_agent_and_its_env(tmp_path: Path, loaded: Card) -> None:
    tables = "[parameters]\nnoise = 0.5\n" + H + 'sweep = {hypotheses = [2, 9]}\nsamples = ["free"]'
    small, large = expand(load_submission(write_submission(tmp_path / "mine", tables=tables)), loaded)
    assert small.parameters == {"noise": 0.5, "hypotheses": 2}
    assert small.env_keywords(loaded) == {"samples": 8, "observe": "detections"}
    many = {"samples": 36, "observe": "detections"}
    assert large.env_keywords(loaded) == {**many, "hypotheses": 9}  # the card has 3
    assert replace(large, hypotheses=3).env_keywords(loaded) == many


def test_ends_not_taken_are_told_first(tmp_path: Path, card: str, kitti: str, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_submission(tmp_path / "echo", tables="[compare]\ngap_references = { hypotheses = 1 }\n")
    agent = folder / "agent.py"
    agent.write_text(agent.read_text().replace(", **parameters", ""))
    monkeypatch.setattr("mtp_bench.running.comparison.EnvEvaluation.scores", None)
    text = "agent 'echo' cannot be built: unknown parameter of echo 'hypotheses': known are noise"
    with pytest.raises(SubmissionError, match=text):
        compare([folder], card, data=kitti)
