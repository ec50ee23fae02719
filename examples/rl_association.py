"""Reinforcement learning on association: PPO decides which detection belongs to which track.

    pip install '.[rl]'  # in the checkout
    python examples/rl_association.py              # 2 000 steps; with a number, that many; with two, another seed

Prints the reward per step on scenes that PPO was not trained on: of PPO before and after training, of the best constant
policy, and of the nearest neighbour. A constant policy gives the same action in every frame. The best of them is looked
for among 61, on training scenes.
"""

# needs: stable-baselines3

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import mtp_bench
from mtp_bench.wrappers import IGNORE, AssociationOnly

ENV = "MTP-Roundabout-v0"  # a roadside sensor that sees about 15 vehicles
DETECTIONS = 16
CHOICES = 1  # ignore a detection, begin a track with it, or continue the nearest track
TRAINING, SEARCH, HELD_OUT = slice(10), slice(2), slice(5, 10)  # scenes: of "train", of "train", of "val"
AT_RANDOM = 40  # constant policies
Policy = Callable[[NDArray[np.float32]], NDArray[Any]]


def make_env(split: str, scenes: slice) -> AssociationOnly:
    """Some scenes of a split."""
    names = mtp_bench.MTPEnv(ENV, split=split).scene_names[scenes]
    return AssociationOnly(gym.make(ENV, split=split, scenes=names), detections=DETECTIONS, choices=CHOICES)


def reward_per_step(env: AssociationOnly, policy: Policy) -> float:
    """Mean over all scenes of the env."""
    rewards = []
    for name in env.get_wrapper_attr("scene_names"):
        observation, _ = env.reset(seed=0, options={"scene": name})
        over = False
        while not over:
            observation, reward, over, *_ = env.step(policy(observation))
            rewards.append(float(reward))
    return float(np.mean(rewards))


def best_constant(env: AssociationOnly) -> Policy:
    """The best of the policies that do the same in every frame: one choice for the surest detections, one for the rest.

    And of some at random.
    """
    values = range(IGNORE, IGNORE + 2 + CHOICES)
    place = np.arange(DETECTIONS)
    constants = [np.where(place < surest, a, b) for a in values for b in values for surest in (4, 8, 12) if a != b]
    constants += [np.full(DETECTIONS, a) for a in values]
    rng = np.random.default_rng(0)
    constants += list(rng.integers(len(values), size=(AT_RANDOM, DETECTIONS)))
    found = [reward_per_step(env, lambda _, action=action: action) for action in constants]  # type: ignore[misc]
    best = constants[int(np.argmax(found))]
    return lambda observation: best


def main(steps: int = 2000, seed: int = 0) -> dict[str, float]:
    """Train, and print the reward per step of each policy on held-out scenes."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    torch.set_num_threads(1)  # the network is small
    discount = 0.5  # a choice matters most in the next few frames
    envs = VecNormalize(DummyVecEnv([lambda: make_env("train", TRAINING)]), norm_obs=False, gamma=discount)
    layers = {"net_arch": {"pi": [], "vf": [64]}}  # what to choose is linear in the observation: 2 000 steps are few
    sizes: dict[str, Any] = {"n_steps": 100, "batch_size": 50, "learning_rate": 0.03, "policy_kwargs": layers}
    agent = PPO("MlpPolicy", envs, gamma=discount, seed=seed, device="cpu", **sizes)

    def trained(observation: NDArray[np.float32]) -> NDArray[Any]:
        return agent.predict(observation, deterministic=True)[0]

    held_out = make_env("val", HELD_OUT)
    constant = best_constant(make_env("train", SEARCH))
    rewards = {"untrained": reward_per_step(held_out, trained)}
    agent.learn(steps)
    rewards["PPO"] = reward_per_step(held_out, trained)
    rewards["best constant"] = reward_per_step(held_out, constant)
    rewards["nearest neighbour"] = reward_per_step(held_out, held_out.nearest)
    for name, reward in rewards.items():
        print(f"{name:18} {reward:8.2f} m per step")
    beaten = "beaten" if rewards["PPO"] > rewards["best constant"] else "not beaten"
    print(f"after {agent.num_timesteps} steps the best constant policy is {beaten} by PPO")
    return rewards


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
