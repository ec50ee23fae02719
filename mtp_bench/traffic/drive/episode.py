"""An episode of a closed loop: every action of the agent is planned on, and the world moves to the next frame."""

from dataclasses import dataclass, field, replace

import numpy as np

from ...cards import Card, DriveSection
from ...core import Drive, Ints, Observation, Scene, Task, to_metres
from ...env import Episode, Feed, LocalFrame, RecordedAction, make_feed
from ...sources import section_of
from ..highway.driven import DrivenTraffic
from ..highway.source import traffic_of
from ..highway.store import pack
from ..highway.world import RATE, HighwaySource, World
from .planner import Decision, Obstacles, Planner
from .record import record_of, rows_from
from .scenes import DrivenScene, horizon

CRASH = 100.0  # m of way that a collision at fault costs as reward
_EASY = 0.3  # s in which the speed of the way is taken up
_GENTLE = -2.0  # m/s2; the planner's stronger braking is never eased, and a speed too high is lost by no more
_MOST = 2.0  # m/s2


@dataclass
class DrivenEpisode(Episode):
    """One drive; ``scene`` and ``feed`` are of the frame of now alone, until the drive is over."""

    card: Card = None  # type: ignore[assignment]
    task: Task = None  # type: ignore[assignment]
    traffic: DrivenTraffic = None  # type: ignore[assignment]
    shown: DrivenScene = None  # type: ignore[assignment]
    planner: Planner = None  # type: ignore[assignment]
    stations: list[float] = field(default_factory=list)
    acceleration: list[float] = field(default_factory=list)
    plans: list[Decision] = field(default_factory=list)
    drop: list[int] = field(default_factory=list)

    @classmethod
    def start(
        cls,
        card: Card,
        task: Task,
        name: str,
        number: int,
        rng: np.random.Generator | None,
    ) -> "DrivenEpisode":
        """The first frame of the drive ``name``; ``rng`` moves the frame of observations at random."""
        traffic = DrivenTraffic(
            traffic_of(section_of(card, HighwaySource)), int(name.rsplit("-", 1)[1])
        )
        shown = DrivenScene(card, name)
        scene = shown.now(traffic.world(last=True))
        local = LocalFrame.of(scene, rng)
        feed = make_feed(scene, local, task, card)
        planner = Planner(
            traffic.way, traffic.size, (card.drive or DriveSection()).planner
        )
        return cls(
            scene,
            number,
            local,
            feed,
            None,
            horizon(card) - 1,
            card=card,
            task=task,
            traffic=traffic,
            shown=shown,
            planner=planner,
            stations=[traffic.ego.s],
        )

    @property
    def row(self) -> int:
        """0: the feed is of one frame."""
        return 0

    @property
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit [F]."""
        return np.array(self.drop, dtype=np.int64)

    def observe(self) -> Observation:
        """Fresh arrays of the frame of now; after the end no detections."""
        seen = self.feed.observe(0 if not self.over else 1)
        now = (self.t - self.over) * self.task.dt
        return {**seen, "time": np.array(now), "dt": np.array(self.task.dt)}

    def recording(self) -> tuple[Scene, Feed]:
        """The frames so far, and what the agent was shown in them."""
        scene = (
            self.scene
            if self.over
            else self.shown.whole(self._world_of(max(self.t, 1)))
        )
        return scene, make_feed(scene, self.frame, self.task, self.card)

    @property
    def over(self) -> bool:
        """True after the goal, a collision, or the longest time."""
        return self.drive is not None

    def take(self, action: RecordedAction) -> float:
        """Plan on the action and let the world move to the next frame; the metres driven, less `CRASH`."""
        before = self.stations[-1]
        self.actions.append(action)
        self.drop.append(int(self.feed.dropped[0]))
        plan = self.planner.decide(
            self.traffic.ego.s,
            float(self.traffic.ego.speed),
            obstacles(action, self.task.dt),
        )
        self.plans.append(plan)
        for _ in range(round(RATE * self.task.dt)):
            if not self.traffic.over:
                self._drive(plan.acceleration)
        if self.traffic.over or self.t == self.end:
            self._finish()
        else:
            self.scene = self.shown.now(self.traffic.world(last=True))
            self.feed = make_feed(self.scene, self.frame, self.task, self.card)
        fault = self.drive is not None and self.drive.at_fault
        return self.stations[-1] - before - CRASH * fault

    def _drive(self, wanted: float) -> None:
        ego = self.traffic.ego
        if (
            wanted > _GENTLE
        ):  # at the speed of the way the rest of the profile is not needed, and above it none is
            eased = (self.planner.allowed(ego.s) - float(ego.speed)) / _EASY
            wanted = min(wanted, max(eased, _GENTLE))
        self.traffic.step(round(min(wanted, _MOST), 6))
        self.acceleration.append(float(ego.action["acceleration"]))
        self.stations.append(float(ego.s))

    def _finish(self) -> None:
        world = self._world_of(self.t)
        ending = rows_from(self.traffic.world().truth, len(world.time))
        self.scene = self.shown.whole(world)
        self.drive = replace(self._recorded(), world={**pack(world), "ending": ending})

    def record(self) -> Drive | None:
        """The drive until now."""
        return self._recorded() if self.plans else None

    def _recorded(self) -> Drive:
        return record_of(
            self.traffic,
            np.array(self.stations),
            np.array(self.acceleration),
            self.plans,
        )

    def _world_of(self, frames: int) -> World:
        """The world until the last of ``frames`` frames that the agent saw."""
        return self.traffic.world(frames=round((frames - 1) * RATE * self.task.dt) + 1)


def obstacles(action: RecordedAction, dt: float) -> Obstacles:
    """The forecasts of an action, as the planner reads them; the weight of a sample is its chance."""
    centre = action.object_box[:, None, None, :2].astype(np.float64)
    chance = (
        np.exp(action.forecast_log_weight.astype(np.float64))
        * action.object_confidence[:, None]
    )
    return Obstacles(
        action.object_box.astype(np.float64),
        centre + to_metres(action.forecast),
        chance,
        dt,
    )
