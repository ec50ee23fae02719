"""Scenes of simulated traffic: worlds from the cache, reduced to the card's frame rate, reach and classes."""

from dataclasses import fields, replace

import numpy as np

from ...cards import Card
from ...errors import CardError
from ...types import Bools, Floats, Scene, Truth, starts_of
from ..base import Work, class_ids, no_detections, require_classes, section_of
from ..dataset import Dataset, DataStatus
from .store import WorldStore
from .world import CLASSES, RATE, HighwaySource, Traffic, World

IN_VIEW = 0.05  # least visible share of a box in view
DATASET = Dataset.of(__file__)


class HighwayTraffic:
    """Scenes of one split, named ``<scenario>-<seed>``; a simulated detector adds the detections.

    Frame of reference: the road's, x and y in the plane, z up, the road at z = 0. Objects beyond the detector's reach
    or field of view are not in the truth. An object is a prediction target once it was visible, at any distance.
    """

    def __init__(self, card: Card, data: object = None) -> None:
        """``data``: not needed. Raises CardError for a rate or class that the simulation does not have."""
        self.card = card
        self.section = section_of(card, HighwaySource)
        stride_of(card, RATE)
        require_classes(card, "simulated traffic", CLASSES)
        first, end = getattr(self.section.seeds, self.section.split)
        self.names = tuple(scene_name(self.section.scenario, seed) for seed in range(first, end))
        self.store = WorldStore(traffic_of(self.section))

    def load(self, name: str) -> Scene:
        """One scene, from the cache or simulated now (one or two seconds)."""
        return scene_of(name, self.store.get(seed_of(name)), self.card)

    def discard(self) -> None:
        """Remove all scenes of the split from the cache."""
        for name in self.names:
            self.store.path(seed_of(name)).unlink(missing_ok=True)


def scene_of(name: str, world: World, card: Card) -> Scene:
    """The frames, classes and objects within reach of ``world`` that the card has."""
    from ...detector.visibility import Sensor, covered

    detector = card.detector
    if detector is None:
        raise CardError(f"{card.id}: simulated traffic needs a [detector]")
    sensor = Sensor(detector.reach, float(np.deg2rad(detector.field_of_view)))
    stride = stride_of(card, 1.0 / float(world.time[1]))
    frames = np.arange(0, len(world.time), stride)
    class_id = class_ids(CLASSES, card.task.classes)[world.truth.class_id]
    keep = covered(world.truth, world.ego, sensor) & (class_id >= 0)
    keep &= world.truth.frame_of_rows % stride == 0
    truth = replace(world.truth, eligible=ever_seen(world.truth, world.visible), class_id=class_id).select(keep)
    truth = replace(truth, start=truth.start[np.append(frames, world.truth.frames)])  # no rows between the frames
    time, ego, none = world.time[frames], world.ego[frames], no_detections(len(frames))
    return Scene(name, time, ego, truth, none, visible=world.visible[keep], lanes=world.lanes)


def stride_of(card: Card, rate: float, advice: str = "") -> int:
    """Steps of a simulation at ``rate`` Hz per frame of the task; CardError, with ``advice``, if it is not whole."""
    stride = round(rate / card.task.rate)
    if stride < 1 or not np.isclose(card.task.rate * stride, rate):
        expected = f"expected {rate:g} Hz or a whole part of it{advice}"
        raise CardError(f"{card.id}: task.rate is {card.task.rate:g} Hz, {expected}")
    return stride


def generate(card: Card, data: object, scenes: int | None, workers: int) -> Work:
    """Simulate those of the first scenes of the card that are not in the cache."""
    source = HighwayTraffic(card)
    seeds = [seed for seed in map(seed_of, source.names[:scenes]) if source.store.read(seed) is None]
    made = source.store.make(seeds, workers)
    return len(seeds), (scene_name(source.section.scenario, seed) for seed in made)


def highway_status(card: Card, data: object = None) -> DataStatus:
    """Status of the cache; scenes are never missing, as each is simulated when it is first used."""
    source = HighwayTraffic(card)
    status = DataStatus(DATASET, source.store.folder, (source.store.folder,))
    stored = sum(source.store.read(seed_of(name)) is not None for name in source.names)
    status.notes.append(f"{stored} of {len(source.names)} scenes are stored; each is simulated when it is first used")
    return status


def traffic_of(section: HighwaySource) -> Traffic:
    """The part of the section that the simulation depends on."""
    return Traffic(**{field.name: getattr(section, field.name) for field in fields(Traffic)})


def scene_name(scenario: str, seed: int) -> str:
    """Name of the scene of one seed."""
    return f"{scenario}-{seed:06d}"


def seed_of(name: str) -> int:
    """Seed of a scene by its name."""
    return int(name.rsplit("-", 1)[1])


def ever_seen(truth: Truth, visible: Floats) -> Bools:
    """Mask of boxes whose object was in view in their frame or before, at any distance ``[R]``."""
    order = np.argsort(truth.object_id, kind="stable")  # rows are sorted by frame
    object_id, in_view = truth.object_id[order], visible[order] >= IN_VIEW
    first = np.searchsorted(object_id, object_id)
    views = starts_of(in_view.astype(np.int64))
    seen = np.empty(len(order), dtype=bool)
    seen[order] = views[1:] > views[first]
    return seen
