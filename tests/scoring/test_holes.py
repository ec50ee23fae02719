"""Holes in time: what no target, event or identity crosses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import pieces_of
from mtp_bench.scoring import SceneScore, find_targets, live_frames, score_scene
from mtp_bench.scoring.events import HOLES, LOST_TARGETS
from mtp_bench.scoring.targets import count_holes
from tests.support.scoring_scenes import Thing, answers_end_to_end, end_to_end, make_card, make_scene, random_case

CARD = make_card(past=2, future=3)  # 10 frames per second

STEPS = {
    # steps in periods: pieces of the frames
    "regular": ([1.0, 1.1, 0.9, 1.4], [0, 0, 0, 0, 0]),
    "half a period more is not a hole": ([1.5, 1.5], [0, 0, 0]),
    "a frame is missing": ([1.0, 2.0, 1.0, 21.0], [0, 0, 1, 1, 2]),
    "one frame": ([], [0]),
}


@pytest.mark.parametrize(("steps", "want"), STEPS.values(), ids=STEPS)
def test_a_step_of_more_than_one_and_a_half_periods_ends_a_piece(steps: list[float], want: list[int]) -> None:
    for period in (0.1, 1 / 7, 0.5):
        assert pieces_of(1.5e9 + period * np.cumsum([0.0, *steps]), period).tolist() == want


WINDOWS = {
    # frames, a bar for a hole: targets, live frames (2 past, 3 future), of an official list (3 future), and those lost
    "xxxxx|xxxxxx": ([1, 6, 7], [0, 1, 5, 6, 7], 4),
    "xxx|xxx": ([], [], 2),
    "xxxx|xx|x": ([], [0], 3),
    "xxxxx|": ([1], [0, 1], 0),
}


@pytest.mark.parametrize(("present", "targets", "listed", "lost"), [(k, *v) for k, v in WINDOWS.items()], ids=WINDOWS)
def test_no_past_or_future_crosses_a_hole(present: str, targets: list[int], listed: list[int], lost: int) -> None:
    clips = [make_scene([[Thing(7, float(t), 2.0)] for t in range(len(clip))]) for clip in present.split("|") if clip]
    scene = end_to_end(clips, 0.2)
    for changed, want in ((scene, targets), (replace(scene, listed_targets=True), listed)):
        assert find_targets(changed, CARD).frame.tolist() == want
        assert np.flatnonzero(live_frames(changed, CARD)).tolist() == want
    holes = len(clips) - 1
    assert count_holes(scene, CARD) == ({HOLES: holes, LOST_TARGETS: lost} if holes else {})


def summed(scores: list[SceneScore]) -> dict[str, Any]:
    """What scores of several scenes hold together, and how many of which outcome and error at some cuts."""
    total: dict[str, Any] = {}
    for name in ("live", "fixed_error", "forecasts", "false_forecasts"):
        total[name] = sum(getattr(score, name) for score in scores)
    names = "object_id min_ade covered distance absent_cause own_ids own_frag all_h_ids all_h_frag"
    for name in names.split():
        total[name] = np.concatenate([getattr(score, name) for score in scores])
    counts = [vars(score.counts) | vars(score.counts.identity) for score in scores]
    total |= {name: sum(count[name] for count in counts) for name in counts[0] if name != "identity"}
    for least in (0.2, 0.5, 0.9):
        total[f"at {least}"] = np.concatenate([np.stack(score.cuts.at(least)) for score in scores], axis=1)
    return total | {kind: sum(score.own_events[kind] for score in scores) for kind in scores[0].own_events}


@pytest.mark.parametrize("seed", range(6))
def test_each_side_of_a_hole_counts_as_a_scene(seed: int) -> None:
    scenes, rollouts = zip(*(random_case(10 * seed + clip) for clip in range(3)), strict=True)
    scene, rollout = end_to_end(scenes, 0.2), answers_end_to_end(rollouts)
    whole = score_scene(scene, rollout, CARD)
    want = summed([score_scene(*clip, CARD) for clip in zip(scenes, rollouts, strict=True)])
    for name, value in summed([whole]).items():
        np.testing.assert_allclose(value, want[name], atol=1e-9, err_msg=name)
    assert (whole.skipped, whole.skipped[HOLES]) == (count_holes(scene, CARD), 2)
    crossing = score_scene(end_to_end(scenes, 0.1), rollout, CARD)
    assert sum(crossing.own_events.values()) > sum(whole.own_events.values())
    assert len(crossing) == len(whole) + whole.skipped[LOST_TARGETS]
