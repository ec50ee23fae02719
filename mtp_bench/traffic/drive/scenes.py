"""Scenes of a closed loop: the frame of now while it is driven, and the whole recording after it."""

from dataclasses import replace

import numpy as np

from ...cards import Card
from ...core import Detections, Floats, Scene, joined, starts_of
from ...detector import Memory, OpenScene, visible_fractions
from ...sources import detected
from ..highway.source import scene_of
from ..highway.world import RATE, World


class DrivenScene:
    """The frames of one drive, shown one after the other; detections are those of the whole scene at once."""

    def __init__(self, card: Card, name: str) -> None:
        self._card, self._name = card, name
        self._ego: list[Floats] = []
        self._shown, self._detector = list[Detections](), ""
        self._going_on: OpenScene | None = None

    def now(self, world: World) -> Scene:
        """The frame of now alone, from the last frame of the world, as a scene of one frame with its detections."""
        scene = _scene(world, self._card, self._name, stride=1)
        frame = len(self._ego)
        self._ego.append(scene.ego[0])
        if self._going_on is None:
            self._going_on = OpenScene(
                horizon(self._card), scene.truth, memory=Memory()
            )
        start = starts_of([0] * frame + [len(scene.truth.box)])
        time, before = np.arange(frame + 1) / self._card.task.rate, np.array(self._ego)
        so_far = replace(
            scene, time=time, ego=before, truth=replace(scene.truth, start=start)
        )
        seen = detected(so_far, self._card, going_on=self._going_on)
        self._detector, found = (
            seen.detector,
            replace(seen.detections, start=seen.detections.start[-2:]),
        )
        self._shown.append(found)
        return replace(scene, detections=found, simulated=True)

    def whole(self, world: World) -> Scene:
        """`whole_scene` of the frames of ``world``, all of which were shown."""
        scene = _scene(world, self._card, self._name)
        shown = self._shown[: scene.frames]
        start = starts_of([len(found.score) for found in shown])
        found = replace(joined(shown), start=start)
        return replace(scene, detections=found, detector=self._detector, simulated=True)


def whole_scene(world: World, card: Card, name: str) -> Scene:
    """The recording of a drive under the rules of ``card``, with the detections that its agent was shown."""
    scene = _scene(world, card, name)
    return detected(scene, card, going_on=OpenScene(horizon(card), scene.truth.only(0)))


def _scene(world: World, card: Card, name: str, stride: int | None = None) -> Scene:
    world = replace(world, visible=visible_fractions(world.truth, world.ego))
    return scene_of(name, world, card, stride or round(RATE / card.task.rate))


def horizon(card: Card) -> int:
    """Frames of the longest drive."""
    return round(float(card.source.traits.scene_seconds or 0) * card.task.rate) + 1
