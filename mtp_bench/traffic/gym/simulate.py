"""Simulation of one seed in an environment of highway-env.

Every step is recorded until two vehicles crash.
"""

import importlib
import pkgutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...core import CardError, DataError, MtpBenchError, say_once
from ..highway.lanes import lane_map
from ..highway.vehicles import round_states
from ..highway.world import (
    CLASSES,
    NUMBER_COLUMN,
    GymTraffic,
    Recording,
    World,
    course_velocity,
)

_HEIGHT_M = {"motorcycle": 1.5, "car": 1.6, "truck": 3.2}
# between lanes that follow each other, such as those into highway-env's roundabout
_MAX_JOINT_GAP_M = 6.0
_TRIAL_STEPS = 3  # of the environment, before all scenes
_MIN_CAR_LENGTH_M = 3.0
_MAX_CAR_LENGTH_M = 6.5


def checked_rate(traffic: GymTraffic, seed: int) -> float:
    """Return the steps of the simulation per second, Hz, and play the first steps.

    Configuration keys that the environment does not have are named. Raises CardError
    for a policy that is faster than the simulation, and DataError for an environment
    without other vehicles, or that the policy cannot drive in.
    """
    with _restored_classes(traffic):
        env, observation, policy = _start(traffic, seed)
        for key in _unknown_keys(traffic.config, env.default_config()):
            say_once(
                f"{traffic.id} has no default for the key {key!r} of [source] config: "
                "if it is misspelt, it changes nothing"
            )
        rate = float(env.config["simulation_frequency"])
        policy_rate = env.config["policy_frequency"]
        if policy_rate > rate:
            raise CardError(
                f"config: got policy_frequency {policy_rate} above "
                f"simulation_frequency {rate:g}, expected at most that"
            )
        for _ in range(_TRIAL_STEPS):
            observation, *_ = env.step(policy(observation))
            if len(env.road.vehicles) > len(env.controlled_vehicles):
                return rate
        raise DataError(
            f"{traffic.id}: no vehicle but those of the agent in {_TRIAL_STEPS} steps, "
            "expected others to track: is there a key such as vehicles_count in config?"
        )


def _unknown_keys(config: dict[str, Any], defaults: dict[str, Any]) -> Iterator[str]:
    """Yield the keys of a configuration, also nested, that have no default."""
    for key, value in config.items():
        if key not in defaults:
            yield key
        elif isinstance(value, dict) and isinstance(defaults[key], dict):
            yield from (f"{key}.{each}" for each in _unknown_keys(value, defaults[key]))


def _start(traffic: GymTraffic, seed: int) -> tuple[Any, Any, Callable[[Any], Any]]:
    """Return an environment after its reset, the observation and the policy."""
    env = _environment(traffic)
    if ":" not in traffic.policy:
        # no policy reads observations; some kinds need vehicles of their own kind
        env.configure({"observation": {"type": "Kinematics"}})
    observation, _ = env.reset(seed=seed)
    return env, observation, _policy(env, traffic.policy)


def _environment(traffic: GymTraffic) -> Any:
    """Make an environment.

    Raises CardError for an unknown id, or one that is not highway-env's.
    """
    import gymnasium

    options: dict[str, Any] = {"config": traffic.config} if traffic.config else {}
    options["disable_env_checker"] = True
    try:
        with warnings.catch_warnings():
            # older versions of an environment are wanted, too
            warnings.simplefilter("ignore")
            env = gymnasium.make(traffic.id, **options).unwrapped
    except gymnasium.error.Error as error:
        raise CardError(
            f"source.id: got {traffic.id!r}, expected an id that highway-env or"
            " [source]'s module registers when it is imported (gymnasium.register):"
            f" {error}"
        ) from None
    if getattr(env, "road", None) is None or getattr(env, "vehicle", None) is None:
        raise CardError(
            f"source.id: {traffic.id} is not an environment of highway-env:"
            " it has no road or no vehicle"
        )
    return env


@contextmanager
def _restored_classes(traffic: GymTraffic) -> Iterator[None]:
    """Undo changes of the classes of vehicles.

    Some environments change these classes, which would change later scenes. Raises
    DataError for an error of the environment, or of a module that it needs.
    """
    attributes: dict[Any, dict[str, Any]] = {}
    try:
        # modules register their environments
        for module in ("highway_env", *traffic.modules):
            importlib.import_module(module)
        from highway_env.vehicle.objects import RoadObject

        classes = [RoadObject]
        for kind in classes:  # the list grows: subclasses of subclasses come too
            classes += [sub for sub in kind.__subclasses__() if sub not in classes]
        attributes = {kind: dict(vars(kind)) for kind in classes}
        yield
    except MtpBenchError:
        raise
    except Exception as error:
        problem = f"{traffic.id} with policy {traffic.policy!r} cannot be simulated"
        raise DataError(f"{problem}: {type(error).__name__}: {error}") from error
    finally:
        for kind, values in attributes.items():
            _restore(kind, values)


def _restore(kind: Any, attributes: dict[str, Any]) -> None:
    """Give the class ``kind`` exactly these ``attributes`` again."""
    for name, value in [*vars(kind).items()]:
        if name not in attributes:
            delattr(kind, name)
        elif attributes[name] is not value:
            setattr(kind, name, attributes[name])


def simulate(traffic: GymTraffic, seed: int) -> World:
    """Return the world of a seed.

    It has no frames if two vehicles crash or the vehicle with the sensor is removed.
    """
    with _restored_classes(traffic):
        env, observation, policy = _start(traffic, seed)
        rate = float(env.config["simulation_frequency"])
        recorder = _Recorder(env, rate)
        ego = recorder.numbers[env.vehicle]
        frames = recorder.recording.frames
        end = round(traffic.seconds * rate)
        while len(frames) < end and not recorder.crashed:
            start = len(frames)
            observation, *_ = env.step(policy(observation))
            if len(frames) == start:
                raise DataError(
                    f"{traffic.id}: a step of the environment has no step of its"
                    " simulation, expected some"
                )
        ego_stays = all((rows[:, NUMBER_COLUMN] == ego).any() for rows in frames)
        if recorder.crashed or not ego_stays:
            end = 0  # no frames
        lanes = lane_map(env.road.network.lanes_dict(), _MAX_JOINT_GAP_M)
        return recorder.recording.seen_from(ego, lanes, slice(end))


class _Recorder:
    """Records all vehicles at the start and after each step of the simulation."""

    def __init__(self, env: Any, rate: float) -> None:
        self.recording = Recording(rate)
        self.numbers: dict[Any, int] = {}  # by vehicle
        self.crashed = False
        self._road = env.road
        self._step_road = env.road.step
        env.road.step = self._step_and_record
        self._add()

    def _step_and_record(self, dt: float) -> None:
        """Move the vehicles of the road by ``dt`` seconds and record them."""
        self._step_road(dt)
        round_states(self._road.vehicles)
        self._add()

    def _add(self) -> None:
        """Record the present frame; new vehicles get the next numbers."""
        vehicles = self._road.vehicles
        self.crashed |= any(vehicle.crashed for vehicle in vehicles)
        for vehicle in vehicles:
            self.numbers.setdefault(vehicle, len(self.numbers))
        kinds = [_kind_of(vehicle.LENGTH) for vehicle in vehicles]
        boxes = []
        for vehicle, kind in zip(vehicles, kinds, strict=True):
            height = _HEIGHT_M[kind]
            size = (vehicle.LENGTH, vehicle.WIDTH, height)
            boxes.append((*vehicle.position, height / 2, vehicle.heading, *size))
        self.recording.add(
            np.array(boxes, dtype=np.float64).reshape(-1, 7),
            course_velocity(vehicles),
            [CLASSES.index(kind) for kind in kinds],
            [self.numbers[vehicle] for vehicle in vehicles],
        )


def _kind_of(length_m: float) -> str:
    if length_m < _MIN_CAR_LENGTH_M:
        return "motorcycle"
    return "car" if length_m <= _MAX_CAR_LENGTH_M else "truck"


def _policy(env: Any, name: str) -> Callable[[Any], Any]:
    """Return the function from an observation to an action.

    A policy "module:function" names it. Other policies always return the idle action.
    With "idm" all controlled vehicles become like the others, IDM with MOBIL, which no
    action changes.
    """
    if ":" in name:
        policy: Callable[[Any], Any] = pkgutil.resolve_name(name)
        return policy
    if name == "idm":
        for vehicle in env.controlled_vehicles:
            _make_idm(vehicle)
    action = _idle(env.action_type)
    return lambda observation: action


def _make_idm(vehicle: Any) -> None:
    """Make a controlled vehicle an `IDMVehicle` at the limit of its lane.

    Without a limit it keeps its speed.
    """
    from highway_env.vehicle.behavior import IDMVehicle

    twin = IDMVehicle(
        vehicle.road,
        vehicle.position,
        vehicle.heading,
        vehicle.speed,
        target_speed=vehicle.lane.speed_limit or vehicle.speed,
    )
    # it keeps its own values, and gets those that only an `IDMVehicle` has
    vehicle.__dict__ = {**twin.__dict__, **vehicle.__dict__}
    vehicle.__class__ = IDMVehicle


def _idle(action_type: Any) -> Any:
    """Return the action that changes neither speed nor lane."""
    agents = getattr(action_type, "agents_action_types", None)
    if agents is not None:
        return tuple(map(_idle, agents))
    if "IDLE" in getattr(action_type, "actions_indexes", ()):
        return action_type.actions_indexes["IDLE"]
    space = action_type.space()
    # the middle of discrete steering and acceleration, or zeros
    return space.n // 2 if hasattr(space, "n") else np.zeros(space.shape, space.dtype)
