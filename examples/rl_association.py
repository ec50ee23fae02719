"""Reinforcement learning on association: a network decides for each detection which track it belongs to.

    pip install '.[rl]'  # in the checkout
    python examples/rl_association.py              # PPO, 2 048 steps
    python examples/rl_association.py 16384 1 DQN  # steps, seed, method

Prints on scenes without training how much more a frame earns than with the policy "nearest", as training goes on.
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
from mtp_bench.wrappers import AssociationOnly, PerDetection

ENV = "MTP-Roundabout-v0"  # a roadside sensor that sees about 15 vehicles
TRAINING, HELD_OUT = slice(10), slice(5, 10)  # scenes: of "train", of "val"
DISCOUNT = (
    0.9  # per detection: a choice matters most in its own frame, then in the next one
)
EVERY = 2048  # steps between two evaluations
METHODS: dict[str, dict[str, Any]] = {
    "PPO": {
        "n_steps": 512,
        "batch_size": 256,
        "learning_rate": 0.003,
        "gae_lambda": 0.9,
        "ent_coef": 0.003,
    },
    "DQN": {
        "learning_rate": 0.001,
        "learning_starts": 500,
        "exploration_fraction": 0.3,
        "target_update_interval": 500,
    },
}


def make_env(split: str, scenes: slice) -> PerDetection:
    """Some scenes of a split, with the frames that can hold a target."""
    names = mtp_bench.MTPEnv(ENV, split=split).scene_names[scenes]
    env = gym.make(ENV, split=split, scenes=names, target_frames=True)
    return PerDetection(AssociationOnly(env, detections=16, choices=1))


def gain(env: PerDetection, policy: Callable[[NDArray[np.float32]], Any]) -> float:
    """Metres per frame that a policy earns more than "nearest", over all scenes of the env."""
    earned, frames = 0.0, 0
    for name in env.get_wrapper_attr("scene_names"):
        observation, _ = env.reset(seed=0, options={"scene": name})
        over = False
        while not over:
            observation, reward, over, _, info = env.step(policy(observation))
            earned, frames = earned + float(reward), frames + (info["detection"] == 0)
    return earned / frames


def main(steps: int = EVERY, seed: int = 0, method: str = "PPO") -> list[float]:
    """Train, and print the gain before training and after every 2 048 steps."""
    import stable_baselines3 as sb3
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    torch.set_num_threads(1)  # the network is small
    envs = VecNormalize(
        DummyVecEnv([lambda: make_env("train", TRAINING)]), gamma=DISCOUNT
    )
    layers = {"net_arch": [32]}
    learner = getattr(sb3, method)
    agent = learner(
        "MlpPolicy",
        envs,
        gamma=DISCOUNT,
        seed=seed,
        device="cpu",
        policy_kwargs=layers,
        **METHODS[method],
    )
    held_out, curve = make_env("val", HELD_OUT), []
    for done in range(0, steps + 1, EVERY):
        curve.append(
            gain(
                held_out,
                lambda row: agent.predict(envs.normalize_obs(row), deterministic=True)[
                    0
                ],
            )
        )
        print(
            f"{method}, {done:6} steps: {curve[-1]:+7.2f} m per frame against nearest"
        )
        if done < steps:
            agent.learn(min(EVERY, steps - done), reset_num_timesteps=False)
    return curve


if __name__ == "__main__":
    main(
        *(
            kind(argument)
            for kind, argument in zip((int, int, str), sys.argv[1:], strict=False)
        )
    )
