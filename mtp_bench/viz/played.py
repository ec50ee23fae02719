"""Replays of a stored run, with the causes of its errors."""

from collections.abc import Iterator

import numpy as np

from ..core import SERIAL, Progress, Rollout, Scene, Workers, cores
from ..running import OpenedRun, RunOptions, run_parts
from ..scoring import find_targets
from .run_replay import Replay, replay

_FEW = 4  # scenes that are scored before other processes have started


class PlayedRun:
    """A stored run whose scenes can be replayed; its causes are found first, unless they are known."""

    def __init__(self, opened: OpenedRun, options: RunOptions | None = None) -> None:
        self.opened = opened
        few = len(opened.run.rollouts) <= _FEW
        self._options = options or RunOptions(
            data=opened.data, workers=SERIAL if few else Workers(cores())
        )
        self.parts = run_parts(opened, self._options)  # by scene

    def replay(
        self, rollout: Rollout, scene: Scene | None = None, agent: str = ""
    ) -> Replay:
        """The replay of one rollout; ``scene``: with a road; ``agent``: in place of its name."""
        opened, name = self.opened, rollout.scene
        content = opened.scene(name) if scene is None else scene
        if not np.array_equal(
            self.parts[name].distance, find_targets(content, opened.card).distance
        ):
            self.parts = run_parts(
                opened, self._options, again=True
            )  # the data is another one
        return replay(
            content,
            rollout,
            opened.card,
            agent or opened.run.info.agent,
            self.parts[name],
        )


def replays(
    opened: OpenedRun, scene: str | None, progress: Progress
) -> Iterator[Replay]:
    """Replays of all scenes of a stored run, or of one ``scene``."""
    run, rollouts = PlayedRun(opened), opened.rollouts(scene)
    progress.started(len(rollouts))
    for rollout in rollouts:
        yield run.replay(rollout)
        progress.done(rollout.scene)
