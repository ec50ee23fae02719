"""A baseline, and an agent of parts of which one is a function, after five frames."""

import numpy as np

import mtp_bench
from mtp_bench.prediction import KMeansSampler
from mtp_bench.tracking import HypothesisTracker


def still(tracks, task):
    """One future of each track [N, 1, T, 2]: it stays where it is."""
    return np.repeat(tracks.past[:, -1:, None, :2], task.future, axis=2)


env = mtp_bench.MTPEnv("MTP-Intersection-v0")
baseline = mtp_bench.load_submission("mtp").build(env.task)
own = mtp_bench.Pipeline(
    HypothesisTracker(1), mtp_bench.FunctionPredictor(still), KMeansSampler()
)
for name, agent in {"mtp": baseline, "own": own}.items():
    observation, info = env.reset(seed=0)
    agent.reset(env.task)
    for _ in range(5):
        action = agent.act(observation)
        observation, *_ = env.step(action)
    hypotheses = np.isfinite(action["hypothesis_log_weight"]).sum()
    print(f"{name}: {hypotheses} hypotheses, {action['object_valid'].sum()} objects")
