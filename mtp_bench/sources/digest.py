"""Digest of a scene, by which a result is compared with the data that is there now."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from ..types import Detections, Scene, Truth

DECIMALS = 6  # of what is hashed: machines differ in the last bits of simulated scenes


def scene_digest(scene: Scene) -> str:
    """Hex sha256 over name, times, ego poses, truth and detections of a scene; lengths to DECIMALS decimals."""
    sha = hashlib.sha256(f"{scene.name}|{scene.frames}|{scene.truth_complete}|{scene.listed_targets}".encode())
    for name, array in {
        "time": scene.time,
        "ego": scene.ego,
        **_arrays(scene.truth),
        **_arrays(scene.detections),
    }.items():
        sha.update(f"|{name}{list(array.shape)}".encode())
        sha.update(_bytes(array))
    return sha.hexdigest()


def _arrays(part: Truth | Detections) -> dict[str, NDArray[np.generic]]:
    return {f"{type(part).__name__}.{name}": value for name, value in vars(part).items()}


def _bytes(array: NDArray[np.generic]) -> bytes:
    if array.dtype.kind != "f":
        return np.ascontiguousarray(array, dtype="<i8").tobytes()
    rounded = np.round(array.astype("<f8"), DECIMALS) + 0.0  # -0.0 becomes 0.0
    rounded[np.isnan(rounded)] = np.nan  # one kind of NaN
    return np.ascontiguousarray(rounded).tobytes()
