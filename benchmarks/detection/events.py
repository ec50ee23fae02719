"""Switches and losses of a tracker on scenes with given detections."""

from __future__ import annotations

from collections.abc import Sequence

from mtp_bench.agent.loader import load_submission
from mtp_bench.core import Scene
from mtp_bench.env.environment import MTPEnv
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.scoring import score_scene


class _Scenes:
    """A source of scenes that are known already."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._scenes = {scene.name: scene for scene in scenes}
        self.names = tuple(self._scenes)

    def load(self, name: str) -> Scene:
        return self._scenes[name]


def switches_and_losses(
    env_id: str, data: str | None, scenes: Sequence[Scene], agent: str = "stp"
) -> tuple[int, int]:
    """Identity switches and losses of an agent over ``scenes``, scenes of the env with any detections."""
    env = MTPEnv(env_id, data, evaluation=True)
    env._source = _Scenes(
        scenes
    )  # the tracker's parameters stay those of the card's detector
    submission, counts = load_submission(agent), [0, 0]
    for scene in scenes:
        rollout = run_scene(submission.build(agent_task(env, 0)), env, scene.name, 0)
        events = score_scene(env.scene, rollout, env.card).own_events
        counts = [counts[0] + events["ids"], counts[1] + events["lost"]]
    return counts[0], counts[1]
