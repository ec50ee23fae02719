"""Forecasts of the tracks of a frame, and the inputs that a network would get of them."""

import mtp_bench
from mtp_bench.prediction import KinematicPredictor, local_inputs, windows_of
from mtp_bench.tracking import HypothesisTracker

env = mtp_bench.MTPEnv("MTP-Roundabout-v0")
tracker, predictor = HypothesisTracker(1), KinematicPredictor()
tracker.reset(env.task)
predictor.reset(env.task)
observation, info = env.reset(seed=0)
frame = mtp_bench.Frame(0, tracker.step(observation), (observation,))
print("samples [N, k, T, 2]:", predictor.predict(frame).samples.shape)
windows, row = windows_of(frame, env.task.past)
for name, value in local_inputs(windows).items():
    print(f"{name}: {value.shape}")
