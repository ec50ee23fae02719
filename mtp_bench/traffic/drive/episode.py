"""Episode of a closed loop: the ego plans on every action, and the world moves on."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...cards import Card, DriveSection
from ...core import Drive, Ints, Observation, Scene, Task, to_metres
from ...env import Feed, LocalFrame, RecordedAction, make_feed
from ...sources import section_of
from ..highway.driven import DrivenTraffic
from ..highway.source import traffic_of
from ..highway.store import pack
from ..highway.world import RATE, HighwaySource, World
from .planner import Decision, Obstacles, Planner
from .record import record_of, rows_from
from .scenes import DrivenScene, horizon

CRASH = 100.0  # m of way that a collision at fault costs as reward
_SPEED_SECONDS = 0.3  # in which the allowed speed is taken up
# braking of the planner that is stronger is never eased, and an ego above the allowed
# speed brakes no harder
_EASED_BRAKING_MPS2 = -2.0
_MAX_ACCELERATION_MPS2 = 2.0


@dataclass
class DrivenEpisode:
    """One drive, for `MTPEnv`.

    Until the drive is over, ``scene`` and ``feed`` have the present frame alone.
    """

    card: Card
    task: Task
    number: int  # index of the scene in `MTPEnv.scene_names`
    frame: LocalFrame
    traffic: DrivenTraffic
    shown: DrivenScene
    planner: Planner
    scene: Scene
    feed: Feed
    # one per frame, in the scene's frame of reference
    actions: list[RecordedAction] = field(default_factory=list)
    plans: list[Decision] = field(default_factory=list)
    dropped_counts: list[int] = field(default_factory=list)
    # one per step of the simulation
    stations: list[float] = field(default_factory=list)
    accelerations: list[float] = field(default_factory=list)
    drive: Drive | None = None  # when it is over
    first: int = 0

    @classmethod
    def start(
        cls,
        card: Card,
        task: Task,
        name: str,
        number: int,
        rng: np.random.Generator | None,
    ) -> "DrivenEpisode":
        """Begin the drive ``name``.

        ``rng`` moves the frame of observations at random.
        """
        settings = traffic_of(section_of(card, HighwaySource))
        traffic = DrivenTraffic(settings, int(name.rsplit("-", 1)[1]))
        shown = DrivenScene(card, name)
        scene = shown.now(traffic.world(last=True))
        frame = LocalFrame.of(scene, rng)
        section = card.drive or DriveSection()
        planner = Planner(traffic.way, traffic.size, section.planner)
        feed = make_feed(scene, frame, task, card)
        episode = cls(card, task, number, frame, traffic, shown, planner, scene, feed)
        episode.stations.append(traffic.ego.s)
        return episode

    @property
    def t(self) -> int:
        """Frame that is shown."""
        return len(self.actions)

    @property
    def row(self) -> int:
        """Frame that is shown, in ``feed``: 0, as that has one frame."""
        return 0

    @property
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit into an observation [F]."""
        return np.array(self.dropped_counts, dtype=np.int64)

    @property
    def over(self) -> bool:
        """True after the goal, a collision, or the longest time."""
        return self.drive is not None

    def class_counts(self, classes: int) -> Ints:
        """Count the detections of each class [C] in the present frame."""
        return self.feed.class_counts(0, classes)

    def observe(self) -> Observation:
        """Return fresh arrays of the present frame.

        There are no detections after the end.
        """
        observation = self.feed.observe(int(self.over))
        time = (self.t - self.over) * self.task.dt
        return {**observation, "time": np.array(time), "dt": np.array(self.task.dt)}

    def info(self) -> dict[str, Any]:
        """Return numbers of the present frame, and of the action before."""
        invalid = self.actions[-1].invalid.tolist() if self.actions else (0, 0, 0)
        return {
            "frame": self.t,
            "dropped_detections": 0 if self.over else int(self.feed.dropped[0]),
            "invalid_tracks": invalid[0],
            "invalid_hypotheses": invalid[1],
            "invalid_objects": invalid[2],
        }

    def recording(self) -> tuple[Scene, Feed]:
        """Return the frames so far and the observations of them."""
        scene = self.scene
        if not self.over:
            scene = self.shown.whole(self._world_of(max(self.t, 1)))
        return scene, make_feed(scene, self.frame, self.task, self.card)

    def record(self) -> Drive | None:
        """Return the drive until now, for pictures."""
        return self._recorded() if self.plans else None

    def take(self, action: RecordedAction) -> float:
        """Plan on the action and move the world to the next frame.

        Return the metres driven, less `CRASH` for a collision at fault.
        """
        start = self.stations[-1]
        self.actions.append(action)
        self.dropped_counts.append(int(self.feed.dropped[0]))
        ego = self.traffic.ego
        seen = obstacles(action, self.task.dt)
        plan = self.planner.decide(ego.s, float(ego.speed), seen)
        self.plans.append(plan)
        for _ in range(round(RATE * self.task.dt)):
            if not self.traffic.over:
                self._drive(plan.acceleration)
        if self.traffic.over or self.t == horizon(self.card) - 1:
            self._finish()
        else:
            self.scene = self.shown.now(self.traffic.world(last=True))
            self.feed = make_feed(self.scene, self.frame, self.task, self.card)
        at_fault = self.drive is not None and self.drive.at_fault
        return self.stations[-1] - start - CRASH * at_fault

    def _drive(self, acceleration: float) -> None:
        """Move the world by a step, at the acceleration of the plan.

        Near the allowed speed, where the profile bends, it is eased.
        """
        ego = self.traffic.ego
        if acceleration > _EASED_BRAKING_MPS2:
            speed_gap = self.planner.allowed(ego.s) - float(ego.speed)
            eased = max(speed_gap / _SPEED_SECONDS, _EASED_BRAKING_MPS2)
            acceleration = min(acceleration, eased)
        self.traffic.step(round(min(acceleration, _MAX_ACCELERATION_MPS2), 6))
        self.accelerations.append(float(ego.action["acceleration"]))
        self.stations.append(float(ego.s))

    def _finish(self) -> None:
        world = self._world_of(self.t)
        ending = rows_from(self.traffic.world().truth, len(world.time))
        self.scene = self.shown.whole(world)
        self.drive = replace(self._recorded(), world={**pack(world), "ending": ending})

    def _recorded(self) -> Drive:
        stations = np.array(self.stations)
        return record_of(
            self.traffic, stations, np.array(self.accelerations), self.plans
        )

    def _world_of(self, frames: int) -> World:
        """Return the world until the last of ``frames`` shown frames."""
        steps = round((frames - 1) * RATE * self.task.dt)
        return self.traffic.world(frames=steps + 1)


def obstacles(action: RecordedAction, dt: float) -> Obstacles:
    """Return the forecasts of an action, as the planner reads them.

    The weight of a sample is its chance.
    """
    box = action.object_box.astype(np.float64)
    weight = np.exp(action.forecast_log_weight.astype(np.float64))
    path = box[:, None, None, :2] + to_metres(action.forecast)
    return Obstacles(box, path, weight * action.object_confidence[:, None], dt)
