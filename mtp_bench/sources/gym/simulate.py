"""Simulation of one seed in an environment of highway-env: every step is recorded until two vehicles crash."""

import importlib
import pkgutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...errors import CardError, DataError
from ...types import Floats
from ..highway.lanes import lane_map
from ..highway.recording import course_velocity, right_handed, seen_from
from ..highway.vehicles import round_states
from ..highway.world import CLASSES, World
from .source import GymTraffic

_HEIGHT = {"motorcycle": 1.5, "car": 1.6, "truck": 3.2}  # m
_LOOSE = 6.0  # m between lanes that follow each other, such as those into highway-env's roundabout
_SHORTEST_CAR, _LONGEST_CAR = 3.0, 6.5  # m


def simulation_rate(traffic: GymTraffic) -> float:
    """Steps of the simulation per second, Hz."""
    with _classes_kept(traffic):
        return float(_environment(traffic).config["simulation_frequency"])


def _environment(traffic: GymTraffic) -> Any:
    """A new environment; raises CardError for an unknown id, or one that is not highway-env's."""
    import gymnasium

    config: dict[str, Any] = {"config": traffic.config} if traffic.config else {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # older versions of an environment are wanted, too
            env = gymnasium.make(traffic.id, disable_env_checker=True, **config).unwrapped
    except gymnasium.error.Error as error:
        raise CardError(f"source.id: {error}") from None
    if getattr(env, "road", None) is None or getattr(env, "vehicle", None) is None:
        raise CardError(f"source.id: {traffic.id} is not an environment of highway-env: it has no road or no vehicle")
    return env


@contextmanager
def _classes_kept(traffic: GymTraffic) -> Iterator[None]:
    """Undo changes of the classes of vehicles, which some environments make: they would change other scenes."""
    for module in ("highway_env", *traffic.modules):  # they register their environments
        importlib.import_module(module)
    from highway_env.vehicle.objects import RoadObject

    kinds = [RoadObject]
    for kind in kinds:
        kinds += [each for each in kind.__subclasses__() if each not in kinds]
    before = [(kind, dict(vars(kind))) for kind in kinds]
    try:
        yield
    finally:
        for kind, attributes in before:
            for name in [name for name, value in vars(kind).items() if attributes.get(name, kind) is not value]:
                if name in attributes:
                    setattr(kind, name, attributes[name])
                else:
                    delattr(kind, name)


def simulate(traffic: GymTraffic, seed: int) -> World:
    """The world of a seed, without frames if two vehicles crash or the sensor's vehicle leaves the road map."""
    with _classes_kept(traffic):
        return _simulate(traffic, seed)


def _simulate(traffic: GymTraffic, seed: int) -> World:
    env = _environment(traffic)
    if ":" not in traffic.policy:
        env.configure({"observation": {"type": "Kinematics"}})  # not looked at; others need their own kind of vehicle
    observation, _ = env.reset(seed=seed)
    policy = _policy(env, traffic.policy)
    recording = _Recording(env)
    frames = round(traffic.seconds * recording.rate)
    for _ in range(frames):  # a step of the environment has at least one of the simulation
        if recording.crashed or len(recording.rows) >= frames:
            break
        observation, *_ = env.step(policy(observation))
    return recording.world(frames)


class _Recording:
    """Rows of all vehicles after each step of an environment's simulation."""

    def __init__(self, env: Any) -> None:
        self.env, self.rate = env, float(env.config["simulation_frequency"])
        self.rows: list[Floats] = []
        self.crashed = False
        self._numbers: dict[Any, int] = {}  # by vehicle
        self._step: Callable[[float], None] = env.road.step
        env.road.step = self._stepped
        self._add()

    def _stepped(self, dt: float) -> None:
        """Move the vehicles of the road by ``dt`` seconds and record them."""
        self._step(dt)
        round_states(self.env.road.vehicles)
        self._add()

    def _add(self) -> None:
        vehicles = self.env.road.vehicles
        self.crashed |= any(vehicle.crashed for vehicle in vehicles)
        numbers = [self._numbers.setdefault(vehicle, len(self._numbers)) for vehicle in vehicles]
        kinds = [_kind(vehicle.LENGTH) for vehicle in vehicles]
        boxes = [
            (*vehicle.position, _HEIGHT[kind] / 2, vehicle.heading, vehicle.LENGTH, vehicle.WIDTH, _HEIGHT[kind])
            for vehicle, kind in zip(vehicles, kinds, strict=True)
        ]
        classes, frame = [CLASSES.index(kind) for kind in kinds], np.full(len(boxes), len(self.rows))
        self.rows.append(
            np.column_stack([np.reshape(boxes, (-1, 7)), course_velocity(vehicles), classes, numbers, frame])
        )

    def world(self, frames: int) -> World:
        """The first ``frames`` frames; none after a crash, or without the sensor's vehicle in all of them."""
        lanes, ego = lane_map(self.env.road.network.lanes_dict(), _LOOSE), self._numbers.get(self.env.vehicle, -1)
        there = all((rows[:, 10] == ego).any() for rows in self.rows)
        count = frames if there and not self.crashed else 0
        if count > len(self.rows):
            raise DataError(f"{self.env}: {len(self.rows)} steps of the simulation, expected {frames}")
        return seen_from(ego, right_handed(self.rows[:count]), count, self.rate, lanes)


def _kind(length: float) -> str:
    if length < _SHORTEST_CAR:
        return "motorcycle"
    return "car" if length <= _LONGEST_CAR else "truck"


def _policy(env: Any, name: str) -> Callable[[Any], Any]:
    """The action for an observation: of a function "module:function", else the one that does nothing.

    "idm": all controlled vehicles become like the others, IDM with MOBIL, which no action changes.
    """
    if ":" in name:
        policy: Callable[[Any], Any] = pkgutil.resolve_name(name)
        return policy
    if name == "idm":
        for vehicle in env.controlled_vehicles:
            _drive_itself(vehicle)
    action = _idle(env.action_type)
    return lambda observation: action


def _drive_itself(vehicle: Any) -> None:
    """Make a controlled vehicle an `IDMVehicle` at the speed that it was given, else at the limit of its lane."""
    from highway_env.vehicle.behavior import IDMVehicle

    speed = vehicle.lane.speed_limit or vehicle.speed
    twin = IDMVehicle(vehicle.road, vehicle.position, vehicle.heading, vehicle.speed, target_speed=speed)
    vehicle.__dict__ = {**twin.__dict__, **vehicle.__dict__}
    vehicle.__class__ = IDMVehicle


def _idle(action_type: Any) -> Any:
    """The action that changes neither speed nor lane."""
    agents = getattr(action_type, "agents_action_types", None)
    if agents is not None:
        return tuple(map(_idle, agents))
    if "IDLE" in getattr(action_type, "actions_indexes", ()):
        return action_type.actions_indexes["IDLE"]
    space = action_type.space()
    return space.n // 2 if hasattr(space, "n") else np.zeros(space.shape, space.dtype)
