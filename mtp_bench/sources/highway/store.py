"""Worlds on disk: made once, kept with a hash of their content, made again where a file is broken."""

from __future__ import annotations

import hashlib
import json
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from ...cards.sections import GENERATOR
from ...errors import DataError
from ...parallel import Workers, unordered_map
from ..cache import VARIABLE, cache_root, read_arrays, write_arrays
from .packing import pack, unpack
from .world import Traffic, World


@dataclass(frozen=True)
class WorldStore:
    """The worlds of one kind of traffic, by seed.

    They lie in the folder that the environment variable MTP_BENCH_CACHE names, else in the user cache folder.
    """

    traffic: Traffic

    @cached_property
    def folder(self) -> Path:
        """Where the worlds of this traffic are; its name is a digest of all that their content depends on."""
        from importlib.metadata import version

        described = {
            **asdict(self.traffic),
            "drivers": "cooperative",  # the only kind; it stays in the name, so that worlds made earlier are found
            "generator": GENERATOR,
            "highway-env": version("highway-env"),
        }
        digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()[:16]
        return cache_root() / "worlds" / f"{self.traffic.scenario}-{digest}"

    def path(self, seed: int) -> Path:
        """File of one world."""
        return self.folder / f"{seed:06d}.npz"

    def has(self, seed: int) -> bool:
        """Whether the world is there and whole."""
        return self.read(seed) is not None

    def read(self, seed: int) -> World | None:
        """The stored world; None where there is none or its content is not what was written."""
        arrays = read_arrays(self.path(seed))
        if arrays is None:
            return None
        try:
            return unpack(arrays)
        except KeyError:  # arrays of another format
            return None

    def get(self, seed: int) -> World:
        """The stored world, else a new one, which is stored."""
        world = self.read(seed)
        return self._make(seed) if world is None else world

    def require_writable(self) -> None:
        """Raise DataError where worlds cannot be stored."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=self.folder).close()
        except OSError as error:
            raise DataError(
                f"generated scenes cannot be kept in {self.folder}: {error.strerror}; {VARIABLE} names another folder"
            ) from None

    def make(self, seeds: Sequence[int], workers: int = 1) -> Iterator[int]:
        """Make and store worlds over ``workers`` processes; gives each seed when it is done."""
        for place, _ in unordered_map(_make_one, [(self, seed) for seed in seeds], Workers(max(1, workers))):
            yield seeds[place]

    def _make(self, seed: int) -> World:
        from ...detector.sight import visible_fractions
        from .simulate import simulate_world

        world = simulate_world(self.traffic, seed)
        world = replace(world, visible=visible_fractions(world.truth, world.ego))
        self._write(seed, world)
        return world

    def _write(self, seed: int, world: World) -> None:
        """Store a world as a whole or not at all; a cache that cannot be written is no reason to stop."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_arrays(self.path(seed), pack(world))
        except OSError as error:
            warnings.warn(
                f"a generated scene cannot be kept in {self.folder} ({error.strerror}) and is made anew each time; "
                f"{VARIABLE} names another folder",
                RuntimeWarning,
                stacklevel=2,
            )


def _make_one(store: WorldStore, seed: int) -> None:
    store._make(seed)
