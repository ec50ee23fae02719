"""The runs of the reference: noise as large as the detector's, cuts and assignments by the number of the run."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from mtp_bench.core import Detections, Scene
from mtp_bench.running.perturbation import RUNS, Perturbation, assignment_of, matched_detections
from tests.support.scoring_scenes import CAR, WALKER, Thing, make_card, make_scene

CARD = make_card()
FRAMES = 500


def scene_of(xy: float, yaw: float) -> Scene:
    """A car and a walker; detections are off by errors of these sigmas, and there is a false one far away."""
    rng = np.random.default_rng(5)
    truth = [[Thing(1, 0, 0), Thing(2, 50, 0, class_id=WALKER)] for _ in range(FRAMES)]
    rows: list[list[float]] = []  # x y yaw class, three per frame
    for t in range(FRAMES):
        rows.append([*rng.normal(0, xy, 2), rng.normal(0, yaw), CAR])
        rows.append([50 + rng.normal(0, xy / 2), rng.normal(0, xy / 2), 0.5 + np.pi * (t % 4 == 0), WALKER])
        rows.append([200.0, 0.0, 0.0, CAR])
    flat, box = np.array(rows), np.tile([0.0, 0, 0, 0, 4, 2, 1.5], (3 * FRAMES, 1))
    box[:, [0, 1, 3]] = flat[:, :3]
    score = np.stack([np.linspace(0, 1, FRAMES), np.linspace(1, 3, FRAMES), np.full(FRAMES, 9.0)], axis=1).ravel()
    start, kind = 3 * np.arange(FRAMES + 1), flat[:, 3].astype(int)
    return replace(make_scene(truth), detections=Detections(start, box, np.zeros((len(flat), 2)), kind, score))


def test_noise_and_cuts_are_those_of_matched_detections() -> None:
    found = matched_detections(scene_of(0.2, 0.03), CARD)
    assert Counter(found.class_id.tolist()) == {CAR: FRAMES, WALKER: FRAMES}  # not the false ones
    fitted = Perturbation.fit([found], 2)
    assert fitted.sigma_xy == pytest.approx((0.2, 0.1), rel=0.1)
    assert fitted.sigma_yaw[CAR] == pytest.approx(0.03, rel=0.15)
    assert fitted.sigma_yaw[WALKER] == 0.1  # at most
    np.testing.assert_allclose(fitted.cuts, [[0.1, 1.2], [0.25, 1.5]], atol=1e-5)


def test_every_sixth_run_has_the_same_assignment_and_cut() -> None:
    assert [assignment_of(run) for run in range(4)] == ["hungarian", "greedy", "hungarian", "greedy"]
    scene = scene_of(0.2, 0.03)
    fitted = replace(Perturbation.fit([matched_detections(scene, CARD)], 2), sigma_xy=(0, 0), sigma_yaw=(0, 0))
    kinds: Counter[tuple[str, int]] = Counter()
    for run in range(RUNS):
        share = (fitted.perturbed(scene, run).detections.class_id == WALKER).sum() / FRAMES
        kind = int(np.argmin(np.abs(np.array([0.95, 0.855, 0.7125]) - share)))
        assert kind == run // 2 % 3
        kinds[assignment_of(run), kind] += 1
    assert set(kinds.values()) == {RUNS // 6}


def test_detections_are_dropped_and_moved_by_that_much() -> None:
    scene = scene_of(0.2, 0.03)
    moved = Perturbation((0.3, 0.1), (0.05, 0.1), ((0, 0), (0, 0))).perturbed(scene, 0)
    assert moved.truth is scene.truth
    assert 0.93 < len(moved.detections.box) / len(scene.detections.box) < 0.97
    false = moved.detections.box[moved.detections.score == 9]
    offset = false - [200, 0, 0, 0, 4, 2, 1.5]
    assert offset[:, :2].std() == pytest.approx(0.3, rel=0.1)
    assert (offset[:, 2] == 0).all()
    assert offset[:, 3].std() == pytest.approx(0.05, rel=0.1)
    assert np.log(false[:, 4:] / [4, 2, 1.5]).std() == pytest.approx(0.05, rel=0.1)
    assert moved.detections.start[-1] == len(moved.detections.box)


def test_a_run_is_the_same_whenever_it_is_made_and_differs_from_others() -> None:
    scene = scene_of(0.2, 0.03)
    noise = Perturbation.fit([matched_detections(scene, CARD)], 2)
    box = [noise.perturbed(one, run).detections.box for one, run in ((scene, 0), (scene, 0), (scene, 6))]
    other = noise.perturbed(replace(scene, name="other"), 0).detections.box
    assert np.array_equal(box[0], box[1])
    assert len({part[:5].tobytes() for part in (*box, other)}) == 3
    assert scene.detections.box[2, 0] == 200  # the scene itself stays
