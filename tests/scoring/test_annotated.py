"""Partly annotated scenes: they score as the log cut to its annotated frames, whatever stands between these."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mtp_bench import MTPEnv
from mtp_bench.agent import load_submission
from mtp_bench.cards import Card, load_card, with_files, with_scenes
from mtp_bench.core import UNKNOWN_OBJECT, Detections, Rollout, Scene, starts_of
from mtp_bench.running.playing import run_scene
from mtp_bench.scoring import (
    FrameScorer,
    RecordedForecasts,
    find_targets,
    live_frames,
    score_scene,
    summarise,
    tracking_events,
)
from mtp_bench.scoring.bade import CardBudget
from mtp_bench.scoring.table import agent_table
from mtp_bench.sources import load_scenes
from mtp_bench.sources.files.save import save_scene
from mtp_bench.viz.run_replay import replay
from tests.independent import scorer
from tests.independent.test_agreement import PARTS, SHARED, agent_scores, reference_of, rows_of, same
from tests.support.scoring_scenes import (
    answers_end_to_end,
    at,
    end_to_end,
    make_card,
    make_rollout,
    make_scene,
    random_case,
)
from tests.support.small_scenes import empty_action

Array = NDArray[Any]
STEP = 5
# 10 Hz, every frame annotated: 2 frames of past, 3 of future; the fast log of the same seconds has 50 Hz
CUT = make_card(past=2, future=3)
FAST_FUTURE = 19  # 3 whole steps of 5, with a margin for uneven steps
TASK = CUT.task.model_copy(update={"rate": 50.0, "past": 10, "future": FAST_FUTURE})
FAST = CUT.model_copy(update={"task": TASK})
# differ on purpose: frames that are not annotated are answered and timed, too
OF_ALL_FRAMES = ("frames", "seconds", "invalid", "dropped")


def stretched(cut: Scene, said: Rollout, seed: int, future: int = FAST_FUTURE) -> tuple[Scene, Rollout]:
    """A log in which ``cut`` is what people annotated, and answers of which ``said`` are those in these frames.

    Between the annotated frames, and after them, is noise: tracks and forecasts under other ids at other places, other
    detections, hypotheses in another order. Odd seeds have uneven steps, of 4 to 6 frames.
    """
    rng = np.random.default_rng([7, seed])
    steps = rng.choice([4, 5, 5, 5, 6] if seed % 2 else [STEP], cut.frames - 1)
    frames = np.cumsum([0, *steps])
    count = int(frames[-1]) + 1 + int(rng.integers(0, 4))
    source = np.searchsorted(frames, np.arange(count), side="right") - 1  # annotated frame that each frame resembles
    annotated = np.isin(np.arange(count), frames)
    tail = (cut.time[1] - cut.time[0]) / STEP * np.arange(1, count - frames[-1])
    time = np.interp(np.arange(frames[-1] + 1), frames, cut.time)
    scene = replace(
        cut, time=np.append(time, time[-1] + tail), ego=cut.ego[source], annotated=annotated,
        truth=replace(cut.truth, start=starts_of(np.where(annotated, cut.truth.counts[source], 0))),
        detections=_table(cut.detections, source, annotated, rng),
    )  # fmt: skip
    track, track_start, other_track = _rows(said.tracks, source, annotated)
    thing, thing_start, other_thing = _rows(said.objects, source, annotated)
    track_box = said.track_box[track]
    track_box[other_track, :2] += rng.normal(0, 3, (other_track.sum(), 2))
    object_box = said.object_box[thing]
    object_box[other_thing, :2] += rng.normal(0, 3, (other_thing.sum(), 2))
    parent = rng.permuted(np.tile(np.arange(said.member.shape[1]), (count, 1)), axis=1)
    for place in range(1, len(frames)):
        gap = np.arange(said.member.shape[1])
        for t in range(frames[place - 1] + 1, frames[place]):
            gap = gap[parent[t]]  # the annotated ancestor of each hypothesis of frame t
        parent[frames[place]] = np.argsort(gap)[said.hypothesis_parent[place]]
    sizes = (len(thing), said.forecast.shape[1], future, 2)
    forecast = rng.integers(-3000, 3000, sizes).astype(np.int16)
    frame = np.repeat(np.arange(count), np.diff(thing_start))
    for j in range(said.forecast.shape[2]):
        later = np.append(frames, [-1] * (j + 1))[source[frame] + j + 1]
        row = np.flatnonzero(~other_thing & (later >= 0))
        forecast[row, :, later[row] - frame[row] - 1] = said.forecast[thing[row], :, j]
    rollout = replace(
        said, track_start=track_start, track_id=said.track_id[track] + 7 * other_track, track_box=track_box,
        track_class=said.track_class[track], member=said.member[track], object_start=thing_start,
        hypothesis_log_weight=said.hypothesis_log_weight[source], hypothesis_parent=parent, object_box=object_box,
        object_class=said.object_class[thing], object_confidence=said.object_confidence[thing], forecast=forecast,
        forecast_log_weight=said.forecast_log_weight[thing], invalid=said.invalid[source],
        malformed=said.malformed[source], dropped=said.dropped[source], seconds=said.seconds[source],
    )  # fmt: skip
    return scene, rollout


def _rows(table: Any, source: Array, annotated: Array) -> tuple[Array, Array, Array]:
    """Rows of the frames ``source``, their start, and which are in frames that are not annotated."""
    rows = [np.arange(table.start[s], table.start[s + 1]) for s in source]
    start = starts_of([len(r) for r in rows])
    return np.concatenate(rows), start, ~np.repeat(annotated, np.diff(start))


def _table(seen: Detections, source: Array, annotated: Array, rng: np.random.Generator) -> Detections:
    row, start, other = _rows(seen, source, annotated)
    box = seen.box[row]
    box[other, :2] += rng.normal(0, 3, (other.sum(), 2))
    return Detections(start, box, seen.velocity[row], seen.class_id[row], seen.score[row])


def case(seed: int, frames: int = 14, name: str = "s") -> tuple[Scene, Rollout]:
    """The cut log of a case, with detections, stated parents and malformed rows."""
    cut, said = random_case(seed, frames=frames, name=name)
    rng = np.random.default_rng([8, seed])
    parent = rng.integers(0, 3, said.hypothesis_parent.shape)
    seen = cut.truth.select(rng.random(len(cut.truth.box)) < 0.6)
    box = seen.box.copy()
    box[:, :2] += rng.normal(0, 1, (len(box), 2))
    detections = Detections(seen.start, box, seen.velocity, seen.class_id, rng.random(len(box)))
    malformed = rng.poisson(0.1, (cut.frames, 3))
    weight = said.forecast_log_weight.copy()
    weight[np.isinf(weight).all(axis=1), 0] = 0.0  # an answer without a sample would have been taken out
    said = replace(said, hypothesis_parent=parent, malformed=malformed, forecast_log_weight=weight)
    return replace(cut, detections=detections), said


def assert_equal(fast: Any, cut: Any, frames: Array, where: str = "score", tolerance: float = 1e-9) -> None:
    """Two scores have the same numbers, with the frames of the cut log at ``frames`` of the fast one."""
    if is_dataclass(cut):
        for field in fields(cut):
            if field.name not in OF_ALL_FRAMES:
                values = (getattr(fast, field.name), getattr(cut, field.name))
                name = f"{where}.{field.name}"
                if field.name in ("frame", "until"):
                    np.testing.assert_array_equal(values[0], frames[values[1]], err_msg=name)
                else:
                    assert_equal(*values, frames, name, tolerance)
    elif isinstance(cut, Mapping):
        assert fast.keys() == cut.keys(), where
        for key in cut:
            assert_equal(fast[key], cut[key], frames, f"{where}.{key}", tolerance)
    elif isinstance(cut, np.ndarray | float):
        np.testing.assert_allclose(fast, cut, rtol=tolerance, atol=tolerance, err_msg=where)
    else:
        assert fast == cut, where


@pytest.mark.parametrize("seed", range(12))
def test_the_score_is_that_of_the_cut_log(seed: int) -> None:
    cut, said = case(seed)
    scene, answers = stretched(cut, said, seed)
    score = score_scene(scene, answers, FAST)
    assert min(len(score), score.false_forecasts, score.own_events["ids"], score.own_events["lost"]) > 0
    assert_equal(score, score_scene(cut, said, CUT), scene.annotated_frames)
    np.testing.assert_array_equal(tracking_events(scene, answers, FAST), tracking_events(cut, said, CUT))


@pytest.mark.parametrize("seed", range(4))
def test_nothing_crosses_a_hole_in_time_or_a_gap_between_annotated_frames(seed: int) -> None:
    cuts, saids = zip(*(case(10 * seed + clip) for clip in range(2)), strict=True)
    whole_cut, whole_said = end_to_end(cuts, 0.3), answers_end_to_end(saids)
    want = score_scene(whole_cut, whole_said, CUT)
    even, answers = stretched(end_to_end(cuts, 0.1), whole_said, 2 * seed)
    frames = even.annotated_frames
    hole = frames[cuts[0].frames]
    time = even.time + 0.2 * (np.arange(even.frames) >= hole)
    score = score_scene(replace(even, time=time), answers, FAST)
    assert_equal(score, want, frames)
    assert score.skipped == want.skipped != {}
    # the same frames, of which two at the end of the first clip and the begin of the second are not annotated
    unknown = np.isin(np.arange(even.frames), frames[cuts[0].frames + np.array([-1, 0])])
    truth = even.truth.select(~unknown[even.truth.frame_of_rows])
    annotated = np.isin(np.arange(even.frames), frames) & ~unknown
    gap = replace(even, annotated=annotated, truth=truth)
    live = live_frames(gap, FAST)
    assert not live[frames[cuts[0].frames - 4 : cuts[0].frames + 2]].any()
    assert live[frames[cuts[0].frames + np.array([-5, 2])]].all()
    assert score_scene(gap, answers, FAST).skipped == {}  # a gap between annotated frames is no hole in time


@pytest.mark.parametrize("seed", range(4))
def test_the_reward_and_the_replay_are_those_of_the_cut_log(seed: int) -> None:
    cut, said = case(seed)
    scene, answers = stretched(cut, said, seed)
    fast_scorer, cut_scorer = FrameScorer(scene, FAST), FrameScorer(cut, CUT)
    place = 0
    for t in range(scene.frames):
        score = fast_scorer.score(t, _forecasts(answers, t), answers.malformed[t])
        if scene.annotated is not None and scene.annotated[t]:
            want = cut_scorer.score(place, _forecasts(said, place), said.malformed[place])
            assert_equal(score, want, scene.annotated_frames)
            place += 1
        else:
            assert (score.targets, score.error, score.false_forecasts) == (0, 0.0, 0)
    judged, want_judged = replay(scene, answers, FAST), replay(cut, said, CUT)
    for incident, other in zip(judged.incidents, want_judged.incidents, strict=True):
        assert_equal(incident, replace(other, row=incident.row, name=incident.name), scene.annotated_frames)
    np.testing.assert_allclose(judged.part, want_judged.part)
    for rows, false in ((scene.detections, judged.detection_false), (answers.tracks, judged.track_false)):
        assert set(rows.frame_of_rows[false]) <= set(scene.annotated_frames)
    assert judged.detection_false.sum() == want_judged.detection_false.sum() > 0
    assert judged.track_false.sum() == want_judged.track_false.sum() > 0


def _forecasts(rollout: Rollout, t: int) -> RecordedForecasts:
    whole = RecordedForecasts.of(rollout)
    rows = rollout.objects.rows(t)
    return replace(whole, **{field.name: getattr(whole, field.name)[rows] for field in fields(whole)})


@pytest.mark.parametrize("seed", range(3))
def test_the_independent_scorer_of_the_cut_log_agrees(seed: int) -> None:
    cases = [case(20 * seed + place, name=f"s{place}") for place in range(2)]
    fast = [stretched(*pair, seed + place) for place, pair in enumerate(cases)]
    scenes = [scene for scene, _ in fast]
    answers = [said for _, said in fast]
    constants = CardBudget(FAST.id, 3, 2)
    reference = replace(reference_of(FAST, scenes, seed), constants=constants)
    agent = agent_scores("stp", scenes, [answers], FAST)
    report = summarise([agent], FAST, reference)
    table = agent_table(agent, reference)
    weights = {name: weight for name, weight in table.weight.items() if name != "all"}
    own = scorer.score(CUT, [cut for cut, _ in cases], [[said for _, said in cases]], (3, 2), weights)
    for subset in ("all", "ids", "reacquired"):
        np.testing.assert_allclose(table.bade(subset).error, own.errors[subset], rtol=1e-9, atol=1e-9)
        same(rows_of(report, "stp")[subset], own.rows[subset], (*SHARED, *PARTS, "minADE", "minFDE", "energy_score"))


@pytest.mark.parametrize("seed", range(3))
def test_a_scene_whose_frames_are_all_annotated_keeps_every_digit(seed: int) -> None:
    cut, said = case(seed)
    every_frame = replace(cut, annotated=np.ones(cut.frames, dtype=bool))
    score, want = score_scene(every_frame, said, CUT), score_scene(cut, said, CUT)
    assert_equal(score, want, np.arange(cut.frames), tolerance=0.0)


KITTI = load_card("MTP-KITTI-v0")  # 10 Hz
SLOW = KITTI.model_copy(update={"task": KITTI.task.model_copy(update={"rate": 2.0, "past": 2, "future": 2})})
FRAMES = 100


def played(agent: str, card: Card) -> tuple[Scene, Rollout]:
    """The only scene of a card, and what a baseline answers."""
    submission = load_submission(agent)
    env = MTPEnv(card, observe=submission.compare.observe)
    rollout = run_scene(submission.build(env.task), env, env.scene_names[0], seed=0)
    return env.scene, rollout


def two_cars(frames: int, step: float) -> Scene:
    """Two cars at 2 m/s, one of which bends, with exact detections in every frame."""
    time = step * np.arange(frames)
    scene = make_scene([[at(0, (2 * t, 0.0)), at(1, (10 + 2 * t, 8 + 0.05 * t**2))] for t in time])
    truth = scene.truth
    detections = Detections(truth.start, truth.box, truth.velocity, truth.class_id, np.ones(2 * frames))
    return replace(scene, time=time, detections=detections, detector="exact")


def every_fifth(scene: Scene) -> Scene:
    return replace(scene, annotated=np.arange(scene.frames) % STEP == 0)


def test_an_answer_at_ten_hertz_counts_as_that_at_two(tmp_path: Path) -> None:
    """The log of 10 Hz is read from its tables, and truth stands in every fifth frame alone."""
    cut, said = played("gt_tracks", with_scenes(SLOW, [two_cars(20, 0.5)]))
    log, answers = stretched(cut, said, seed=0, future=10)
    save_scene(log, tmp_path, KITTI.task.classes)
    assert (tmp_path / "s" / "annotated.csv").read_text().split()[1:4] == ["0", "5", "10"]
    (scene,) = load_scenes(with_files(KITTI, tmp_path))
    score, want = score_scene(scene, answers, KITTI), score_scene(cut, said, SLOW)
    assert (len(score), int(score.covered.sum()), score.false_forecasts) == (34, 34, 0)
    assert_equal(score, replace(want, detections=score.detections), scene.annotated_frames)


@pytest.mark.parametrize("agent", ["gt_tracks", "stp"])
def test_agents_at_ten_hertz_and_at_two(agent: str) -> None:
    """They see five times as many frames, so the numbers are near, not equal; ground truth comes in some of them."""
    fast_log, slow_log = every_fifth(two_cars(96, 0.1)), two_cars(20, 0.5)
    cards = with_scenes(KITTI, [fast_log]), with_scenes(SLOW, [slow_log])
    fast, slow = (score_scene(*played(agent, card), card) for card in cards)
    errors = [float(score.capped.mean()) for score in (fast, slow)]
    print(f"{agent}: {errors[0]:.3f} m at 10 Hz, {errors[1]:.3f} m at 2 Hz, {errors[0] - errors[1]:.3f} m more")
    assert np.isfinite(errors).all()
    assert abs(errors[0] - errors[1]) < 0.15
    for score in (fast, slow):
        assert (len(score), score.live) == (34, 17)
        assert (score.covered.mean(), score.false_forecasts) == (1.0, 0)


def test_exact_detections_of_a_log_with_truth_in_every_fifth_frame_are_not_false() -> None:
    whole = two_cars(FRAMES, 0.1)
    sparse = replace(whole, truth=whole.truth.select(whole.truth.frame_of_rows % STEP == 0))
    cards = [with_scenes(KITTI, [scene]) for scene in (sparse, every_fifth(sparse))]
    judged = [replay(*played("stp", card), card) for card in cards]
    false_tracks = judged[0].answers.shown & (judged[0].rollout.tracks.frame_of_rows % STEP > 0)
    assert [int(one.detection_false.sum()) for one in judged] == [160, 0]
    assert [int(one.track_false.sum()) for one in judged] == [int(false_tracks.sum()), 0]
    assert [int(np.isfinite(one.part[:, 0]).sum()) for one in judged] == [0, 34]
    counts = score_scene(judged[1].scene, judged[1].rollout, KITTI).counts
    assert (int(counts.truth.sum()), int(counts.fp.sum()), int(counts.ids.sum())) == (40, 0, 0)


def test_agents_are_not_told_which_frames_are_annotated() -> None:
    whole = two_cars(30, 0.1)
    partly = every_fifth(whole)
    envs = [MTPEnv(with_scenes(KITTI, [scene])) for scene in (whole, partly)]
    assert envs[0].task == envs[1].task
    seen = [env.reset(seed=0)[0] for env in envs]
    rewards = []
    for _ in range(30):
        for name, value in seen[0].items():
            np.testing.assert_array_equal(seen[1][name], value)
        steps = [env.step(empty_action(env.task)) for env in envs]
        seen = [step[0] for step in steps]
        rewards.append([step[1] for step in steps])
    of_whole, of_partly = np.array(rewards).T
    assert np.flatnonzero(of_whole).tolist() == list(range(9, 20))  # 9 frames before, 10 after
    assert np.flatnonzero(of_partly).tolist() == [5, 10, 15]  # one annotated frame before, two after
    assert set(of_partly[[5, 10, 15]]) == {-4.0}  # two cars, 2 m each


def test_perfect_association_goes_on_between_annotated_frames() -> None:
    card = with_scenes(KITTI, [every_fifth(two_cars(60, 0.1))])
    env = MTPEnv(card, observe="associated")
    observations = [env.reset(seed=0)[0], *(env.step(empty_action(env.task))[0] for _ in range(59))]
    for t, observation in enumerate(observations):
        valid = observation["detection_valid"] == 1
        assert observation["detection_id"][valid].tolist() == ([0, 1] if t % STEP == 0 else [UNKNOWN_OBJECT] * 2)
        assert env.observation_space.contains(observation)
    _, rollout = played("perfect_association", card)
    assert len(set(rollout.track_id)) == 2


AHEAD = {
    # annotated frames: frames with a target, of 2 annotated frames of past and 3 of future, with forecasts of 15 steps
    (0, 5, 10, 15, 20, 25): [5, 10],
    (0, 5, 11, 16, 22, 27): [5, 11],  # 17 and 16 steps ahead: within half a step
    (0, 5, 12, 17, 24, 29): [12],  # 19 steps ahead
    (0, 5, 10, 15, 23, 28, 33, 38, 43): [28],  # 8 frames are a gap
}


@pytest.mark.parametrize(("frames", "want"), AHEAD.items())
def test_windows_are_measured_in_time(frames: tuple[int, ...], want: list[int]) -> None:
    card = FAST.model_copy(update={"task": TASK.model_copy(update={"future": 15})})
    scene = make_scene([[at(1, (0.1 * t, 0))] if t in frames else [] for t in range(frames[-1] + 1)])
    scene = replace(scene, time=0.02 * np.arange(scene.frames), annotated=np.isin(np.arange(scene.frames), frames))
    targets = find_targets(scene, card)
    assert targets.frame.tolist() == np.flatnonzero(live_frames(scene, card)).tolist() == want
    for t, steps, future in zip(targets.frame, targets.step, targets.future, strict=True):
        place = frames.index(t)
        later = np.array(frames[place + 1 : place + 4])
        np.testing.assert_array_equal(steps, np.minimum(later - t, 15) - 1)
        np.testing.assert_allclose(future[:, 0], 0.1 * later)


def test_in_neutral_areas_nothing_counts() -> None:
    """Two cars, one of them in the area, each with a track, a forecast and a false one of both beside it."""
    inside, outside = (20.0, 0.0), (0.0, 0.0)
    false_inside, false_outside = (20.0, 9.0), (0.0, 9.0)
    frames = 8
    scene = make_scene([[at(1, inside), at(2, outside)]] * frames)
    things = [at(1, inside), at(2, outside), at(3, false_inside), at(4, false_outside)]
    said = [replace(thing, forecast=np.tile([thing.x, thing.y], (1, 3, 1))) for thing in things]
    rollout = make_rollout([things] * frames, [said] * frames)
    whole = score_scene(scene, rollout, CUT)
    area = np.array([[15.0, -5.0, 25.0, 12.0], [100.0, 100.0, 101.0, 101.0]])
    part = replace(scene, neutral_areas=area)
    score = score_scene(part, rollout, CUT)
    for name, of_whole in (("false_forecasts", 2 * whole.live), ("forecasts", 4 * whole.live)):
        assert getattr(whole, name) == of_whole
    assert (score.live, score.false_forecasts) == (whole.live, whole.live)
    assert (set(whole.object_id), set(score.object_id)) == ({1, 2}, {2})
    assert (int(whole.counts.truth.sum()), int(score.counts.truth.sum())) == (2 * frames, frames)
    assert (whole.counts.false_positives, score.counts.false_positives) == (2 * frames, frames)
    assert (int(whole.counts.fp.sum()), int(score.counts.fp.sum())) == (2 * frames, frames)
    assert (whole.counts.false_tracks, score.counts.false_tracks) == (2, 1)
    alone = make_scene([[at(2, outside)]] * frames)
    kept = make_rollout([[things[1], things[3]]] * frames, [[said[1], said[3]]] * frames)
    want = score_scene(alone, kept, CUT)
    assert_equal(score.counts, want.counts, np.arange(frames))
    played = replay(part, rollout, CUT)
    assert (int(played.track_false.sum()), int(played.forecast_false.sum())) == (frames, whole.live)
    turned = replace(part, world=np.tile([0.0, 100.0, 0.0, np.pi / 2], (frames, 1)))
    assert set(score_scene(turned, rollout, CUT).object_id) == {1, 2}  # areas are in the world
    world_area = np.array([[-12.0, 115.0, 5.0, 125.0]])
    assert set(score_scene(replace(turned, neutral_areas=world_area), rollout, CUT).object_id) == {2}
