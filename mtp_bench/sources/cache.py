"""Files of arrays in the cache with a hash that shows when they are broken, and the digest of a scene."""

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core import Scene, open_regular, whole_file

Arrays = dict[str, NDArray[Any]]

DECIMALS = 6  # of what is hashed: machines differ in the last bits of simulated scenes


def content_hash(arrays: Arrays) -> str:
    """sha256 of the arrays' names, types, shapes and values, in any order of the arrays."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def read_arrays(path: Path) -> Arrays | None:
    """Stored arrays; None if the file is missing or not as it was written."""
    try:
        with open_regular(path) as stream, np.load(stream, allow_pickle=False) as file:
            arrays: Arrays = {name: file[name] for name in file.files}
        digest = str(arrays.pop("digest"))
        return arrays if content_hash(arrays) == digest else None
    except Exception:  # NumPy raises many kinds for changed bytes
        return None


def write_arrays(path: Path, arrays: Arrays, level: int = 1) -> None:
    """Store arrays with a hash of their content, atomically; ``level`` of compression. Raises OSError."""
    with whole_file(path) as part:
        write_npz(part, {"digest": np.array(content_hash(arrays)), **arrays}, level)


def write_npz(path: Path, arrays: Arrays, level: int) -> None:
    """Write arrays for `numpy.load`; ``level`` of compression, 0 to 9: `numpy.savez_compressed` has 6 alone."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as file:
        for name, array in arrays.items():
            with file.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)


def scene_digest(scene: Scene) -> str:
    """Hex sha256 over name, times, ego poses, truth and detections of a scene, by which a result is compared with them.

    Lengths count to DECIMALS decimals.
    """
    sha = hashlib.sha256(
        f"{scene.name}|{scene.frames}|{scene.truth_complete}|{scene.listed_targets}".encode()
    )
    arrays = {"time": scene.time, "ego": scene.ego}
    for part in (scene.truth, scene.detections):
        arrays |= {
            f"{type(part).__name__}.{name}": value for name, value in vars(part).items()
        }
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            values = np.round(array.astype("<f8"), DECIMALS) + 0.0  # -0.0 becomes 0.0
            values[np.isnan(values)] = np.nan  # one kind of NaN
        else:
            values = array.astype("<i8")
        sha.update(f"|{name}{list(array.shape)}".encode())
        sha.update(np.ascontiguousarray(values).tobytes())
    return sha.hexdigest()
