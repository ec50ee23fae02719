"""Scenes of a closed loop: the frame of now while it is driven, and the whole recording after it."""

from dataclasses import replace

import numpy as np

from ..cards import Card
from ..detector.grid import Memory
from ..detector.simulate import OpenScene
from ..detector.visibility import visible_fractions
from ..sources.highway.source import scene_of
from ..sources.highway.world import RATE, World
from ..sources.simulated import detected
from ..types import Floats, Scene, starts_of


class DrivenScene:
    """The frames of one drive, shown one after the other; detections are those of the whole scene at once."""

    def __init__(self, card: Card, name: str) -> None:
        self._card, self._name = card, name
        self._ego: list[Floats] = []
        self._going_on: OpenScene | None = None

    def now(self, world: World) -> Scene:
        """The frame of now alone, from the last frame of the world, as a scene of one frame with its detections."""
        world = replace(world, visible=visible_fractions(world.truth, world.ego))
        scene = scene_of(self._name, world, self._card, stride=1)
        frame = len(self._ego)
        self._ego.append(scene.ego[0])
        if self._going_on is None:
            self._going_on = OpenScene(horizon(self._card), scene.truth, memory=Memory())
        start = starts_of([0] * frame + [len(scene.truth.box)])
        before = np.array(self._ego)
        period = 1.0 / self._card.task.rate
        so_far = replace(
            scene, time=np.arange(frame + 1) * period, ego=before, truth=replace(scene.truth, start=start),
            detections=replace(scene.detections, start=np.zeros(frame + 2, dtype=np.int64)),
        )  # fmt: skip
        last = detected(so_far, self._card, going_on=self._going_on).detections.only(frame)
        return replace(scene, detections=replace(last, start=last.start[-2:]), simulated=True)


def whole_scene(world: World, card: Card, name: str) -> Scene:
    """The recording of a drive under the rules of ``card``, with the detections that its agent was shown."""
    world = replace(world, visible=visible_fractions(world.truth, world.ego))
    scene = scene_of(name, world, card, round(RATE / card.task.rate))
    return detected(scene, card, going_on=OpenScene(horizon(card), scene.truth.only(0)))


def horizon(card: Card) -> int:
    """Frames of the longest drive."""
    return round(float(card.source.traits.scene_seconds or 0) * card.task.rate) + 1
