"""Modes along lanes: as "modes", but most futures are corrections of a motion along lanes that an object may take.

The other futures correct constant velocity, for objects that leave the lanes.
"""

import numpy as np

from ...core import Floats, Ints
from ..kalman import rotation
from ..lane_paths import STEP, lane_paths
from ..windows import Surroundings, TrackWindows
from .layers import Array, Weights, namespace, relu
from .local import Arrays, mean_velocity
from .modes import Modes
from .network import Recipe, Sizes

METRES = 60.0  # of a path; straight on behind it
POINTS = int(METRES / STEP) + 1  # S
SHOWN = 3  # every so many points of a path are features
FREE = 0.4  # share of the modes that correct constant velocity
BACKWARD = (
    -1.0
)  # m/s along the heading; if less, the detector has taken the rear for the front


class ModesLanes(Modes):
    """Network "modes_lanes"."""

    name = "modes_lanes"
    recipe = Recipe(lanes=True)

    def inputs(
        self, windows: TrackWindows, moment: Ints, seen: Surroundings, sizes: Sizes
    ) -> Arrays:
        """As of "modes", boxes that move backward turned round, and a path for each of the J modes along lanes.

        path [n, J, S, 2] m: an object with fewer paths has them several times, for several speeds; one without any has
        straight lines. chance [n, J]: of the path, 0 if it is there before. side [n, 1]: -1 for boxes turned round.
        """
        local = super().inputs(windows, moment, seen, sizes)
        side = np.where(mean_velocity(local, sizes.dt)[:, :1] < BACKWARD, -1, 1).astype(
            np.float32
        )
        path, chance = _local_paths(
            windows, side[:, 0], moment, seen, sizes.modes - _free(sizes)
        )
        local |= {
            name: local[name] * side[:, None] for name in ("position", "velocity")
        }
        local["yaw"] = np.remainder(local["yaw"] + np.pi / 2, np.pi) - np.float32(
            np.pi / 2
        )
        return {**local, "path": path, "chance": chance, "side": side}

    def features(self, sizes: Sizes) -> int:
        """Number of features of `encoded`."""
        return super().features(sizes) + (sizes.modes - _free(sizes)) * (
            2 * len(range(0, POINTS, SHOWN)) + 1
        )

    def encoded(self, inputs: dict[str, Array], sizes: Sizes) -> Array:
        """Features of the past, then of the paths."""
        path = inputs["path"][:, :, ::SHOWN].reshape(len(inputs["path"]), -1)
        return namespace(path).concatenate(
            [super().encoded(inputs, sizes), path, inputs["chance"]], 1
        )

    def moved(self, inputs: dict[str, Array], residual: Array, sizes: Sizes) -> Array:
        """Futures of corrections along and across the paths; the last ones of corrections of constant velocity."""
        along, free = residual[:, : -_free(sizes)], residual[:, -_free(sizes) :]
        futures = [
            _along_paths(inputs, along, sizes),
            super().moved(inputs, free, sizes),
        ]
        return namespace(residual).concatenate(futures, 1)

    def forward(
        self, weights: Weights, inputs: dict[str, Array], sizes: Sizes
    ) -> dict[str, Array]:
        """As of "modes"; what was turned round is turned back."""
        output, side = super().forward(weights, inputs, sizes), inputs["side"]
        return {
            **output,
            "modes": output["modes"] * side[:, :, None, None],
            "present": output["present"] * side,
        }


NETWORK = ModesLanes()


def _free(sizes: Sizes) -> int:
    """Number of modes that do not follow lanes."""
    return max(1, round(FREE * sizes.modes))


def _local_paths(
    windows: TrackWindows, side: Floats, moment: Ints, seen: Surroundings, most: int
) -> tuple[Floats, Floats]:
    """Inputs ``path`` and ``chance`` of windows, ``most`` of each; ``side`` [n]: -1 for boxes turned round."""
    path, chance = (
        np.zeros((len(windows), most, POINTS, 2)),
        np.zeros((len(windows), most)),
    )
    now = windows.box[:, -1].astype(np.float64)
    now[:, 3] += np.where(side < 0, np.pi, 0)
    for t in np.unique(moment) if seen.lanes else ():
        rows = np.flatnonzero(moment == t)
        paths = lane_paths(seen.lanes_at(t), now[rows, :2], now[rows, 3], most, METRES)
        path[rows], chance[rows] = paths.points, paths.chance
    count = (chance > 0).sum(axis=1)
    again = np.arange(most) % np.maximum(count, 1)[:, None]
    path = (
        np.take_along_axis(path, again[:, :, None, None], axis=1)
        - now[:, None, None, :2]
    )
    path = np.einsum("nmsi,nij->nmsj", path, rotation(now[:, 3]))
    path[count == 0] = np.arange(POINTS)[:, None] * np.array([STEP, 0.0])
    return path.astype(np.float32), chance.astype(np.float32)


def _along_paths(inputs: dict[str, Array], residual: Array, sizes: Sizes) -> Array:
    """Places [n, J, T, 2] m on the paths at constant speed, corrected by ``residual`` m along them and to the left."""
    path, xp = inputs["path"], namespace(residual)
    ahead = path[:, :, 1:] - path[:, :, :-1]
    ahead = xp.concatenate([ahead, ahead[:, :, -1:]], 2) / STEP  # directions
    first, begin = ahead[:, :, 0], path[:, :, 0]
    speed = (mean_velocity(inputs, sizes.dt)[:, None] * first).sum(-1)
    left = (
        first[..., 1] * begin[..., 0] - first[..., 0] * begin[..., 1]
    )  # of the path is the object
    time = xp.cumsum(xp.ones_like(residual[..., 0]), 2) * sizes.dt
    along = ((speed[..., None] * time + residual[..., 0]) / STEP)[..., None]
    inside = xp.clip(along, 0, POINTS - 1)
    number = xp.cumsum(xp.ones_like(path[..., 0]), 2) - 1
    share = relu(
        1 - abs(inside - number[:, :, None])
    )  # of each point: linear between two
    place = share @ xp.concatenate([path, ahead], 3)
    ahead = place[..., 2:]
    across = (
        xp.stack([-ahead[..., 1], ahead[..., 0]], -1)
        * (left[..., None] + residual[..., 1])[..., None]
    )
    return place[..., :2] + (along - inside) * STEP * ahead + across
