"""Units of uncertainty: recordings cut into blocks of at most 20 s (protocol, "Uncertainty")."""

from __future__ import annotations

import numpy as np

from ..types import Ints, Scene
from .definitions import BLOCK_SECONDS

_EXCESS = 0.05  # of BLOCK_SECONDS: by so much all blocks of a scene may be longer together, for 41 frames at 2 Hz


def units(scene: Scene) -> Ints:
    """Number of the block [F] in which each frame of ``scene`` lies, from 0 on.

    The blocks have equal numbers of frames, up to one, and are as few as possible. Frames have to be about as far apart
    as each other: over a long gap blocks of frames are no blocks of time.
    """
    if scene.frames < 2:
        return np.zeros(scene.frames, dtype=np.int64)
    seconds = float(scene.time[-1] - scene.time[0]) * scene.frames / (scene.frames - 1)
    count = max(1, int(np.ceil(round(seconds / BLOCK_SECONDS - _EXCESS, 9))))  # times are sums of rounded periods
    return np.arange(scene.frames) * count // scene.frames


def recording_of(scene: Scene) -> str:
    """Name of the recording, within which objects keep their ids: of the scene itself where it is not cut from one."""
    return scene.recording or scene.name
