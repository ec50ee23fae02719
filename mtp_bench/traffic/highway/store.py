"""Worlds on disk, with a hash of their content; broken files are simulated again."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ...core import (
    CACHE,
    DataError,
    Lane,
    Truth,
    Workers,
    cache_root,
    remove_damaged,
    starts_of,
    unordered_map,
)
from ...sources import Arrays, read_arrays, write_arrays
from .world import GENERATOR, SECRET_SEEDS, World

_TRUTH = tuple(column.name for column in fields(Truth))


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

        Worlds of secret seeds are in a folder of their own.
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
        raise DataError(f"{problem}; set {CACHE} to another folder") from None


def pack(world: World) -> Arrays:
    """Return a world as arrays."""
    points = [np.stack([lane.center, lane.left, lane.right]) for lane in world.lanes]
    following = [np.array(lane.following, dtype=np.int64) for lane in world.lanes]
    return {
        **{name: getattr(world.truth, name) for name in _TRUTH},
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
    truth = Truth(**{name: arrays[name] for name in _TRUTH})
    return World(arrays["time"], arrays["ego"], truth, lanes, arrays["visible"])
