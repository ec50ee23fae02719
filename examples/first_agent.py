"""A first agent of your own: it finds each detection in the frame before and forecasts constant velocity.

    python examples/first_agent.py

It is compared with one whose objects all stand still. Simulated traffic: no data is downloaded.
"""

import gymnasium as gym
import numpy as np

import mtp_bench


class Standing:
    """Every detection is an object that stays where it is."""

    def reset(self, task):
        self.task = task

    def act(self, observation):
        seen = observation["detection_valid"] == 1
        box, kind = (
            observation["detection_box"][seen],
            observation["detection_class"][seen],
        )
        steps = np.arange(1, self.task.future + 1)  # T frames ahead
        forecast = (
            self.velocity(box, kind)[:, None, :] * steps[None, :, None]
        )  # [objects, T, 2] m from the box
        return mtp_bench.make_action(self.task, box, kind, forecast)

    def velocity(self, box, kind):
        """Metres per frame [objects, 2]."""
        return np.zeros((len(box), 2))


class Nearest(Standing):
    """An object moves as far as it is from the nearest detection of its class in the frame before."""

    reach = 8.0  # m: farther detections are of other objects

    def reset(self, task):
        super().reset(task)
        self.before = np.zeros((0, 2)), np.zeros(0)

    def velocity(self, box, kind):
        place, (old_place, old_kind) = box[:, :2], self.before
        self.before = place, kind
        if not len(old_place) or not len(place):
            return np.zeros((len(box), 2))
        step = place[:, None] - old_place[None]  # [objects, earlier, 2]
        far = np.linalg.norm(step, axis=-1) + np.where(
            kind[:, None] == old_kind, 0, np.inf
        )
        nearest = far.argmin(axis=1)
        known = far.min(axis=1) < self.reach
        return np.where(known[:, None], step[np.arange(len(box)), nearest], 0)


env = gym.make("MTP-Intersection-v0")
for agent in (Standing(), Nearest()):
    observation, info = env.reset(seed=0)
    agent.reset(env.unwrapped.task)
    over = False
    while not over:
        observation, reward, over, _, info = env.step(agent.act(observation))
    score = info["episode_metrics"]
    covered = (
        f"{score['min_ade']:.2f} m over the {score['covered']} that have a forecast"
    )
    print(
        f"{type(agent).__name__}: {score['fixed_error']:.2f} m per target of {score['targets']}, minADE {covered}"
    )
