"""Two frames of the environment in which an agent associates alone."""

import gymnasium as gym

from mtp_bench.wrappers import AssociationOnly

env = AssociationOnly(gym.make("MTP-Roundabout-v0"), detections=16, choices=1)
observation, info = env.reset(seed=0)
for _ in range(2):
    choices = env.nearest(
        observation
    )  # 0: ignore the detection, 1: begin a track, 2: continue the nearest one
    print(choices)
    observation, *_ = env.step(choices)
