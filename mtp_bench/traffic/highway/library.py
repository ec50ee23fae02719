"""Copies of the classes of highway-env that traffic runs on.

A program can change attributes of highway-env's classes, for example
``Vehicle.MAX_SPEED``. The copies keep those of the installed release: worlds, which
remain in the cache, are the same in every program.
"""

import importlib
import importlib.util
import sys
from typing import Any


def _copy(name: str) -> Any:
    """Execute a module of highway-env once more and return it.

    The package's environments, with pygame and pandas, are left out.
    """
    spec: Any = importlib.util.find_spec("highway_env")
    loaded = _pop_modules()
    sys.modules["highway_env"] = importlib.util.module_from_spec(spec)
    module = importlib.import_module(name)
    _pop_modules()
    sys.modules.update(loaded)
    return module


def _pop_modules() -> dict[str, Any]:
    names = [name for name in sys.modules if name.split(".")[0] == "highway_env"]
    return {name: sys.modules.pop(name) for name in names}


_lane = _copy("highway_env.road.lane")
CircularLane = _lane.CircularLane
SineLane = _lane.SineLane
StraightLane = _lane.StraightLane
RoadNetwork = _copy("highway_env.road.road").RoadNetwork
Vehicle = _copy("highway_env.vehicle.kinematics").Vehicle
