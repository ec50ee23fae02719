"""Texts on forecasts that budgets leave out: the confidence and the threshold, and what fills the budgets."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mtp_bench
from mtp_bench.running.stored import open_run
from mtp_bench.scoring.parts import BELOW, PARTS
from mtp_bench.viz.drawing import report
from mtp_bench.viz.evidence import left_out, verdict
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.played import PlayedRun
from mtp_bench.viz.run_replay import Replay
from mtp_bench.viz.sentences import WORDS, sentence

from ..support.planted_faults import write_log


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Replay:
    """A run of which every forecast is left out at 9 of 10 budgets."""
    folder = tmp_path_factory.mktemp("planted")
    mtp_bench.run("stp", "MTP-nuScenes-mini-v0", folder / "run", files=write_log(folder / "logs"))
    opened = open_run(folder / "run")
    played = PlayedRun(opened).replay(opened.first())
    part = played.part.copy()
    covered = np.isfinite(played.worth[:, 0])
    part[covered] = 0.0
    part[covered, list(PARTS.values()).index(BELOW)] = 9.0
    thresholds = np.append(np.linspace(1.0, 0.9999999, 9), 0.0)
    return replace(played, part=part, thresholds=thresholds)


def focuses(run: Replay) -> Iterator[Focus]:
    events = [event.row for event in run.events]  # whose sentences begin with the event
    for row in np.setdiff1d(np.flatnonzero(np.isfinite(run.worth[:, 0]) & np.isfinite(run.part[:, 0])), events):
        yield Focus(run, run.moment(int(row)))


def with_confidence(run: Replay, confidence: float) -> Replay:
    worth = run.worth.copy()
    worth[np.isfinite(worth[:, 1]), 1] = confidence
    return replace(run, worth=worth)


def test_where_sure_forecasts_are_left_out_the_budgets_are_named(run: Replay) -> None:
    texts = [(verdict(focus), sentence(focus)) for focus in focuses(run)]
    assert len(texts) > 50
    for title, text in texts:
        assert title == "budgets: filled by other forecasts"
        stated, at, of, least = re.findall(
            r"confidence (\S+) is left out at (\d+) of (\d+) budgets, .* to (\S+),", text
        )[0]
        assert (at, of) == ("9", "10")
        assert float(stated) <= float(least)
        assert len(re.sub(r"(which costs \S+ m): .*", r"\1", text.split(". ")[-1]).split()) <= WORDS
        assert "unsure" not in text


def test_where_unsure_forecasts_are_left_out_their_confidence_is_named(run: Replay) -> None:
    focus = next(focuses(with_confidence(replace(run, thresholds=np.array([0.8, 0.45, 0.1])), 0.3)))
    assert verdict(focus) == "confidence: below threshold"
    assert left_out(focus, focus.at.frame) == (
        "of confidence .300 is left out at 2 of 3 budgets, as they keep .450 and more"
    )


def test_budgets_that_keep_no_forecast(run: Replay) -> None:
    focus = next(focuses(with_confidence(replace(run, thresholds=np.array([np.inf, 0.0])), 1.0)))
    assert left_out(focus, focus.at.frame).endswith("left out at 1 of 2 budgets, as they keep none as sure")


def test_a_picture_states_it(run: Replay, monkeypatch: pytest.MonkeyPatch) -> None:
    focus, drawn = next(focuses(run)), list[str]()

    def noted(size: tuple[int, int], heading: Any, marks: Any, remarks: Any, parts: Any) -> Image.Image:
        drawn.extend(text for text, *_ in remarks)
        return Image.new("RGB", size)

    monkeypatch.setattr(report, "column", noted)
    report.picture(focus, focus.at.frame, (1200, 544))
    assert f"Below threshold: a forecast {left_out(focus, focus.at.frame)}." in drawn
