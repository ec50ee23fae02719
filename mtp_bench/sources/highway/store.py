"""Worlds on disk: stored with a hash of their content, and simulated again if a file is broken."""

from __future__ import annotations

import hashlib
import itertools
import json
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import DataError
from ...parallel import Workers, unordered_map
from ...types import Floats, Ints, Lane, Truth
from ..cache import VARIABLE, Arrays, cache_root, read_arrays, write_arrays
from .section import GENERATOR, SECRET_SEEDS
from .world import Traffic, World

_TRUTH = tuple(field.name for field in fields(Truth))
_BORDERS = ("center", "left", "right")


@dataclass(frozen=True)
class WorldStore:
    """Worlds of one kind of traffic, by seed.

    They are in the folder of the environment variable MTP_BENCH_CACHE, or in the user cache folder.
    """

    traffic: Traffic

    @cached_property
    def folder(self) -> Path:
        """Folder of the worlds of this traffic; its name has a digest of everything that their content depends on."""
        from importlib.metadata import version

        described = {**asdict(self.traffic), "generator": GENERATOR, "highway-env": version("highway-env")}
        digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()[:16]
        return cache_root() / "worlds" / f"{self.traffic.scenario}-{digest}"

    def path(self, seed: int) -> Path:
        """File of one world; those of secret seeds have a separate folder."""
        return (self.folder if seed < SECRET_SEEDS else self.secret_folder) / f"{seed:06d}.npz"

    @property
    def secret_folder(self) -> Path:
        """Folder of the worlds of secret seeds."""
        return self.folder.with_name(f"{self.folder.name}-secret")

    def has(self, seed: int) -> bool:
        """True if the world is stored and complete."""
        return self.read(seed) is not None

    def read(self, seed: int) -> World | None:
        """The stored world; None if it is missing or its content was changed."""
        arrays = read_arrays(self.path(seed))
        if arrays is None:
            return None
        try:
            return unpack(arrays)
        except KeyError:
            return None

    def get(self, seed: int) -> World:
        """The stored world, or a new one, which is then stored."""
        world = self.read(seed)
        return self._make(seed) if world is None else world

    def require_writable(self) -> None:
        """Raise DataError if worlds cannot be stored."""
        _require_writable(self.folder)

    def keep_private(self) -> None:
        """Close the folder of secret worlds to other users. Raises DataError if they cannot be stored."""
        _require_writable(self.secret_folder)
        self.secret_folder.chmod(0o700)

    def make(self, seeds: Sequence[int], workers: int = 1) -> Iterator[int]:
        """Simulate and store worlds over ``workers`` processes; yields each seed when it is done."""
        for place, _ in unordered_map(_make_one, [(self, seed) for seed in seeds], Workers(max(1, workers))):
            yield seeds[place]

    def _make(self, seed: int) -> World:
        from ...detector.visibility import visible_fractions
        from .simulate import simulate_world

        world = simulate_world(self.traffic, seed)
        world = replace(world, visible=visible_fractions(world.truth, world.ego))
        self._write(seed, world)
        return world

    def _write(self, seed: int, world: World) -> None:
        """Store a world; warns if the cache cannot be written."""
        path = self.path(seed)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_arrays(path, pack(world))
        except OSError as error:
            warnings.warn(
                f"a generated scene cannot be stored in {path.parent} ({error.strerror}) and will be simulated again; "
                f"set {VARIABLE} to another folder",
                RuntimeWarning,
                stacklevel=2,
            )


def _require_writable(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise DataError(
            f"generated scenes cannot be stored in {folder}: {error.strerror}; set {VARIABLE} to another folder"
        ) from None


def _make_one(store: WorldStore, seed: int) -> None:
    store._make(seed)


def pack(world: World) -> Arrays:
    """A world as arrays."""
    arrays: Arrays = {name: getattr(world.truth, name) for name in _TRUTH}
    arrays |= {"time": world.time, "ego": world.ego, "visible": world.visible}
    arrays["rejected"] = np.array(world.rejected, dtype=np.str_)
    for name in _BORDERS:
        arrays[f"lane_{name}"], arrays[f"lane_{name}_start"] = _joined([getattr(lane, name) for lane in world.lanes])
    following = [np.array(lane.following, dtype=np.int64) for lane in world.lanes]
    arrays["lane_following"], arrays["lane_following_start"] = _joined(following)
    return arrays


def unpack(arrays: Arrays) -> World:
    """The world of packed arrays; raises KeyError or ValueError for a missing or wrong array."""
    borders = [_parts(arrays[f"lane_{name}"], arrays[f"lane_{name}_start"]) for name in _BORDERS]
    following = _parts(arrays["lane_following"], arrays["lane_following_start"])
    return World(
        time=arrays["time"],
        ego=arrays["ego"],
        truth=Truth(**{name: arrays[name] for name in _TRUTH}),
        lanes=tuple(
            Lane(center, left, right, tuple(int(i) for i in after))
            for center, left, right, after in zip(*borders, following, strict=True)
        ),
        rejected=tuple(str(reason) for reason in arrays["rejected"]),
        visible=arrays["visible"],
    )


def _joined(parts: list[Any]) -> tuple[NDArray[Any], Ints]:
    """All parts in one array, and the start of each."""
    return np.concatenate(parts), np.cumsum([0, *(len(part) for part in parts)])


def _parts(joined: NDArray[Any], start: Ints) -> list[Floats]:
    return [joined[a:b] for a, b in itertools.pairwise(start)]
