"""Replays of a stored run, with the causes of its errors."""

from collections.abc import Iterator

import numpy as np

from ..core import SERIAL, Progress, Rollout, Scene, Workers, cores
from ..doubts import Doubt
from ..running import OpenedRun, RunOptions, run_parts, scene_doubts
from ..scoring import find_targets
from .run_replay import Replay, replay

_SERIAL_SCENES = 4  # so few are scored before other processes have started


class PlayedRun:
    """A stored run whose scenes can be replayed; its causes are found first.

    Unless ``no_doctor``, doubts about its data are among them.
    """

    def __init__(self, opened: OpenedRun, no_doctor: bool = False) -> None:
        self.opened = opened
        self.no_doctor = no_doctor
        is_short = len(opened.run.rollouts) <= _SERIAL_SCENES
        workers = SERIAL if is_short else Workers(cores())
        self._options = RunOptions(data=opened.data, workers=workers)
        self.parts = run_parts(opened, self._options)  # by scene

    def replay(self, rollout: Rollout, scene: Scene | None = None) -> Replay:
        """Replay one rollout.

        ``scene``: its scene with a road, None: as stored.
        """
        card = self.opened.card
        name = rollout.scene
        scene = self.opened.scene(name) if scene is None else scene
        distance = find_targets(scene, card).distance
        if not np.array_equal(self.parts[name].distance, distance):
            # the causes are of other data
            self.parts = run_parts(self.opened, self._options, again=True)
        agent = self.opened.run.info.agent
        doubts: tuple[Doubt, ...] = ()
        if rollout.drive is None and not self.no_doctor:
            recorded = self.opened.source.load(name)
            doubts = scene_doubts(recorded, card, self.opened.data)
        return replay(scene, rollout, card, agent, self.parts[name], doubts)


def replays(
    opened: OpenedRun, scene: str | None, progress: Progress, no_doctor: bool = False
) -> Iterator[Replay]:
    """Replay all scenes of a stored run, or one ``scene``.

    ``no_doctor``: as of `PlayedRun`.
    """
    played = PlayedRun(opened, no_doctor)
    rollouts = opened.rollouts(scene)
    progress.started(len(rollouts))
    for rollout in rollouts:
        yield played.replay(rollout)
        progress.done(rollout.scene)
