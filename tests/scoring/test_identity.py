"""IDF1 and HOTA: beside TrackEval on random scenes, and what must not matter."""

import contextlib
import io
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import Rollout, Scene
from mtp_bench.scoring import AgentScores, SceneScore, score_scene, summarise
from mtp_bench.scoring.rows import Clear, Tracking
from tests.support.scoring_scenes import Array, Thing, make_card, make_rollout, make_scene, random_case, take_tracks

CARD = make_card()
GATE = np.array([2.0, 1.0])


def tracking(*scores: SceneScore) -> Tracking:
    return summarise([AgentScores("agent", 3, scores[0].samples, "equal", (scores,))], CARD).details[0].tracking


def crowd(seed: int) -> tuple[Scene, Rollout]:
    """Without neutral objects, and the tracks of the best hypothesis only."""
    scene, rollout = random_case(seed, frames=20, objects=8, name=f"s{seed}")
    truth = replace(scene.truth, neutral=np.zeros(len(scene.truth.box), dtype=bool))
    best = rollout.hypothesis_log_weight.argmax(axis=1)[rollout.tracks.frame_of_rows]
    shown = np.flatnonzero(rollout.member[np.arange(len(best)), best])
    return replace(scene, truth=truth), take_tracks(rollout, shown)


def trackeval(scenes: Sequence[tuple[Scene, Rollout]], classes: Sequence[int]) -> tuple[float, float]:
    """IDF1 and HOTA of some classes, all scenes together."""
    with contextlib.redirect_stdout(io.StringIO()):
        import trackeval as te

        identity, hota = te.metrics.Identity({"THRESHOLD": 0.5, "PRINT_CONFIG": False}), te.metrics.HOTA()
    data = {scene.name: _data(scene, rollout, classes) for scene, rollout in scenes}
    found = [m.combine_sequences({k: m.eval_sequence(d) for k, d in data.items()}) for m in (identity, hota)]
    return float(found[0]["IDF1"]), float(found[1]["HOTA"].mean())


def _data(scene: Scene, rollout: Rollout, classes: Sequence[int]) -> dict[str, Any]:
    truth, frames = scene.truth, range(scene.frames)
    sides = []
    for rows, ids, box, kind in (
        (truth.rows, truth.object_id, truth.box, truth.class_id),
        (rollout.tracks.rows, rollout.track_id, rollout.track_box, rollout.track_class),
    ):
        kept = [np.arange(len(ids))[rows(t)][np.isin(kind[rows(t)], classes)] for t in frames]
        names = np.unique(ids[np.concatenate(kept)])
        sides.append(([np.searchsorted(names, ids[k]) for k in kept], kept, names, box, kind))

    def similarity(t: int) -> Array:
        (_, a, _, box_a, kind_a), (_, b, _, box_b, kind_b) = sides
        gap = np.linalg.norm(box_a[a[t], None, :2] - box_b[b[t], :2], axis=-1)
        near = np.maximum(1.0 - gap / (2 * GATE[kind_a[a[t]]])[:, None], 0.0)
        return np.where(kind_a[a[t], None] == kind_b[b[t]], near, 0.0)

    return {
        **{f"{side}_ids": part[0] for side, part in zip(("gt", "tracker"), sides, strict=True)},
        **{f"num_{side}_ids": len(part[2]) for side, part in zip(("gt", "tracker"), sides, strict=True)},
        **{f"num_{side}_dets": sum(map(len, part[0])) for side, part in zip(("gt", "tracker"), sides, strict=True)},
        "num_timesteps": scene.frames,
        "similarity_scores": [similarity(t) for t in frames],
    }


@pytest.mark.parametrize("seed", range(0, 30, 6))
def test_random_scenes_of_two_classes(seed: int) -> None:
    scenes = [crowd(seed + i) for i in range(3)]
    got = tracking(*(score_scene(*case, CARD) for case in scenes))
    for shown, classes in ((got.all, [0, 1]), (got.classes["car"], [0]), (got.classes["pedestrian"], [1])):
        assert pytest.approx(trackeval(scenes, classes), abs=1e-9) == (shown.IDF1, shown.HOTA)


def identity_of(scene: Scene, rollout: Rollout) -> Any:
    shown = tracking(score_scene(scene, rollout, CARD)).all
    return shown.IDF1, shown.HOTA


THINGS = [Thing(1, 0, 0), Thing(2, 9, 0)]


def test_without_tracks() -> None:
    assert identity_of(make_scene([THINGS] * 4), make_rollout([[]] * 4)) == (None, None)
    far = make_rollout([[Thing(1, 50, 50)]] + [[]] * 3)  # a single track, of no object
    assert identity_of(make_scene([THINGS] * 4), far) == (0.0, 0.0)


def test_a_neutral_object_and_the_track_on_it_do_not_matter() -> None:
    beside = Thing(7, 50, 0, neutral=True)
    tracks = [[*THINGS, Thing(9, 50.5, 0)]] * 4
    assert identity_of(make_scene([[*THINGS, beside]] * 4), make_rollout(tracks)) == (1.0, pytest.approx(1.0))
    assert identity_of(make_scene([THINGS] * 4), make_rollout(tracks))[0] == pytest.approx(2 * 8 / (8 + 12))


def test_nothing_and_what_cannot_be_known() -> None:
    assert identity_of(make_scene([[]] * 4), make_rollout([[]] * 4)) == (None, None)
    targets_only = make_scene([THINGS] * 4, truth_complete=False)
    shown = tracking(score_scene(targets_only, make_rollout([THINGS] * 4), CARD)).all
    assert shown == Clear(TP=8, FP=None, FN=0, IDS=0, FRAG=0, MOTA=None, MOTP=0.0, IDF1=None, HOTA=None)


def test_overlap_is_its_own_similarity() -> None:
    card = make_card(measure="iou_3d")
    rollout = make_rollout([[replace(thing, x=thing.x + 1.1) for thing in THINGS]] * 4, samples=4)
    score = score_scene(make_scene([THINGS] * 4), rollout, card)
    got = summarise([AgentScores("agent", 1, score.samples, "equal", ((score,),))], card).details[0].tracking.all
    assert got.IDF1 == 1.0
    assert pytest.approx(11 / 19) == got.HOTA  # IoU 2.9 / 5.1 = .57
