"""Rows of any file of tracks as `StoredTracks`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...types import Floats, Ints, StoredTracks, starts_of_sorted

FEWER = "--scenes N (scenes= in Python) takes the first N alone"  # what to do where only some scenes have tracks


def stored_tracks(
    frames: int,
    frame: Ints,
    identity: NDArray[Any],
    class_id: Ints,
    box: Floats,
    score: Floats,
    velocity: Floats | None = None,
) -> StoredTracks:
    """Tracks of a scene of ``frames`` frames, from R rows in any order.

    ``frame`` [R], ``identity`` [R] as in the file, ``class_id`` [R] of the task, ``box`` [R, 7] in the scene's frame of
    reference, ``score`` [R], ``velocity`` [R, 2] m/s if known. An identity in two classes is two identities: some
    programs count per class.
    """
    order = np.argsort(frame, kind="stable")
    _, name = np.unique(identity, return_inverse=True)
    _, number = np.unique(np.stack([name.reshape(-1), class_id]), axis=1, return_inverse=True)
    return StoredTracks(
        start=starts_of_sorted(frame[order], frames),
        box=box[order],
        velocity=np.full((len(box), 2), np.nan) if velocity is None else velocity[order],
        class_id=class_id[order],
        score=score[order],
        object_id=number.reshape(-1)[order],
    )
