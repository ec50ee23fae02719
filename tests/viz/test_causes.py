"""The table of causes: stages in order of their cost, and columns worked out a second time from the tables of the run."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import mtp_bench
from mtp_bench.agent.loader import load_submission
from mtp_bench.cards import load_card
from mtp_bench.running.stored import open_run
from mtp_bench.scoring.parts import BELOW_THRESHOLD, LEAST_SHOWN, PART_NAMES, PARTS, STAGE_PARTS, by_fault
from mtp_bench.sources import open_source
from mtp_bench.viz.causes import TEMPLATES, Cause, causes_of, happened, headline, sentence
from mtp_bench.viz.focus import Focus
from mtp_bench.viz.moment_list import find_incident, moments
from mtp_bench.viz.part_ranking import ranked_parts
from mtp_bench.viz.played import PlayedRun
from mtp_bench.viz.run_replay import Replay, replay
from tests.support.focus_scenes import CARD, EVENT, crowd, told
from tests.support.runs import run_scenes
from tests.support.scoring_scenes import Thing, line, make_rollout, make_scene, random_case, with_detections

from ..support.planted_faults import write_log


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Replay:
    folder = tmp_path_factory.mktemp("planted")
    mtp_bench.run("stp", "MTP-nuScenes-mini-v0", folder / "run", files=write_log(folder / "logs"))
    opened = open_run(folder / "run")
    return PlayedRun(opened).replay(opened.first())


def check(focus: Focus) -> None:
    """Check order and costs of the causes of an event, and their columns."""
    causes, parts = causes_of(focus), focus.at.parts
    assert sentence(focus).startswith(happened(focus))
    if focus.at.kind in ("ids", "lost"):
        assert f"track {focus.at.old_id} " in happened(focus)
    for cause in causes:
        assert cause.reason in TEMPLATES
        check_columns(focus, cause)
    if parts is None:
        assert all(cause.cost_m is None for cause in causes)
        return
    costs = [cause.cost_m or 0.0 for cause in causes]
    assert all(cost in parts.values() and cost >= LEAST_SHOWN for cost in costs[1:])
    same_stage = [cost for cost, cause in zip(costs, causes, strict=True) if cause.stage == causes[0].stage]
    assert not causes or costs[0] == max(same_stage)
    assert all(cause.stage == "confidence" for cause in causes if cause.reason in (BELOW_THRESHOLD, "filled budgets"))


def check_columns(focus: Focus, cause: Cause) -> None:
    """Compare columns with the tables of the run."""
    at, values, scene = focus.at, cause.values, focus.replay.scene
    detections, place = scene.detections, focus.place(focus.at.frame)
    boxes = detections.box[detections.rows(at.frame)]
    distances = np.hypot(*(boxes[:, :2] - place).T)
    is_class = detections.class_id[detections.rows(at.frame)] == at.class_id
    if cause.reason == "off place":
        assert values["detection_m"] == pytest.approx(distances[is_class].min())
    if "end_error_m" in values:
        forecast, future = focus.forecast(at.frame), focus.future(at.frame)
        assert forecast is not None
        error = np.hypot(*(forecast.samples[:, len(future) - 2] - future[-1]).T)
        assert np.isclose(error, values["end_error_m"]).any()
        assert values["true_way_m"] == pytest.approx(np.hypot(*(future[-1] - future[0])))
    if cause.reason == "other class" and values:
        assert distances[~is_class].min() <= focus.near_m
    if cause.reason == "not detected now" and values:
        seen = detections.frame_of_rows[focus.replay.detected == at.object_id]
        assert values["last_s"] == focus.seconds(seen[seen <= at.frame].max())
    if cause.reason == "mistaken class":
        near = scene.truth.box[scene.truth.rows(at.frame), :2]
        assert np.isclose(np.hypot(*(near - place).T), values["distance_m"]).any()


@settings(derandomize=True, deadline=None, max_examples=12)
@given(st.integers(0, 10_000))
def test_causes_of_random_scenes(seed: int) -> None:
    run = replay(*random_case(seed), CARD)
    for at in (*run.incidents, *(moment.at for moment in moments(run))):
        check(Focus(run, at))


@pytest.mark.data
@pytest.mark.parametrize(("env_id", "scenes"), [("MTP-KITTI-v0", slice(6, 7)), ("MTP-PETS-v0", slice(1))])
def test_causes_of_recordings(env_id: str, scenes: slice, data_root: Path) -> None:
    card, submission = load_card(env_id), load_submission("stp")
    names = open_source(card, str(data_root)).names[scenes]
    make = submission.factory(submission.parameters)
    (run,) = run_scenes(make, env_id, {"data": str(data_root)}, names, finish=replay)
    for at in (*run.incidents, *(moment.at for moment in moments(run)[:20])):
        check(Focus(run, at))


PARTS_OF = st.dictionaries(st.sampled_from([*PART_NAMES.values()]), st.floats(-5.0, 10.0))


@settings(derandomize=True)
@given(PARTS_OF)
def test_the_first_stage_has_the_largest_sum(parts: dict[str, float]) -> None:
    ordered = dict(sorted(parts.items(), key=lambda part: (part[0] == BELOW_THRESHOLD, -part[1])))
    first = ranked_parts(ordered, is_borrowed=False)[:1]
    stages = [stage for stage, size in by_fault(ordered).items() if size >= LEAST_SHOWN]
    assert bool(first) == bool(stages)
    for stage, reason, cost in first:
        assert stage == next((stage for stage in stages if stage != "confidence"), "confidence")
        assert reason == next(name for name in ordered if name in STAGE_PARTS[stage])
        assert cost > 0
    assert all(stage != "tracker" or name == "association" for stage, name, _ in ranked_parts(parts, is_borrowed=True))


def test_planted_faults(planted: Replay) -> None:
    titles = {"missed": "detector: not detected now", "mistaken": "detector: other class", "turning": "predictor"}
    for name, title in titles.items():
        focus = Focus(planted, find_incident(planted, name))
        assert headline(focus) == title
        check(focus)
    (cause,) = causes_of(Focus(planted, find_incident(planted, "mistaken")))
    assert cause.values["detected_class"] == "pedestrian"


def test_an_agent_that_forecasts_nothing(tmp_path: Path) -> None:
    """It is to blame, not the detector that missed the objects as well."""
    mtp_bench.run("blind", "MTP-nuScenes-mini-v0", tmp_path / "run", files=write_log(tmp_path / "logs"))
    opened = open_run(tmp_path / "run")
    blind = PlayedRun(opened).replay(opened.first())
    found = moments(blind)
    assert found
    for moment in found:
        assert (moment.fault, moment.cause, moment.borrowed) == ("tracker", "no forecast", False)
        assert sentence(Focus(blind, moment.at)).endswith("m: blind forecasts nothing in this scene")


CONFIDENCES = {
    "sure": (0.7, "confidence: filled budgets", (9, 10, 1.0)),
    "unsure": (0.3, "confidence: below threshold", (9, 10, 1.0)),
}


@pytest.mark.parametrize(("confidence", "title", "columns"), CONFIDENCES.values(), ids=CONFIDENCES)
def test_forecasts_that_budgets_leave_out(
    planted: Replay, confidence: float, title: str, columns: tuple[int, int, float]
) -> None:
    part, worth = planted.part.copy(), planted.worth.copy()
    row = int(np.flatnonzero(np.isfinite(worth[:, 0]) & np.isfinite(part[:, 0]))[0])
    part[row] = 9.0 * (np.array(PARTS) == BELOW_THRESHOLD)
    worth[row, 1] = confidence
    thresholds = np.append(np.linspace(1.0, 0.8, 9), 0.0)
    run = replace(planted, part=part, worth=worth, thresholds=thresholds)
    focus = Focus(run, run.moment(row))
    (cause,) = causes_of(focus)
    assert (headline(focus), cause.cost_m) == (title, 9.0)
    least = cause.values["least_confidence"]
    assert (cause.values["budgets_without"], cause.values["budgets"], least) == (*columns[:2], pytest.approx(0.8))
    never = replace(run, thresholds=np.full(3, np.inf))
    assert causes_of(Focus(never, run.moment(row)))[0].values["least_confidence"] == columns[2]
    assert causes_of(Focus(replace(run, thresholds=None), run.moment(row)))[0].values == {}


def false_forecasts() -> Iterator[tuple[str, Replay]]:
    """A car that is detected and forecast as a pedestrian, one forecast twice, and one where no car is."""
    truth = line([5] * 8)
    wrong = [[Thing(1, t, 0.2, class_id=1, forecast=[[[t, 0.0]] * 3])] for t in range(8)]
    yield (
        "detector: mistaken class",
        replay(with_detections(make_scene(truth), wrong), make_rollout(wrong, wrong), CARD),
    )
    twice = [[Thing(i, t, 0.3 * i, forecast=[[[t, 0.0]] * 3], confidence=1 / i) for i in (1, 2)] for t in range(8)]
    yield "tracker: second forecast", replay(make_scene(truth), make_rollout(twice, twice), CARD)
    ghost = [[Thing(8, 50.0, 50.0, forecast=[[[50.0, 50.0]] * 3])] for t in range(8)]
    yield (
        "detector: false detection",
        replay(with_detections(make_scene(truth), ghost), make_rollout(ghost, ghost), CARD),
    )
    yield "tracker: no detection", replay(make_scene(truth), make_rollout(ghost, ghost), CARD)


def test_false_forecasts() -> None:
    for title, run in false_forecasts():
        focus = Focus(run, run.incident("spurious-0"))
        assert headline(focus) == title
        check(focus)


TRACKS: dict[str, tuple[list[Any], str, str]] = {  # tracks of car 5, event, text
    "a switch": ([1, 1, 1, 2, 2, 2, 2, 2], "ids-0", "at 0.3 s car 5 changes from track 1 to track 2"),
    "a loss": ([1, 1] + [None] * 6, "lost-0", "at 0.2 s car 5 loses track 1 for good"),
    "a gap": ([1, 1, None, None, 1, 1, 1, 1], "lost-0", "at 0.2 s car 5 loses track 1 for 0.2 s"),
    "its own track": ([1, 1, None, None, 1, 1, 1, 1], "reacquired-0", "car 5 is found again by track 1, before track 1"),
}  # fmt: skip


@pytest.mark.parametrize(("tracks", "name", "text"), TRACKS.values(), ids=TRACKS)
def test_what_happened(tracks: list[Any], name: str, text: str) -> None:
    assert text in told(line([5] * 8), line(tracks), name)


def test_a_moment_has_the_name_of_its_event() -> None:
    run = crowd(ahead=12.0)
    row = run.incident("ids-0").row
    focus = Focus(run, run.moment(row))
    assert happened(focus).startswith("5@4, ids-0: at 0.4 s car 5 changes")
    assert headline(focus) == "forecast: rest", "without references the error is not split"
    assert focus.at.frame == EVENT
    last = Focus(run, run.moment(int(np.flatnonzero(np.isnan(run.part[:, 0]))[-1])))
    assert headline(last) == "not a target"
