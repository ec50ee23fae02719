"""Scenes of simulated traffic: worlds from the cache, as a card wants them.

Worlds lie on disk with a hash of their content; broken files are simulated again.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...cards import Card
from ...core import (
    CACHE_VARIABLE,
    Bools,
    CardError,
    DataError,
    Floats,
    Lane,
    Scene,
    Truth,
    Workers,
    cache_root,
    remove_damaged,
    starts_of,
    unordered_map,
)
from ...sources import (
    Arrays,
    Dataset,
    DataStatus,
    SourcePackage,
    Work,
    class_ids,
    no_detections,
    read_arrays,
    require_classes,
    section_of,
    write_arrays,
)
from .world import (
    CLASSES,
    GENERATOR,
    RATE,
    SECRET_SEEDS,
    HighwaySource,
    SeedRanges,
    Traffic,
    World,
)


@dataclass(frozen=True)
class WorldStore:
    """Worlds of one kind of traffic, by seed, in the cache folder.

    ``traffic``: a dataclass of all that their content depends on, with a ``scenario``;
    ``simulate``: a function of a module, which other processes can call, of the traffic
    and a seed.
    """

    traffic: Any
    simulate: Callable[[Any, int], World]

    @cached_property
    def folder(self) -> Path:
        """Folder of the worlds of this traffic.

        Its name has a digest of everything that their content depends on.
        """
        from importlib.metadata import version

        settings = {
            **asdict(self.traffic),
            "generator": GENERATOR,
            "highway-env": version("highway-env"),
        }
        text = json.dumps(settings, sort_keys=True)
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        return cache_root() / "worlds" / f"{self.traffic.scenario}-{digest}"

    @property
    def secret_folder(self) -> Path:
        """Folder of the worlds of secret seeds."""
        return self.folder.with_name(f"{self.folder.name}-secret")

    def path(self, seed: int) -> Path:
        """Return the file of one world.

        Those of secret seeds have a folder apart.
        """
        folder = self.secret_folder if seed >= SECRET_SEEDS else self.folder
        return folder / f"{seed:06d}.npz"

    def read(self, seed: int) -> World | None:
        """Return the stored world.

        None if it is missing or changed.
        """
        arrays = read_arrays(self.path(seed))
        try:
            return None if arrays is None else unpack(arrays)
        except KeyError:
            return None

    def get(self, seed: int) -> World:
        """Return the stored world, or simulate and store it.

        Raises DataError if that is impossible.
        """
        from ...detector import visible_fractions

        if (stored := self.read(seed)) is not None:
            return stored
        path = self.path(seed)
        with _writable(path.parent):
            remove_damaged(path)
            world = self.simulate(self.traffic, seed)
            world = replace(world, visible=visible_fractions(world.truth, world.ego))
            write_arrays(path, pack(world))
        return world

    def make(self, seeds: Sequence[int], workers: int = 1) -> Iterator[int]:
        """Store worlds over ``workers`` processes.

        Yields each seed when it is done.
        """
        tasks = [(self, seed) for seed in seeds]
        for index, _ in unordered_map(_make_one, tasks, Workers(max(1, workers))):
            yield seeds[index]

    def keep_private(self) -> None:
        """Close the folder of secret worlds to other users.

        Raises DataError if they cannot be stored.
        """
        with _writable(self.secret_folder):
            self.secret_folder.chmod(0o700)


def _make_one(store: WorldStore, seed: int) -> None:
    store.get(seed)


@contextmanager
def _writable(folder: Path) -> Iterator[None]:
    """Make a folder for worlds.

    An OSError in the block becomes a DataError.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        problem = f"generated scenes cannot be stored in {folder}: {error.strerror}"
        raise DataError(f"{problem}; set {CACHE_VARIABLE} to another folder") from None


def pack(world: World) -> Arrays:
    """Return a world as arrays."""
    points = [np.stack([lane.center, lane.left, lane.right]) for lane in world.lanes]
    following = [np.array(lane.following, dtype=np.int64) for lane in world.lanes]
    return {
        **vars(world.truth),
        "time": world.time,
        "ego": world.ego,
        "visible": world.visible,
        "lane": np.concatenate(points, axis=1),
        "lane_start": starts_of([lane.shape[1] for lane in points]),
        "following": np.concatenate(following),
        "following_start": starts_of([len(numbers) for numbers in following]),
    }


def unpack(arrays: Arrays) -> World:
    """Return the world of packed arrays.

    Raises KeyError for a missing array.
    """
    points = np.split(arrays["lane"], arrays["lane_start"][1:-1], axis=1)
    following = np.split(arrays["following"], arrays["following_start"][1:-1])
    lanes = tuple(
        Lane(line[0], line[1], line[2], tuple(numbers.tolist()))
        for line, numbers in zip(points, following, strict=True)
    )
    truth = Truth(**{column.name: arrays[column.name] for column in fields(Truth)})
    return World(arrays["time"], arrays["ego"], truth, lanes, arrays["visible"])


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

    def __init__(self, card: Card) -> None:
        """Raise CardError for an impossible rate or class."""
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

    ``rate``: steps of the simulation per second. Raises CardError, with ``advice``,
    unless the result is a whole number.
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
    in_view = np.empty(len(order), dtype=bool)
    in_view[order] = views[1:] > views[first]
    return in_view
