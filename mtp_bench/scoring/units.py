"""Units of uncertainty: recordings cut into blocks of at most 20 s (protocol, "Uncertainty")."""

from __future__ import annotations

import numpy as np

from ..types import Ints, Scene
from .definitions import BLOCK_SECONDS

_EXCESS = 0.05  # share by which a scene of one block may be longer: 41 frames at 2 Hz are 20.5 s


def units(scene: Scene) -> Ints:
    """Number of the block [F] in which each frame of ``scene`` lies, from 0 on.

    The blocks are of equal length, as few as possible.
    """
    if scene.frames < 2:
        return np.zeros(scene.frames, dtype=np.int64)
    seconds = float(scene.time[-1] - scene.time[0]) * scene.frames / (scene.frames - 1)
    count = max(1, int(np.ceil(round(seconds / BLOCK_SECONDS - _EXCESS, 9))))  # times are sums of rounded periods
    return np.arange(scene.frames) * count // scene.frames


def recording_of(scene: Scene) -> str:
    """Name of the recording, within which objects keep their ids: of the scene itself where it is not cut from one."""
    return scene.recording or scene.name
