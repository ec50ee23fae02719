"""Modes along lanes: as "modes", but most futures follow lanes.

They are corrections of a motion along lanes that an object may take. The other futures
correct constant velocity, for objects that leave the lanes.
"""

import numpy as np

from ...core import Floats, Ints, rotation
from ..lane_paths import STEP, lane_paths
from ..windows import Arrays, Surroundings, TrackWindows, mean_velocity
from .layers import Array, Inputs, Weights, namespace, relu
from .modes import Modes
from .network import Recipe, Sizes

METRES = 60.0  # of a path; straight on behind it
POINTS = int(METRES / STEP) + 1  # S
SHOWN = 3  # every so many points of a path are features
FREE = 0.4  # share of the modes that correct constant velocity
# m/s along the heading; if less, the detector has taken the rear for the front
BACKWARD = -1.0


class ModesLanes(Modes):
    """Network "modes_lanes"."""

    name = "modes_lanes"
    recipe = Recipe(lanes=True)

    def inputs(
        self,
        windows: TrackWindows,
        moment: Ints,
        surroundings: Surroundings,
        sizes: Sizes,
    ) -> Arrays:
        """Return the input of "modes", and paths along lanes.

        Each of the J modes along lanes has a path. Boxes that move backward are turned
        round. path [n, J, S, 2] m: an object with fewer paths has them several times,
        for several speeds; one without any has straight lines. chance [n, J]:
        probability of the path, 0 if it repeats an earlier one. side [n, 1]: -1 for
        boxes turned round.
        """
        local = super().inputs(windows, moment, surroundings, sizes)
        velocity = mean_velocity(local, sizes.dt)
        side = np.where(velocity[:, :1] < BACKWARD, -1, 1).astype(np.float32)
        count = sizes.modes - _free_count(sizes)
        path, chance = _local_paths(windows, side[:, 0], moment, surroundings, count)
        # at most a quarter turn: front and rear are alike
        quarter_turn = np.float32(np.pi / 2)
        yaw = np.remainder(local["yaw"] + np.pi / 2, np.pi) - quarter_turn
        return {
            **local,
            "position": local["position"] * side[:, None],
            "velocity": local["velocity"] * side[:, None],
            "yaw": yaw,
            "path": path,
            "chance": chance,
            "side": side,
        }

    def features(self, sizes: Sizes) -> int:
        """Return the number of features of `encoded`."""
        per_path = 2 * len(range(0, POINTS, SHOWN)) + 1
        return super().features(sizes) + (sizes.modes - _free_count(sizes)) * per_path

    def encoded(self, inputs: Inputs, sizes: Sizes) -> Array:
        """Return features of the past, then of the paths."""
        path = inputs["path"][:, :, ::SHOWN].reshape(len(inputs["path"]), -1)
        columns = [super().encoded(inputs, sizes), path, inputs["chance"]]
        return namespace(path).concatenate(columns, 1)

    def moved(self, inputs: Inputs, residual: Array, sizes: Sizes) -> Array:
        """Return futures along and across the paths, then those of "modes"."""
        free_count = _free_count(sizes)
        along = _along_paths(inputs, residual[:, :-free_count], sizes)
        others = super().moved(inputs, residual[:, -free_count:], sizes)
        return namespace(residual).concatenate([along, others], 1)

    def forward(
        self, weights: Weights, inputs: Inputs, sizes: Sizes
    ) -> dict[str, Array]:
        """Return the output of "modes".

        What was turned round is turned back.
        """
        output = super().forward(weights, inputs, sizes)
        side = inputs["side"]
        return {
            **output,
            "modes": output["modes"] * side[:, :, None, None],
            "present": output["present"] * side,
        }


NETWORK = ModesLanes()


def _free_count(sizes: Sizes) -> int:
    """Return the number of modes that do not follow lanes."""
    return max(1, round(FREE * sizes.modes))


def _local_paths(
    windows: TrackWindows,
    side: Floats,
    moment: Ints,
    surroundings: Surroundings,
    count: int,
) -> tuple[Floats, Floats]:
    """Return ``path`` and ``chance`` of windows, ``count`` paths of each.

    ``side`` [n]: -1 for boxes turned round.
    """
    path = np.zeros((len(windows), count, POINTS, 2))
    chance = np.zeros((len(windows), count))
    box = windows.box[:, -1].astype(np.float64)
    box[:, 3] += np.where(side < 0, np.pi, 0)
    if surroundings.lanes:
        for frame in np.unique(moment):
            rows = np.flatnonzero(moment == frame)
            lanes = surroundings.lanes_at(frame)
            paths = lane_paths(lanes, box[rows, :2], box[rows, 3], count, METRES)
            path[rows] = paths.points
            chance[rows] = paths.chance
    path_count = (chance > 0).sum(axis=1)
    # paths over and over again, until all places are filled
    repeated = np.arange(count) % np.maximum(path_count, 1)[:, None]
    path = np.take_along_axis(path, repeated[:, :, None, None], axis=1)
    path = path - box[:, None, None, :2]
    path = np.einsum("nmsi,nij->nmsj", path, rotation(box[:, 3]))
    path[path_count == 0] = np.arange(POINTS)[:, None] * np.array([STEP, 0.0])
    return path.astype(np.float32), chance.astype(np.float32)


def _along_paths(inputs: Inputs, residual: Array, sizes: Sizes) -> Array:
    """Return places [n, J, T, 2] m on paths, at constant speed.

    ``residual`` corrects them, m along the paths and to the left.
    """
    path = inputs["path"]
    xp = namespace(residual)
    step = path[:, :, 1:] - path[:, :, :-1]
    direction = xp.concatenate([step, step[:, :, -1:]], 2) / STEP
    heading = direction[:, :, 0]
    begin = path[:, :, 0]
    speed = (mean_velocity(inputs, sizes.dt)[:, None] * heading).sum(-1)
    # m of the object to the left of the path
    left = heading[..., 1] * begin[..., 0] - heading[..., 0] * begin[..., 1]
    time = xp.cumsum(xp.ones_like(residual[..., 0]), 2) * sizes.dt
    # points of the path that are passed
    station = ((speed[..., None] * time + residual[..., 0]) / STEP)[..., None]
    inside = xp.clip(station, 0, POINTS - 1)
    number = xp.cumsum(xp.ones_like(path[..., 0]), 2) - 1
    # share of each point: linear between two
    share = relu(1 - abs(inside - number[:, :, None]))
    place_direction = share @ xp.concatenate([path, direction], 3)
    ahead = place_direction[..., 2:]
    normal = xp.stack([-ahead[..., 1], ahead[..., 0]], -1)
    across = normal * (left[..., None] + residual[..., 1])[..., None]
    beyond = (station - inside) * STEP * ahead  # straight on
    return place_direction[..., :2] + beyond + across
