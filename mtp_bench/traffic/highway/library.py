"""The classes of highway-env that traffic runs on, as copies of its own.

A program can change attributes of highway-env's classes, for example ``Vehicle.MAX_SPEED``. The copies keep those of
the installed release: worlds, which remain in the cache, are the same in every program.
"""

import importlib
import importlib.util
import sys
from typing import Any


def _copy(name: str) -> Any:
    """The module of this name, executed once more; the package's environments, with pygame and pandas, are left out."""
    spec: Any = importlib.util.find_spec("highway_env")
    loaded = _taken_out()
    sys.modules["highway_env"] = importlib.util.module_from_spec(spec)
    module = importlib.import_module(name)
    _taken_out()
    sys.modules.update(loaded)
    return module


def _taken_out() -> dict[str, Any]:
    return {
        name: sys.modules.pop(name)
        for name in [*sys.modules]
        if name.split(".")[0] == "highway_env"
    }


_lane, _road = _copy("highway_env.road.lane"), _copy("highway_env.road.road")
CircularLane, SineLane, StraightLane = (
    _lane.CircularLane,
    _lane.SineLane,
    _lane.StraightLane,
)
RoadNetwork = _road.RoadNetwork
Vehicle = _copy("highway_env.vehicle.kinematics").Vehicle
