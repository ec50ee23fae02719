# %% [markdown]
# # Your own predictor, as a function
#
# This notebook scores a function that forecasts tracks, beside baselines. It needs no training, no weights and no
# data.
#
# A predictor sees the tracks of one frame and returns samples of where each goes, [tracks, samples, frames, 2] in
# metres. Here ten samples keep the mean velocity of the past, from standing still to a third faster.

# %%
import numpy as np

import mtp_bench
from mtp_bench.prediction import KMeansSampler, LearnedPresence
from mtp_bench.tracking import HypothesisTracker


def steady(tracks, task):
    place = tracks.past[..., :2]  # [N, P, 2], oldest first
    known = tracks.past_valid[:, 1:] & tracks.past_valid[:, :-1]
    step = np.where(known[..., None], np.diff(place, axis=1), 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)[:, None]
    ahead = np.outer(np.linspace(0, 1.3, 10), np.arange(1, task.future + 1))  # [10, T] frames
    return place[:, -1, None, None] + step[:, None, None] * ahead[..., None]


# %% [markdown]
# A tracker, the predictor and a sampler make an agent. The sampler keeps k of all samples of an object.


# %%
def steady_agent(task):
    predictor = mtp_bench.FunctionPredictor(steady)
    return mtp_bench.Pipeline(HypothesisTracker(1), predictor, KMeansSampler(), presence=LearnedPresence())


mtp_bench.evaluate(steady_agent, "MTP-Roundabout-v0", scenes=2)

# %% [markdown]
# `compare` adds the controls, such as prediction from ground-truth tracks and STP. It also takes names of baselines,
# such as "mtp", and folders. Agents are listed by bADE; two scenes are too few for ranks.

# %%
mtp_bench.compare([steady_agent], "MTP-Roundabout-v0", scenes=2)
