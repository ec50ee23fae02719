"""Errors of detectors, smaller and larger than as recorded: what each knob changes, and what none may."""

from dataclasses import replace

import numpy as np
import pytest

from mtp_bench import CardError, DataError, MTPEnv, UnknownNameError
from mtp_bench.cards import Card, load_card, parse_card, with_perturb
from mtp_bench.core import Bools, Floats, Ints, Scene, wrap_angle
from mtp_bench.sources import open_source, perturbed
from mtp_bench.sources.detector_errors import covered_truth, detection_matches, missed

ENV = "MTP-Intersection-v0"
KNOBS: list[tuple[str, float]] = [
    ("score", 0.3), ("misses", 0.0), ("misses", 0.5), ("misses", 2.0), ("false", 0.0), ("false", 3.0), ("noise", 0.0),
    ("noise", 2.0), ("delay", 0.5), ("delay", 2.0),
]  # fmt: skip


@pytest.fixture(scope="module")
def plain() -> Scene:
    source = open_source(load_card(ENV))
    return source.load(source.names[0])


def changed(plain: Scene, **levels: float) -> Scene:
    return perturbed(plain, with_perturb(load_card(ENV), levels))


def found(scene: Scene) -> tuple[Ints, Ints]:
    """Detections that detect something, and its rows in the truth."""
    true_row = detection_matches(scene, load_card(ENV))
    rows = np.flatnonzero(true_row >= 0)
    return rows, true_row[rows]


def misses(scene: Scene) -> tuple[Bools, Bools]:
    """Whether the evaluated boxes in coverage are missed, and are in coverage."""
    card = load_card(ENV)
    true_row = detection_matches(scene, card)
    return missed(scene, card, true_row), covered_truth(scene, card, true_row)


def columns(scene: Scene) -> list[Floats]:
    return [np.asarray(column) for column in vars(scene.detections).values()]


def is_equal(one: Scene, other: Scene) -> bool:
    pairs = zip(columns(one), columns(other), strict=True)
    return all(first.shape == second.shape and np.array_equal(first, second, equal_nan=True) for first, second in pairs)


@pytest.mark.parametrize("levels", [{}, {"noise": 1.0, "misses": 1, "delay": 0, "seed": 5}, None])
def test_as_recorded_is_the_card_itself(levels: dict[str, float] | None) -> None:
    card = load_card(ENV)
    assert with_perturb(card, levels) == card
    assert with_perturb(card, levels).digest == card.digest


@pytest.mark.parametrize("content", [{}, {"noise": 1.0}, {"seed": 4}])
def test_as_recorded_in_a_file_is_the_card_itself(content: dict[str, float]) -> None:
    """KITTI without ego motion: boxes would be turned to the world and back."""
    card = load_card("MTP-KITTI-noego-v0")
    assert parse_card({**card.stored(), "perturb": content}).digest == card.digest


@pytest.mark.parametrize(("knob", "level"), KNOBS)
def test_a_level_is_a_function_of_scene_and_seed(knob: str, level: float, plain: Scene) -> None:
    card = with_perturb(load_card(ENV), {knob: level})
    again = open_source(card).load(plain.name)
    scene = changed(plain, **{knob: level})
    assert is_equal(scene, again)
    assert not is_equal(scene, plain)
    assert scene.truth is plain.truth, "truth and targets stay"
    assert scene.detector == f"{plain.detector}, {knob} {level:g}"
    assert parse_card(card.stored()).digest == card.digest != load_card(ENV).digest
    is_drawn = knob == "misses" or (knob, level) == ("false", 3.0)
    assert is_equal(scene, changed(plain, **{knob: level, "seed": 1})) != is_drawn
    counts = np.diff(scene.detections.start)
    assert len(counts) == scene.frames
    assert counts.sum() == len(scene.detections.box)


def test_noise_is_a_multiple_of_each_error(plain: Scene) -> None:
    rows, true_row = found(plain)
    truth = plain.truth.box[true_row]
    error = plain.detections.box[rows] - truth
    for level in (0.5, 2.0):
        box = changed(plain, noise=level).detections.box[rows]
        np.testing.assert_allclose(box[:, :3] - truth[:, :3], level * error[:, :3], atol=1e-9)
        ratio = plain.detections.box[rows, 4:] / truth[:, 4:]
        np.testing.assert_allclose(box[:, 4:] / truth[:, 4:], ratio**level)
        turn = wrap_angle(error[:, 3])
        is_flipped = np.abs(turn) > np.pi / 2
        want = wrap_angle(level * turn[~is_flipped])
        np.testing.assert_allclose(wrap_angle(box[~is_flipped, 3] - truth[~is_flipped, 3]), want, atol=1e-9)
        assert np.all(np.abs(wrap_angle(box[is_flipped, 3] - truth[is_flipped, 3])) > np.pi / 2), "stay confused"
    np.testing.assert_allclose(changed(plain, noise=0).detections.box[rows], truth, atol=1e-9)
    false = np.setdiff1d(np.arange(len(plain.detections.box)), rows)
    np.testing.assert_array_equal(changed(plain, noise=3.0).detections.box[false], plain.detections.box[false])


def test_without_misses_every_object_is_found_with_an_error(plain: Scene) -> None:
    scene = changed(plain, misses=0.0)
    is_missed, is_covered = misses(scene)
    before, _ = misses(plain)
    assert before.sum() > 100
    assert is_missed.sum() < 0.03 * is_covered.sum(), "all after the first detection of the class"
    rows, true_row = found(scene)
    error_m = np.linalg.norm(scene.detections.box[rows, :2] - scene.truth.box[true_row, :2], axis=1)
    assert (error_m[before[true_row]] > 1e-3).mean() > 0.95
    half, _ = misses(changed(plain, misses=0.5))
    assert 0.3 * before.sum() < half.sum() < 0.7 * before.sum()
    assert np.all(before[half]), "none is new"


def runs(mask: Bools, object_id: Ints) -> Floats:
    """Lengths of runs of misses, by object."""
    lengths = []
    for identity in np.unique(object_id):
        edges = np.diff(np.concatenate([[0], mask[object_id == identity].astype(int), [0]]))
        lengths += (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)).tolist()
    return np.array(lengths)


def test_more_misses_come_in_runs(plain: Scene) -> None:
    before, is_covered = misses(plain)
    shares = [before.mean()]
    for level in (1.5, 2.0, 4.0):
        is_missed, _ = misses(changed(plain, misses=level))
        assert np.all(is_missed[before]), "what was missed stays missed"
        shares.append(is_missed.mean())
    assert np.all(np.diff(shares) > 0.03)
    new = misses(changed(plain, misses=2.0))[0] & ~before
    order = np.argsort(plain.truth.object_id, kind="stable")
    real, again = (runs(mask[order], plain.truth.object_id[order]).mean() for mask in (before, new))
    at_random = 1 / (1 - new.sum() / (is_covered & ~before).sum())
    assert again > 1.3 * at_random
    assert again > 0.4 * real, "gaps between old misses cut new runs"


def test_false_detections_come_and_go_as_objects(plain: Scene) -> None:
    card = load_card(ENV)

    def false_of(scene: Scene) -> Ints:
        return np.flatnonzero(detection_matches(scene, card) < 0)

    count = len(false_of(plain))
    assert len(false_of(changed(plain, false=0))) == 0
    kept = changed(plain, false=0.5)
    assert 0.3 * count < len(false_of(kept)) < 0.7 * count
    more = changed(plain, false=3.0)
    assert 2.5 * count < len(false_of(more)) < 3.1 * count, "some new ones detect an object by chance"
    false = more.detections.select(np.isin(np.arange(len(more.detections.box)), false_of(more)))
    distance_m = np.linalg.norm(false.box[:, :2] - more.ego[false.frame_of_rows, :2], axis=1)
    recorded = plain.detections.select(np.isin(np.arange(len(plain.detections.box)), false_of(plain)))
    recorded_m = np.linalg.norm(recorded.box[:, :2] - plain.ego[recorded.frame_of_rows, :2], axis=1)
    assert abs(np.median(distance_m) - np.median(recorded_m)) < 5
    assert set(false.score) <= set(recorded.score)


def test_the_ego_sees_new_false_detections_as_it_saw_the_recorded_ones(plain: Scene) -> None:
    """On a road that rises and turns."""
    ego = plain.ego.copy()
    ego[:, 2] = np.arange(plain.frames)
    ego[:, 3] = np.arange(plain.frames) * 0.1
    recorded = plain.detections
    box = recorded.box.copy()
    box[:, 2] = ego[recorded.frame_of_rows, 2] - 1.0
    box[:, 3] = wrap_angle(ego[recorded.frame_of_rows, 3] + 0.5)
    no_truth = plain.truth.select(np.zeros(len(plain.truth.box), dtype=bool))
    hill = replace(plain, ego=ego, truth=no_truth, detections=replace(recorded, box=box))
    more = changed(hill, false=2.0).detections
    assert len(more.box) == 2 * len(recorded.box)
    pose = ego[more.frame_of_rows]
    np.testing.assert_allclose(more.box[:, 2] - pose[:, 2], -1.0)
    np.testing.assert_allclose(wrap_angle(more.box[:, 3] - pose[:, 3]), 0.5)


@pytest.mark.parametrize("frames", [1, 2])
def test_whole_frames_late(frames: int, plain: Scene) -> None:
    late = changed(plain, delay=frames).detections
    assert np.diff(late.start)[:frames].sum() == 0
    for t in range(frames, plain.frames):
        np.testing.assert_array_equal(late.box[late.rows(t)], plain.detections.box[plain.detections.rows(t - frames)])


def test_half_a_frame_late(plain: Scene) -> None:
    rows, true_row = found(plain)
    back_m = plain.detections.box[rows, :2] - changed(plain, delay=0.5).detections.box[rows, :2]
    np.testing.assert_allclose(back_m, plain.truth.velocity[true_row] * 0.25, atol=1e-9)


def test_scores_that_are_no_probabilities(plain: Scene) -> None:
    odds = replace(plain, detections=replace(plain.detections, score=plain.detections.score * 10 - 3))
    kept = changed(odds, score=0.25).detections
    assert len(kept.score) / len(plain.detections.score) == pytest.approx(0.75, abs=0.05)
    t = plain.frames // 2
    least = np.quantile(odds.detections.score[: odds.detections.start[t + 1]], 0.25)
    score = odds.detections.score[odds.detections.rows(t)]
    np.testing.assert_array_equal(kept.score[kept.rows(t)], score[score >= least])
    assert changed(plain, score=0.3).detections.score.min() >= 0.3


def test_several_knobs_are_one_condition(plain: Scene) -> None:
    both = changed(plain, noise=2.0, score=0.3)
    assert is_equal(replace(both, detector=""), replace(changed(changed(plain, noise=2.0), score=0.3), detector=""))


WRONG: dict[str, tuple[dict[str, float], type[Exception], str]] = {
    "a knob": ({"nois": 2.0}, CardError, "nois"),
    "below 0": ({"noise": -1.0}, CardError, "perturb.*noise"),
    "not a number": ({"noise": float("nan")}, CardError, "perturb.*noise"),
    "no levels": ("noise", CardError, "perturb is 'noise', expected levels by knob"),  # type: ignore[dict-item]
    "true": ({"noise": True}, CardError, "perturb.*noise"),
    "a text": ({"noise": "high"}, CardError, "perturb.*noise"),  # type: ignore[dict-item]
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_levels(case: str) -> None:
    levels, kind, message = WRONG[case]
    with pytest.raises((kind, UnknownNameError), match=message):
        with_perturb(load_card(ENV), levels)


def test_a_closed_loop_has_no_false_detections_of_a_whole_recording() -> None:
    env_id = "MTP-Drive-Intersection-v0"
    with pytest.raises(CardError, match="perturb has false 2, expected 1"):
        MTPEnv(env_id, perturb={"false": 2.0})
    with pytest.raises(CardError, match="perturb has false 2, expected 1"):
        parse_card({**load_card(env_id).stored(), "perturb": {"false": 2.0}})


def test_truth_that_does_not_tell(plain: Scene) -> None:
    partly = replace(plain, annotated=np.arange(plain.frames) % 2 == 0)
    with pytest.raises(DataError, match="only some of its frames are annotated"):
        changed(partly, noise=2.0)
    targets = replace(plain, truth_complete=False)
    assert changed(targets, noise=2.0, score=0.1, delay=1.0)
    for knob in ("misses", "false"):
        with pytest.raises(DataError, match="is not complete, so missed and false detections are unknown"):
            changed(targets, **{knob: 2.0})


def test_an_env_shows_the_changed_detections() -> None:
    seen = []
    for levels in (None, {"score": 0.5}):
        env = MTPEnv(ENV, perturb=levels)
        observation, _ = env.reset(options={"scene": env.scene_names[0]})
        seen.append(int(observation["detection_valid"].sum()))
        assert (env.card.perturb is None) == (levels is None)
    assert seen[1] < seen[0]


def test_empty_scenes(plain: Scene) -> None:
    nothing = replace(
        plain, truth=plain.truth.select(np.zeros(len(plain.truth.box), dtype=bool)),
        detections=plain.detections.select(np.zeros(len(plain.detections.box), dtype=bool)),
    )  # fmt: skip
    unseen = replace(plain, detections=nothing.detections)
    unknown = replace(plain, truth=nothing.truth)
    card: Card = load_card(ENV)
    for knob, level in KNOBS:
        for scene in (nothing, unseen, unknown):
            levels = {knob: level}
            assert perturbed(scene, with_perturb(card, levels)).frames == plain.frames


def test_velocities_do_not_contain_the_next_frame() -> None:
    """KITTI's do: what is late moves back along those of the past."""
    card = load_card("MTP-KITTI-v0")
    assert card.source.traits.velocity_ahead
    plain = open_source(load_card(ENV)).load("intersection-010000")
    ahead = replace(plain, truth=replace(plain.truth, velocity=np.full_like(plain.truth.velocity, 1e3)))
    source = card.source.model_copy()
    late = with_perturb(load_card(ENV).model_copy(update={"source": source}), {"delay": 0.5})
    moved = perturbed(replace(ahead, simulated=False), late).detections.box[:, :2] - plain.detections.box[:, :2]
    assert np.abs(moved).max() < 20


def test_places_stay_places() -> None:
    """Boxes of people have nominal sizes and headings, also those that are filled in."""
    card = with_perturb(load_card("MTP-ETH-UCY-v0"), {"misses": 0.0, "noise": 0.0})
    assert card.source.traits.places_only
    plain = open_source(load_card(ENV)).load("intersection-010000")
    one_class = replace(
        plain, truth=replace(plain.truth, class_id=np.zeros_like(plain.truth.class_id)),
        detections=replace(plain.detections, class_id=np.zeros_like(plain.detections.class_id)), simulated=False,
    )  # fmt: skip
    box = perturbed(one_class, card).detections.box
    assert len(np.unique(box[:, 3:], axis=0)) == 1
