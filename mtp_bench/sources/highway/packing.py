"""Worlds as named arrays, for files and hashes."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...types import Floats, Ints, Lane, Truth
from ..cache import Arrays
from .world import World

_TRUTH = ("start", "box", "velocity", "class_id", "object_id", "eligible", "neutral")
_BORDERS = ("center", "left", "right")


def pack(world: World) -> Arrays:
    """A world as arrays."""
    arrays: Arrays = {name: getattr(world.truth, name) for name in _TRUTH}
    arrays |= {"time": world.time, "ego": world.ego, "visible": world.visible}
    arrays["rejected"] = np.array(world.rejected, dtype=np.str_)
    for name in _BORDERS:
        parts = [getattr(lane, name) for lane in world.lanes]
        arrays[f"lane_{name}"], arrays[f"lane_{name}_start"] = _joined(parts, (0, 2))
    following = [np.array(lane.following, dtype=np.int64) for lane in world.lanes]
    arrays["lane_following"], arrays["lane_following_start"] = _joined(following, (0,))
    return arrays


def unpack(arrays: Arrays) -> World:
    """The world of `pack`; raises KeyError or ValueError where an array is missing or does not fit."""
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


def _joined(parts: list[Any], empty: tuple[int, ...]) -> tuple[NDArray[Any], Ints]:
    """All parts in one array, and where each begins."""
    start = np.cumsum([0, *(len(part) for part in parts)])
    return np.concatenate(parts) if parts else np.zeros(empty), start


def _parts(joined: NDArray[Any], start: Ints) -> list[Floats]:
    return [joined[a:b] for a, b in itertools.pairwise(start)]
