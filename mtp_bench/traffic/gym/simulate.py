"""Simulation of one seed in an environment of highway-env: every step is recorded until two vehicles crash."""

import importlib
import pkgutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...core import CardError, DataError, Floats, MtpBenchError
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
            warnings.simplefilter(
                "ignore"
            )  # older versions of an environment are wanted, too
            env = gymnasium.make(
                traffic.id, disable_env_checker=True, **config
            ).unwrapped
    except gymnasium.error.Error as error:
        expected = "an id that highway-env or [source]'s module registers when it is imported (gymnasium.register)"
        raise CardError(
            f"source.id: got {traffic.id!r}, expected {expected}: {error}"
        ) from None
    if getattr(env, "road", None) is None or getattr(env, "vehicle", None) is None:
        raise CardError(
            f"source.id: {traffic.id} is not an environment of highway-env: it has no road or no vehicle"
        )
    return env


@contextmanager
def _classes_kept(traffic: GymTraffic) -> Iterator[None]:
    """Undo changes of the classes of vehicles, which some environments make: they would change other scenes.

    Raises DataError for an error of the environment, or of a module that it needs.
    """
    before: list[tuple[Any, dict[str, Any]]] = []
    try:
        for module in (
            "highway_env",
            *traffic.modules,
        ):  # they register their environments
            importlib.import_module(module)
        from highway_env.vehicle.objects import RoadObject

        kinds = [RoadObject]
        for kind in kinds:
            kinds += [each for each in kind.__subclasses__() if each not in kinds]
        before += [(kind, dict(vars(kind))) for kind in kinds]
        yield
    except MtpBenchError:
        raise
    except Exception as error:
        problem = f"{traffic.id} with policy {traffic.policy!r} cannot be simulated"
        raise DataError(f"{problem}: {type(error).__name__}: {error}") from error
    finally:
        for kind, attributes in before:
            for name in [
                name
                for name, value in vars(kind).items()
                if attributes.get(name, kind) is not value
            ]:
                if name in attributes:
                    setattr(kind, name, attributes[name])
                else:
                    delattr(kind, name)


def simulate(traffic: GymTraffic, seed: int) -> World:
    """The world of a seed, without frames if two vehicles crash or that with the sensor is removed."""
    with _classes_kept(traffic):
        env = _environment(traffic)
        if ":" not in traffic.policy:
            env.configure(
                {"observation": {"type": "Kinematics"}}
            )  # unused; others need a vehicle of their own kind
        observation, _ = env.reset(seed=seed)
        policy, rate = (
            _policy(env, traffic.policy),
            float(env.config["simulation_frequency"]),
        )
        recording, frames = _Recording(env), round(traffic.seconds * rate)
        ego, rows = recording.numbers[env.vehicle], recording.rows
        while len(rows) < frames and not recording.crashed:
            before = len(rows)
            observation, *_ = env.step(policy(observation))
            if len(rows) == before:
                raise DataError(
                    f"{traffic.id}: a step of the environment has no step of its simulation, expected some"
                )
        if recording.crashed or not all((frame[:, 10] == ego).any() for frame in rows):
            frames = 0
        lanes = lane_map(env.road.network.lanes_dict(), _LOOSE)
        return seen_from(ego, right_handed(rows[:frames]), frames, rate, lanes)


class _Recording:
    """Rows of all vehicles at the start and after each step of an environment's simulation."""

    def __init__(self, env: Any) -> None:
        self.rows: list[Floats] = []
        self.numbers: dict[Any, int] = {}  # by vehicle
        self.crashed = False
        self._road, self._step = env.road, env.road.step
        env.road.step = self._stepped
        self._add()

    def _stepped(self, dt: float) -> None:
        """Move the vehicles of the road by ``dt`` seconds and record them."""
        self._step(dt)
        round_states(self._road.vehicles)
        self._add()

    def _add(self) -> None:
        vehicles = self._road.vehicles
        self.crashed |= any(vehicle.crashed for vehicle in vehicles)
        velocity, frame = course_velocity(vehicles), len(self.rows)
        rows = []
        for vehicle, speeds in zip(vehicles, velocity, strict=True):
            length, number = (
                vehicle.LENGTH,
                self.numbers.setdefault(vehicle, len(self.numbers)),
            )
            kind = (
                "motorcycle"
                if length < _SHORTEST_CAR
                else "car"
                if length <= _LONGEST_CAR
                else "truck"
            )
            size = length, vehicle.WIDTH, _HEIGHT[kind]
            box = (*vehicle.position, size[2] / 2, vehicle.heading, *size)
            rows.append((*box, *speeds, CLASSES.index(kind), number, frame))
        self.rows.append(np.reshape(np.array(rows, dtype=np.float64), (-1, 12)))


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
    twin = IDMVehicle(
        vehicle.road,
        vehicle.position,
        vehicle.heading,
        vehicle.speed,
        target_speed=speed,
    )
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
