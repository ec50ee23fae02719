"""Files of arrays in the cache, with a hash of their content, and scene digests."""

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Scene, open_regular, whole_file

Arrays = dict[str, NDArray[Any]]

# numbers are hashed with so many: machines differ in the last bits of simulated scenes
DECIMALS = 6


def content_hash(arrays: Arrays) -> str:
    """Return the sha256 of names, types, shapes and values of arrays, in any order."""
    sha256 = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        sha256.update(f"{name} {array.dtype.str} {array.shape};".encode())
        sha256.update(array.tobytes())
    return sha256.hexdigest()


def read_arrays(path: Path) -> Arrays | None:
    """Read stored arrays.

    None if the file is missing or not as it was written.
    """
    try:
        with open_regular(path) as stream, np.load(stream, allow_pickle=False) as file:
            arrays: Arrays = {name: file[name] for name in file.files}
        digest = str(arrays.pop("digest"))
    except Exception:  # NumPy raises many kinds for changed bytes
        return None
    return arrays if content_hash(arrays) == digest else None


def write_arrays(path: Path, arrays: Arrays, level: int = 1) -> None:
    """Write arrays with a hash of their content, atomically.

    ``level`` of compression, 0 to 9. Raises OSError.
    """
    digest = np.array(content_hash(arrays))
    with whole_file(path) as part_path:
        write_npz(part_path, {"digest": digest, **arrays}, level)


def write_npz(path: Path, arrays: Arrays, level: int) -> None:
    """Write arrays for `numpy.load`.

    ``level`` of compression, 0 to 9; `numpy.savez_compressed` knows only 6.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as file:
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)


def scene_digest(scene: Scene) -> str:
    """Return the hex sha256 of a scene.

    A stored result has it, so that it is scored only with the same scene. It covers
    name, times, ego poses, truth, what of it is annotated, and detections, with numbers
    rounded to DECIMALS decimals.
    """
    fields = (scene.name, scene.frames, scene.truth_complete, scene.listed_targets)
    sha256 = hashlib.sha256("|".join(map(str, fields)).encode())
    arrays = {"time": scene.time, "ego": scene.ego}
    for rows in (scene.truth, scene.detections):
        for name, column in vars(rows).items():
            arrays[f"{type(rows).__name__}.{name}"] = column
    for name in ("annotated", "neutral_areas"):
        array = getattr(scene, name)
        if array is not None:
            arrays[name] = array
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            values = np.round(array.astype("<f8"), DECIMALS) + 0.0  # -0.0 becomes 0.0
            values[np.isnan(values)] = np.nan  # one kind of NaN
        else:
            values = array.astype("<i8")
        sha256.update(f"|{name}{list(array.shape)}".encode())
        sha256.update(np.ascontiguousarray(values).tobytes())
    return sha256.hexdigest()
