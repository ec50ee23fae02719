"""Tracks of a scene, of one hypothesis and of twenty."""

import numpy as np

import mtp_bench
from mtp_bench.tracking import HypothesisTracker

env = mtp_bench.MTPEnv("MTP-Roundabout-v0")
for hypotheses in (1, 20):
    tracker = HypothesisTracker(hypotheses)
    tracker.reset(env.task)
    observation, info = env.reset(seed=0)
    for _ in range(10):
        tracks = tracker.step(observation)
        no_forecast = (
            np.zeros((0, 7)),
            np.zeros(0, dtype=int),
            np.zeros((0, env.task.future, 2)),
        )
        observation, *_ = env.step(
            mtp_bench.make_action(env.task, *no_forecast, tracks=tracks)
        )
    print(
        f"H = {len(tracks.log_weight)}: {len(tracks.box)} tracks, {tracks.member[0].sum()} in the likeliest hypothesis"
    )
