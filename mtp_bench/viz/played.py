"""Replays of a stored run, with the causes of its errors."""

from collections.abc import Iterator

import numpy as np

from ..core import SERIAL, Progress, Rollout, Scene, Workers, cores
from ..running import OpenedRun, RunOptions, run_parts
from ..scoring import find_targets
from .run_replay import Replay, replay

_SERIAL_SCENES = 4  # so few are scored before other processes have started


class PlayedRun:
    """A stored run whose scenes can be replayed; its causes are found first."""

    def __init__(self, opened: OpenedRun) -> None:
        self.opened = opened
        is_short = len(opened.run.rollouts) <= _SERIAL_SCENES
        workers = SERIAL if is_short else Workers(cores())
        self._options = RunOptions(data=opened.data, workers=workers)
        self.parts = run_parts(opened, self._options)  # by scene

    def replay(
        self, rollout: Rollout, scene: Scene | None = None, agent: str = ""
    ) -> Replay:
        """Replay one rollout.

        ``scene``: its scene with a road, None: as stored. ``agent``: name to show in
        place of that of the run.
        """
        card = self.opened.card
        name = rollout.scene
        scene = self.opened.scene(name) if scene is None else scene
        distance = find_targets(scene, card).distance
        if not np.array_equal(self.parts[name].distance, distance):
            # the causes are of other data
            self.parts = run_parts(self.opened, self._options, again=True)
        agent = agent or self.opened.run.info.agent
        return replay(scene, rollout, card, agent, self.parts[name])


def replays(
    opened: OpenedRun, scene: str | None, progress: Progress
) -> Iterator[Replay]:
    """Replay all scenes of a stored run, or one ``scene``."""
    played = PlayedRun(opened)
    rollouts = opened.rollouts(scene)
    progress.started(len(rollouts))
    for rollout in rollouts:
        yield played.replay(rollout)
        progress.done(rollout.scene)
