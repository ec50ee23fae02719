"""Scenes of simulated traffic: worlds from the cache, as a card wants them."""

from collections.abc import Callable
from dataclasses import fields, replace

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

_MIN_VISIBLE_SHARE = 0.05  # of a box in view
DATASET = Dataset.of(__file__)


class TrafficScenes:
    """Scenes of the worlds of seeds, named ``<scenario>-<seed>``.

    A simulated detector adds the detections. Frame of reference: the road's, x and y in
    the plane, z up, the road at z = 0. Objects beyond the detector's reach or field of
    view are not in the truth. An object is a prediction target once it was visible, at
    any distance.
    """

    def __init__(self, card: Card, store: WorldStore, seeds: SeedRanges) -> None:
        """Raise CardError for a class that no simulation has."""
        require_classes(card, "simulated traffic", CLASSES)
        self.card = card
        self.store = store
        self.seeds = range(*getattr(seeds, card.source.split))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes, in the order of their seeds."""
        return tuple(map(self.name_of, self.seeds))

    def name_of(self, seed: int) -> str:
        """Return the name of the scene of one seed."""
        return f"{self.store.traffic.scenario}-{seed:06d}"

    def load(self, name: str) -> Scene:
        """Read one scene, or simulate it (one or two seconds)."""
        return scene_of(name, self.store.get(int(name.rsplit("-", 1)[1])), self.card)

    def missing(self, scenes: int | None = None) -> list[int]:
        """Return those of the first seeds that are not stored."""
        seeds = self.seeds[:scenes]
        return [seed for seed in seeds if not self.store.path(seed).is_file()]

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
        """Raise CardError for an impossible rate or class.

        ``data`` is not needed.
        """
        section = section_of(card, HighwaySource)
        stride_of(card, RATE)
        store = WorldStore(traffic_of(section), _simulate)
        super().__init__(card, store, section.seeds)


def _simulate(traffic: Traffic, seed: int) -> World:
    from .simulate import simulate_world  # imports highway-env

    return simulate_world(traffic, seed)


def package(scenes: Callable[[Card], TrafficScenes], dataset: Dataset) -> SourcePackage:
    """Return the package of a source of simulated ``scenes``.

    No scene is ever missing, as each is simulated when it is first used.
    """

    def status(card: Card, data: object) -> DataStatus:
        source = scenes(card)
        folder = source.store.folder
        total = len(source.seeds)
        stored = f"{total - len(source.missing())} of {total} scenes are stored"
        note = f"{stored}; each is simulated when it is first used"
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
    """Return the frames, classes and objects of ``world`` that the card has.

    ``stride``: frames of the world per frame of the card, if it is known.
    """
    from ...detector import Sensor, covered

    detector = card.detector
    if detector is None:
        raise CardError(f"{card.id}: simulated traffic needs a [detector]")
    sensor = Sensor(detector.reach, float(np.deg2rad(detector.field_of_view)))
    stride = stride or stride_of(card, 1.0 / float(world.time[1]))
    truth = world.truth
    frames = np.arange(0, len(world.time), stride)
    class_id = class_ids(CLASSES, card.task.classes)[truth.class_id]
    shown = covered(truth, world.ego, sensor) & (class_id >= 0)
    shown &= truth.frame_of_rows % stride == 0
    eligible = ever_seen(truth, world.visible)
    rows = replace(truth, eligible=eligible, class_id=class_id).select(shown)
    # no rows between the frames
    start = rows.start[np.append(frames, truth.frames)]
    return Scene(
        name,
        world.time[frames],
        world.ego[frames],
        replace(rows, start=start),
        no_detections(len(frames)),
        visible=world.visible[shown],
        lanes=world.lanes,
    )


def stride_of(card: Card, rate: float, advice: str = "") -> int:
    """Return steps of a simulation per frame of the task.

    ``rate``: steps of the simulation per second. Raises CardError, with ``advice``, if
    it is not whole.
    """
    stride = round(rate / card.task.rate)
    if stride < 1 or not np.isclose(card.task.rate * stride, rate):
        expected = f"expected {rate:g} Hz or a whole part of it{advice}"
        raise CardError(f"{card.id}: task.rate is {card.task.rate:g} Hz, {expected}")
    return stride


def traffic_of(section: HighwaySource) -> Traffic:
    """Return the part of the section that the simulation depends on."""
    names = [setting.name for setting in fields(Traffic)]
    return Traffic(**{name: getattr(section, name) for name in names})


def ever_seen(truth: Truth, visible: Floats) -> Bools:
    """Mark boxes [R] whose object was in view by then.

    It may have been at any distance.
    """
    order = np.argsort(truth.object_id, kind="stable")  # rows are sorted by frame
    object_id = truth.object_id[order]
    first = np.searchsorted(object_id, object_id)
    views = starts_of(visible[order] >= _MIN_VISIBLE_SHARE)
    seen = np.empty(len(order), dtype=bool)
    seen[order] = views[1:] > views[first]
    return seen
