"""The classes of highway-env that traffic runs on, as copies of its own.

A program can change attributes of highway-env's classes, for example ``Vehicle.MAX_SPEED``. The copies keep those of
the installed release: worlds, which remain in the cache, are the same in every program.
"""

import importlib.util
from typing import Any


def _copy(name: str) -> Any:
    """The module of this name, executed once more."""
    spec: Any = importlib.util.find_spec(name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_lane, _road = _copy("highway_env.road.lane"), _copy("highway_env.road.road")
CircularLane, SineLane, StraightLane = _lane.CircularLane, _lane.SineLane, _lane.StraightLane
RoadNetwork = _road.RoadNetwork
Vehicle = _copy("highway_env.vehicle.kinematics").Vehicle
