"""Windows that were made once: kept by the content of the scene, what was asked for, and the code that makes them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..files import file_digest
from ..sources.cache import Arrays, cache_root, content_hash, read_arrays, write_arrays
from ..types import Scene

_LIBRARY = Path(__file__).parents[1]
_MAKERS = (
    *("geometry.py", "similar.py", "tracks.py", "types.py", "prediction/windows.py", "training"),
    *("env/action.py", "env/observation.py", "env/spaces.py"),
    *("scoring/definitions.py", "scoring/events.py", "scoring/neutral.py", "scoring/targets.py", "tracking"),
)


def kept(scene: Scene, asked: tuple[Any, ...], make: Callable[[], Arrays]) -> Arrays:
    """What ``make`` makes of a scene, from the cache where it is there; ``asked``: what it depends on beside it."""
    parts = [content_hash(_arrays_of(scene)), *map(repr, asked), code_digest(_MAKERS)]
    path = cache_root() / "windows" / f"{hashlib.sha256('|'.join(parts).encode()).hexdigest()[:32]}.npz"
    found = read_arrays(path)
    if found is None:
        found = make()
        with suppress(OSError):  # without a cache they are made again next time
            path.parent.mkdir(parents=True, exist_ok=True)
            write_arrays(path, found)
    return found


def _arrays_of(scene: Scene) -> Arrays:
    """Everything of a scene that windows can depend on."""
    arrays: Arrays = {"time": scene.time, "ego": scene.ego, "name": np.array(scene.name)}
    arrays |= {name: np.array(getattr(scene, name)) for name in ("truth_complete", "listed_targets")}
    for part in ("truth", "detections", "image"):
        table = getattr(scene, part)
        if table is not None:
            arrays |= {f"{part}.{f.name}": np.asarray(getattr(table, f.name)) for f in fields(table)}
    return arrays


@cache
def code_digest(parts: tuple[str, ...]) -> str:
    """Digest of modules and packages of the library."""
    places = [_LIBRARY / part for part in parts]
    code = [path for place in places for path in (place.rglob("*.py") if place.is_dir() else [place])]
    digests = sorted(f"{path.relative_to(_LIBRARY).as_posix()} {file_digest(path)}" for path in code)
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()
