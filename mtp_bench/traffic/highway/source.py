"""Scenes of simulated traffic: worlds from the cache, reduced to the card's frame rate, reach and classes."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Bools, CardError, Floats, Scene, Truth, starts_of
from ...sources import (
    Dataset,
    DataStatus,
    SourcePackage,
    Work,
    class_ids,
    no_detections,
    require_classes,
    section_of,
)
from .store import WorldStore
from .world import CLASSES, RATE, HighwaySource, SeedRanges, Traffic, World

IN_VIEW = 0.05  # least visible share of a box in view
DATASET = Dataset.of(__file__)


class TrafficScenes:
    """Scenes of the worlds of seeds, named ``<scenario>-<seed>``; a simulated detector adds the detections.

    Frame of reference: the road's, x and y in the plane, z up, the road at z = 0. Objects beyond the detector's reach
    or field of view are not in the truth. An object is a prediction target once it was visible, at any distance.
    """

    def __init__(self, card: Card, traffic: Any, seeds: SeedRanges) -> None:
        """``traffic``: as in `WorldStore`. Raises CardError for a class that no simulation has."""
        require_classes(card, "simulated traffic", CLASSES)
        self.card, self.store = card, WorldStore(traffic)
        self.seeds = range(*getattr(seeds, card.source.split))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of their seeds."""
        return tuple(map(self.name_of, self.seeds))

    def name_of(self, seed: int) -> str:
        """Name of the scene of one seed."""
        return f"{self.store.traffic.scenario}-{seed:06d}"

    def load(self, name: str) -> Scene:
        """One scene, from the cache or simulated now (one or two seconds)."""
        return scene_of(name, self.store.get(int(name.rsplit("-", 1)[1])), self.card)

    def missing(self, scenes: int | None = None) -> list[int]:
        """Seeds, of the first ones, whose worlds are not in the cache."""
        return [
            seed for seed in self.seeds[:scenes] if not self.store.path(seed).is_file()
        ]

    def generate(self, scenes: int | None, workers: int) -> Work:
        """Simulate those of the first scenes that are not in the cache."""
        seeds = self.missing(scenes)
        return len(seeds), map(self.name_of, self.store.make(seeds, workers))

    def discard(self) -> None:
        """Remove all scenes of the split from the cache."""
        for seed in self.seeds:
            self.store.path(seed).unlink(missing_ok=True)


class HighwayTraffic(TrafficScenes):
    """Scenes of the library's own traffic."""

    def __init__(self, card: Card, data: object = None) -> None:
        """``data``: not needed. Raises CardError for a rate or class that the simulation does not have."""
        section = section_of(card, HighwaySource)
        stride_of(card, RATE)
        super().__init__(card, traffic_of(section), section.seeds)


def package(scenes: Callable[[Card], TrafficScenes], dataset: Dataset) -> SourcePackage:
    """The package of a source of simulated ``scenes``: none is ever missing, as each is simulated when first used."""

    def status(card: Card, data: object) -> DataStatus:
        source = scenes(card)
        stored, folder = len(source.seeds) - len(source.missing()), source.store.folder
        note = f"{stored} of {len(source.seeds)} scenes are stored; each is simulated when it is first used"
        return DataStatus(dataset, folder, (folder,), notes=[note])

    return SourcePackage(
        open=lambda card, data: scenes(card),
        dataset=dataset,
        locate=status,
        prepare=lambda card, data, count, workers: scenes(card).generate(
            count, workers
        ),
        discard=lambda card: scenes(card).discard(),
        keep_private=lambda card: scenes(card).store.keep_private(),
    )


def scene_of(name: str, world: World, card: Card, stride: int | None = None) -> Scene:
    """The frames, classes and objects within reach of ``world`` that the card has; ``stride``: if it is known."""
    from ...detector import Sensor, covered

    detector = card.detector
    if detector is None:
        raise CardError(f"{card.id}: simulated traffic needs a [detector]")
    sensor = Sensor(detector.reach, float(np.deg2rad(detector.field_of_view)))
    stride = stride or stride_of(card, 1.0 / float(world.time[1]))
    frames = np.arange(0, len(world.time), stride)
    class_id = class_ids(CLASSES, card.task.classes)[world.truth.class_id]
    keep = covered(world.truth, world.ego, sensor) & (class_id >= 0)
    keep &= world.truth.frame_of_rows % stride == 0
    truth = replace(
        world.truth, eligible=ever_seen(world.truth, world.visible), class_id=class_id
    ).select(keep)
    truth = replace(
        truth, start=truth.start[np.append(frames, world.truth.frames)]
    )  # no rows between the frames
    time, ego, none = world.time[frames], world.ego[frames], no_detections(len(frames))
    return Scene(
        name, time, ego, truth, none, visible=world.visible[keep], lanes=world.lanes
    )


def stride_of(card: Card, rate: float, advice: str = "") -> int:
    """Steps of a simulation at ``rate`` Hz per frame of the task; CardError, with ``advice``, if it is not whole."""
    stride = round(rate / card.task.rate)
    if stride < 1 or not np.isclose(card.task.rate * stride, rate):
        expected = f"expected {rate:g} Hz or a whole part of it{advice}"
        raise CardError(f"{card.id}: task.rate is {card.task.rate:g} Hz, {expected}")
    return stride


def traffic_of(section: HighwaySource) -> Traffic:
    """The part of the section that the simulation depends on."""
    return Traffic(
        **{field.name: getattr(section, field.name) for field in fields(Traffic)}
    )


def ever_seen(truth: Truth, visible: Floats) -> Bools:
    """Mask of boxes whose object was in view in their frame or before, at any distance ``[R]``."""
    order = np.argsort(truth.object_id, kind="stable")  # rows are sorted by frame
    object_id, in_view = truth.object_id[order], visible[order] >= IN_VIEW
    first = np.searchsorted(object_id, object_id)
    views = starts_of(in_view)
    seen = np.empty(len(order), dtype=bool)
    seen[order] = views[1:] > views[first]
    return seen
