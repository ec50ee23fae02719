"""Windows of made-up tracks, several frames of them, and a lesson of such windows."""

from collections.abc import Sequence

import numpy as np

from mtp_bench.core import Ints
from mtp_bench.prediction.learned.network import Network, Sizes
from mtp_bench.prediction.windows import Surroundings, TrackWindows, local_future
from mtp_bench.training.fitting import TrainingSet

SIZES = Sizes(("car", "pedestrian"), past=4, future=3, modes=5, dt=0.5)
NOTHING_SEEN = Surroundings(
    np.zeros(1, dtype=np.int64), np.zeros((0, 7)), np.zeros((0, 2)), np.zeros(0, dtype=np.int64), np.zeros(0),
    np.zeros(0, dtype=np.int64),
)  # fmt: skip


def random_windows(counts: Sequence[int] = (3, 1, 6), seed: int = 0) -> tuple[TrackWindows, Ints]:
    """Windows of frames with so many tracks, close to each other in bends, and the frame [n] of each."""
    rng, past, n = np.random.default_rng(seed), SIZES.past, sum(counts)
    alive = np.arange(past) >= rng.integers(0, past, n)[:, None]
    time = (np.arange(past) - past + 1)[None] * SIZES.dt
    yaw = rng.uniform(-np.pi, np.pi, n)[:, None] + rng.normal(0, 0.3, n)[:, None] * time
    moved = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1) * (rng.uniform(0, 4, n)[:, None] * time)[:, :, None]
    box = np.zeros((n, past, 7))
    box[:, :, :2] = rng.uniform(-6, 6, (n, 1, 2)) + moved
    box[:, :, 3], box[:, :, 4:] = yaw, rng.uniform(1, 4, (n, 1, 3))
    windows = TrackWindows(
        box=box * alive[:, :, None], taken=alive, alive=alive, detection=np.where(alive, 0, -1),
        score=rng.uniform(0, 1, (n, past)) * alive, velocity=rng.normal(size=(n, past, 2)) * alive[:, :, None],
        class_id=rng.integers(0, 2, n), hits=alive.sum(axis=1), age=alive.sum(axis=1), mass=np.ones(n),
        best=np.ones(n, dtype=bool), ego=np.zeros((n, past, 4)),
    )  # fmt: skip
    return windows, np.repeat(np.arange(len(counts)), counts)


def random_training_set(network: Network, frames: int = 12, seed: int = 0) -> TrainingSet:
    """Frames of three tracks that go on in their bends; of the last frames a quarter is for validation."""
    windows, moment = random_windows([3] * frames, seed)
    yaw = windows.box[:, -1, 3][:, None] + 0.2 * (np.arange(1, SIZES.future + 1) * SIZES.dt)
    step = 2 * SIZES.dt * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)  # at 2 m/s
    future = np.asarray(windows.box[:, -1:, :2] + step.cumsum(axis=1))
    known = np.ones(future.shape[:2], dtype=bool)
    known[::5, -1] = False
    return TrainingSet(
        inputs=network.inputs(windows, moment, NOTHING_SEEN, SIZES),
        future=local_future(windows, future),
        is_known=known,
        present=np.zeros((len(moment), 2), dtype=np.float32),
        weight=np.ones(len(moment), dtype=np.float32),
        validation=moment >= 0.75 * frames,
    )
