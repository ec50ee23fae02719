"""One episode of an environment in which every detection is forecast to stand still."""

import gymnasium as gym
import numpy as np

import mtp_bench

env = gym.make("MTP-Intersection-v0")
(observation, info), task = env.reset(seed=0), env.unwrapped.task
total, over = 0.0, False
while not over:
    seen = observation["detection_valid"] == 1
    boxes, classes = (
        observation["detection_box"][seen],
        observation["detection_class"][seen],
    )
    still = np.zeros((len(boxes), task.future, 2))  # metres from the centre of each box
    observation, reward, over, _, info = env.step(
        mtp_bench.make_action(task, boxes, classes, still)
    )
    total += reward
print(
    f"{env.unwrapped.card.id}, one of {len(mtp_bench.card_ids())} environments: reward {total:.0f} m"
)
