"""A predictor that follows lanes, scored: every object goes along the nearest lane in its direction, as fast as now.

    python examples/own_lane_predictor.py

Simulated traffic: no data is downloaded.
"""

# --8<-- [start:predictor]
import numpy as np

import mtp_bench
from mtp_bench.prediction import KMeansSampler, LearnedPresence
from mtp_bench.prediction.lane_paths import STEP, lane_paths
from mtp_bench.tracking import HypothesisTracker


class LaneFollower:
    """One future of each track: along its lane at constant speed, straight on where it has no lane."""

    def reset(self, task):
        self.frames = np.arange(1, task.future + 1)

    def predict(self, frame):
        past, known = frame.tracks.past, frame.tracks.past_valid[:, -2:].all(axis=1)
        now, step = (
            past[:, -1],
            np.where(known[:, None], past[:, -1, :2] - past[:, -2, :2], 0),
        )  # metres per frame
        straight = now[:, None, :2] + self.frames[:, None] * step[:, None]  # [N, T, 2]
        metres = (
            np.hypot(*step.T)[:, None] * self.frames
        )  # [N, T] gone until each frame
        path = lane_paths(
            frame.seen[-1], now[:, :2], now[:, 3], most=1, metres=metres[:, -1] + STEP
        )
        points, row = (
            path.points[:, 0],
            np.arange(len(now))[:, None],
        )  # [N, S, 2], a point every STEP = 2 metres
        before = (metres / STEP).astype(int)
        share = (metres / STEP - before)[..., None]
        along = (1 - share) * points[row, before] + share * points[row, before + 1]
        along += now[:, None, :2] - points[:, :1]  # as far beside the lane as now
        return mtp_bench.Forecasts(
            np.where(path.valid[:, :1, None], along, straight)[:, None]
        )  # [N, 1, T, 2]


# --8<-- [end:predictor]
def lane_follower(task):
    """Build the agent: a tracker, the predictor, a sampler, and the probability that each object is there."""
    return mtp_bench.Pipeline(
        HypothesisTracker(1),
        LaneFollower(),
        KMeansSampler(),
        presence=LearnedPresence(),
    )


# --8<-- [start:compare]
print(
    mtp_bench.compare(
        [lane_follower, "mtp_lanes"], "MTP-Intersection-Lanes-v0", scenes=3
    )
)
# --8<-- [end:compare]
