"""Cache of training windows, by the content of the scene, the arguments, and the code that makes them."""

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
_CODE = (  # that makes windows
    *("geometry.py", "similar.py", "tracks.py", "types.py", "prediction/windows.py", "training"),
    *("env/action.py", "env/observation.py", "env/spaces.py"),
    *("scoring/definitions.py", "scoring/events.py", "scoring/neutral.py", "scoring/targets.py", "tracking"),
)


def cached_windows(scene: Scene, arguments: tuple[Any, ...], make: Callable[[], Arrays]) -> Arrays:
    """The result of ``make`` for a scene, from the cache if it is there; ``arguments``: all else that it depends on."""
    parts = [content_hash(_arrays_of(scene)), *map(repr, arguments), code_digest(_CODE)]
    path = cache_root() / "windows" / f"{hashlib.sha256('|'.join(parts).encode()).hexdigest()[:32]}.npz"
    arrays = read_arrays(path)
    if arrays is None:
        arrays = make()
        with suppress(OSError):  # without a cache they are made again next time
            path.parent.mkdir(parents=True, exist_ok=True)
            write_arrays(path, arrays)
    return arrays


def _arrays_of(scene: Scene) -> Arrays:
    """All contents of a scene that windows can depend on."""
    arrays: Arrays = {"time": scene.time, "ego": scene.ego, "name": np.array(scene.name)}
    arrays |= {name: np.array(getattr(scene, name)) for name in ("truth_complete", "listed_targets")}
    for part in ("truth", "detections", "image"):
        table = getattr(scene, part)
        if table is not None:
            arrays |= {f"{part}.{f.name}": np.asarray(getattr(table, f.name)) for f in fields(table)}
    return arrays


@cache
def code_digest(parts: tuple[str, ...]) -> str:
    """Digest of modules and packages of the library, with their TOML files."""
    paths = [_LIBRARY / part for part in parts]
    files = [file for path in paths for file in (path.rglob("*") if path.is_dir() else [path])]
    code = [file for file in files if file.suffix in (".py", ".toml")]
    digests = sorted(f"{path.relative_to(_LIBRARY).as_posix()} {file_digest(path)}" for path in code)
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()
