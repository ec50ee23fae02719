# %% [markdown]
# # Your own tracker
#
# This notebook puts a tracker of a few lines into an agent, finds its identity switches, and compares it.
#
# `OnlineTracker` takes any object with `update(detections)` that returns a row `(id, box, score)` for each track.
# This one follows the nearest detection within some metres.

# %%
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

import mtp_bench
from mtp_bench.prediction import KinematicPredictor, KMeansSampler, LearnedPresence
from mtp_bench.tracking import OnlineTracker


class Nearest:
    """Detections of a frame are assigned to the last ones by distance, up to ``gate`` metres."""

    def __init__(self, gate):
        self.gate, self.last, self.number = gate, {}, 0

    def update(self, detections):
        ids = np.full(len(detections.box), -1)
        if self.last and len(ids):
            names, boxes = list(self.last), np.array(list(self.last.values()))
            distance = cdist(boxes[:, :2], detections.box[:, :2])
            for old, new in zip(*linear_sum_assignment(distance), strict=True):
                if distance[old, new] <= self.gate:
                    ids[new] = names[old]
        for new in np.flatnonzero(ids < 0):
            ids[new], self.number = self.number, self.number + 1
        self.last = dict(zip(ids.tolist(), detections.box, strict=True))
        return list(zip(ids.tolist(), detections.box, detections.score, strict=True))


# %% [markdown]
# With `per_class=True` each class has a tracker of its own. Predictor and sampler are those of `stp`, so that the
# tracker alone makes the difference.


# %%
def nearest_agent(task, gate=4.0):
    tracker = OnlineTracker(lambda task: Nearest(gate), per_class=True)
    return mtp_bench.Pipeline(tracker, KinematicPredictor(), KMeansSampler(), presence=LearnedPresence())


report = mtp_bench.evaluate(nearest_agent, "MTP-Roundabout-v0", scenes=2)
report

# %% [markdown]
# Its identity switches in each scene, and the error there:

# %%
for row in report.per_scene():
    print(f"{row['scene']}: {row['identity_switches']:.0f} identity switches, minADE {row['minADE']:.2f} m")

# %% [markdown]
# Beside the tracker of STP, which coasts through gaps, and ground-truth tracks:

# %%
mtp_bench.compare([nearest_agent], "MTP-Roundabout-v0", scenes=2)
