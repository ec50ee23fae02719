"""Rollouts as records: their arrays, how answers become one, and the digest that names what was said."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..types import Ints, Rollout, starts_of
from .decoding import Answer

# of every array of a Rollout, in the order of the digest: dtype, and shape in the letters of types.py;
# R rows of tracks, S rows of forecast objects, F1 is F + 1, C1 is C + 1
ARRAYS: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "track_start": ("<i8", ("F1",)),
    "track_id": ("<i8", ("R",)),
    "track_box": ("<f4", ("R", 7)),
    "track_class": ("<i8", ("R",)),
    "member": ("|b1", ("R", "H")),
    "hypothesis_log_weight": ("<f4", ("F", "H")),
    "hypothesis_parent": ("<i8", ("F", "H")),
    "object_start": ("<i8", ("F1",)),
    "object_box": ("<f4", ("S", 7)),
    "object_class": ("<i8", ("S",)),
    "object_confidence": ("<f4", ("S",)),
    "forecast": ("<i2", ("S", "K", "T", 2)),
    "forecast_log_weight": ("<f4", ("S", "K")),
    "invalid": ("<i8", ("F", 3)),
    "malformed": ("<i8", ("F", "C1")),
    "dropped": ("<i8", ("F",)),
    "seconds": ("<f8", ("F",)),
}


def assemble(scene: str, answers: Sequence[Answer], dropped: Ints) -> Rollout:
    """Rollout of the recorded answers [F] of a scene; ``dropped`` [F] detections did not fit. Times are still zero."""
    arrays: dict[str, NDArray[Any]] = {
        "track_start": starts_of([len(answer.track_id) for answer in answers]),
        "object_start": starts_of([len(answer.object_class) for answer in answers]),
        "dropped": np.asarray(dropped),
        "seconds": np.zeros(len(answers)),
    }
    for name, (_, shape) in ARRAYS.items():
        if name not in arrays:
            join = np.stack if shape[0] == "F" else np.concatenate
            arrays[name] = join([getattr(answer, name) for answer in answers])
    return Rollout(scene, **{name: array.astype(ARRAYS[name][0], copy=False) for name, array in arrays.items()})


def digest(rollout: Rollout) -> str:
    """Hex sha256 over the scene's name and all arrays but ``seconds``: equal answers, equal digest."""
    sha = hashlib.sha256(rollout.scene.encode())
    for name, (dtype, _) in ARRAYS.items():
        if name != "seconds":
            array = np.ascontiguousarray(getattr(rollout, name), dtype=dtype)
            if array.dtype.kind == "f":
                array = array + np.zeros((), dtype)  # -0.0 becomes 0.0
            sha.update(f"|{name}{list(array.shape)}".encode())
            sha.update(array.tobytes())
    return sha.hexdigest()
