"""Worlds on disk: stored with a hash of their content, and simulated again if a file is broken."""

import hashlib
import json
from collections.abc import Iterator, Sequence
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

_TRUTH = tuple(field.name for field in fields(Truth))


@dataclass(frozen=True)
class WorldStore:
    """Worlds of one kind of traffic, by seed, in the cache folder."""

    traffic: Any  # a dataclass of all that their content depends on, with ``scenario`` and ``simulate(seed)``

    @cached_property
    def folder(self) -> Path:
        """Folder of the worlds of this traffic; its name has a digest of everything that their content depends on."""
        from importlib.metadata import version

        described = {
            **asdict(self.traffic),
            "generator": GENERATOR,
            "highway-env": version("highway-env"),
        }
        digest = hashlib.sha256(
            json.dumps(described, sort_keys=True).encode()
        ).hexdigest()[:16]
        return cache_root() / "worlds" / f"{self.traffic.scenario}-{digest}"

    @property
    def secret_folder(self) -> Path:
        """Folder of the worlds of secret seeds."""
        return self.folder.with_name(f"{self.folder.name}-secret")

    def path(self, seed: int) -> Path:
        """File of one world; those of secret seeds have a separate folder."""
        return (
            self.folder if seed < SECRET_SEEDS else self.secret_folder
        ) / f"{seed:06d}.npz"

    def read(self, seed: int) -> World | None:
        """The stored world; None if it is missing or its content was changed."""
        arrays = read_arrays(self.path(seed))
        try:
            return None if arrays is None else unpack(arrays)
        except KeyError:
            return None

    def get(self, seed: int) -> World:
        """The stored world, or a new one, which is then stored. Raises DataError if that is impossible."""
        from ...detector import visible_fractions

        if (stored := self.read(seed)) is not None:
            return stored
        path = self.path(seed)
        with _stored_in(path.parent):
            remove_damaged(path)
            world: World = self.traffic.simulate(seed)
            world = replace(world, visible=visible_fractions(world.truth, world.ego))
            write_arrays(path, pack(world))
        return world

    def make(self, seeds: Sequence[int], workers: int = 1) -> Iterator[int]:
        """Simulate and store worlds over ``workers`` processes; yields each seed when it is done."""
        for place, _ in unordered_map(
            _make_one, [(self, seed) for seed in seeds], Workers(max(1, workers))
        ):
            yield seeds[place]

    def keep_private(self) -> None:
        """Close the folder of secret worlds to other users. Raises DataError if they cannot be stored."""
        with _stored_in(self.secret_folder):
            self.secret_folder.chmod(0o700)


def _make_one(store: WorldStore, seed: int) -> None:
    store.get(seed)


@contextmanager
def _stored_in(folder: Path) -> Iterator[None]:
    """Make a folder for worlds; an OSError in the block becomes a DataError that names it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        problem = f"generated scenes cannot be stored in {folder}: {error.strerror}"
        raise DataError(f"{problem}; set {CACHE} to another folder") from None


def pack(world: World) -> Arrays:
    """A world as arrays."""
    points = [np.stack([lane.center, lane.left, lane.right]) for lane in world.lanes]
    following = [np.array(lane.following, dtype=np.int64) for lane in world.lanes]
    return {
        **{name: getattr(world.truth, name) for name in _TRUTH},
        "time": world.time,
        "ego": world.ego,
        "visible": world.visible,
        "lane": np.concatenate(points, axis=1),
        "lane_start": starts_of([part.shape[1] for part in points]),
        "following": np.concatenate(following),
        "following_start": starts_of([len(part) for part in following]),
    }


def unpack(arrays: Arrays) -> World:
    """The world of packed arrays; raises KeyError for a missing array."""
    lanes = np.split(arrays["lane"], arrays["lane_start"][1:-1], axis=1)
    following = np.split(arrays["following"], arrays["following_start"][1:-1])
    parts = zip(lanes, following, strict=True)
    road = tuple(
        Lane(line[0], line[1], line[2], tuple(after.tolist())) for line, after in parts
    )
    truth = Truth(**{name: arrays[name] for name in _TRUTH})
    return World(arrays["time"], arrays["ego"], truth, road, arrays["visible"])
