"""Scenes of a closed loop: the present frame while it is driven, and the recording."""

from dataclasses import replace

import numpy as np

from ...cards import Card
from ...core import Detections, Floats, Scene, joined, starts_of
from ...detector import Memory, OpenScene, visible_fractions
from ...sources import detected
from ..highway.source import scene_of
from ..highway.world import RATE, World


class DrivenScene:
    """Frames of one drive, shown one after the other.

    The detections are those of the whole scene at once.
    """

    def __init__(self, card: Card, name: str) -> None:
        self._card = card
        self._name = name
        self._ego: list[Floats] = []
        self._detections: list[Detections] = []
        self._detector = ""
        self._open_scene: OpenScene | None = None

    def now(self, world: World) -> Scene:
        """Return the last frame of the world as a scene with detections."""
        scene = _scene(world, self._card, self._name, stride=1)
        frame = len(self._ego)
        self._ego.append(scene.ego[0])
        if self._open_scene is None:
            frames = horizon(self._card)
            self._open_scene = OpenScene(frames, scene.truth, memory=Memory())
        start = starts_of([0] * frame + [len(scene.truth.box)])
        until_now = replace(
            scene,
            time=np.arange(frame + 1) / self._card.task.rate,
            ego=np.array(self._ego),
            truth=replace(scene.truth, start=start),
        )
        seen = detected(until_now, self._card, going_on=self._open_scene)
        self._detector = seen.detector
        detections = replace(seen.detections, start=seen.detections.start[-2:])
        self._detections.append(detections)
        return replace(scene, detections=detections, simulated=True)

    def whole(self, world: World) -> Scene:
        """Return `whole_scene` of the frames of ``world``, all of which were shown."""
        scene = _scene(world, self._card, self._name)
        shown = self._detections[: scene.frames]
        start = starts_of([len(detections.score) for detections in shown])
        return replace(
            scene,
            detections=replace(joined(shown), start=start),
            detector=self._detector,
            simulated=True,
        )


def whole_scene(world: World, card: Card, name: str) -> Scene:
    """Return the recording of a drive with the detections then shown."""
    scene = _scene(world, card, name)
    return detected(scene, card, going_on=OpenScene(horizon(card), scene.truth.only(0)))


def _scene(world: World, card: Card, name: str, stride: int | None = None) -> Scene:
    world = replace(world, visible=visible_fractions(world.truth, world.ego))
    return scene_of(name, world, card, stride or round(RATE / card.task.rate))


def horizon(card: Card) -> int:
    """Return the frames of the longest drive."""
    seconds = float(card.source.traits.scene_seconds or 0)
    return round(seconds * card.task.rate) + 1
