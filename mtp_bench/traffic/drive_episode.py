"""Episode of a closed loop: the ego plans on every action, and the world moves on.

Its scenes are the present frame while it is driven, and then the recording.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..cards import Card, DriveSection
from ..core import (
    Detections,
    Drive,
    Floats,
    Ints,
    Observation,
    Scene,
    Task,
    joined,
    starts_of,
    to_metres,
)
from ..detector import Memory, OpenScene, visible_fractions
from ..env import Episode, Feed, LocalFrame, RecordedAction, frame_info, make_feed
from ..sources import detected, perturbed, section_of
from .drive_record import record_of, rows_from
from .highway.driven import DrivenTraffic
from .highway.source import pack, scene_of, traffic_of
from .highway.world import RATE, HighwaySource, World
from .planner import Decision, Obstacles, Planner


class DrivenScene:
    """Frames of one drive, shown one after the other.

    Their detections equal those of `whole_scene`, which has all frames at once.
    """

    def __init__(self, card: Card, name: str) -> None:
        self._card = card
        self._name = name
        self._ego: list[Floats] = []
        self._detections: list[Detections] = []
        self._detector = ""
        self._open_scene: OpenScene | None = None
        self._unchanged: list[Scene] = []  # frames before `perturb`, where it is asked

    def current(self, world: World) -> Scene:
        """Return the next frame of the drive as a scene with detections.

        ``world`` has this frame alone.
        """
        scene = _scene(world, self._card, self._name, stride=1)
        frame = len(self._ego)
        self._ego.append(scene.ego[0])
        if self._open_scene is None:
            frames = horizon(self._card)
            self._open_scene = OpenScene(frames, scene.truth, memory=Memory())
        # earlier frames are empty: the open scene remembers them
        start = starts_of([0] * frame + [len(scene.truth.box)])
        until_now = replace(
            scene,
            time=np.arange(frame + 1) / self._card.task.rate,
            ego=np.array(self._ego),
            truth=replace(scene.truth, start=start),
        )
        detected_scene = detected(until_now, self._card, going_on=self._open_scene)
        self._detector = detected_scene.detector
        detections = replace(
            detected_scene.detections, start=detected_scene.detections.start[-2:]
        )
        scene = replace(scene, detections=detections, simulated=True)
        if self._card.perturb is not None:
            self._unchanged.append(scene)
            changed = perturbed(self._until_now(until_now), self._card)
            shown = changed.detections.only(frame)
            scene = replace(scene, detections=replace(shown, start=shown.start[-2:]))
            self._detector = changed.detector
        self._detections.append(scene.detections)
        return scene

    def _until_now(self, scene: Scene) -> Scene:
        """Return the frames before `perturb` as one scene, with time and ego of ``scene``."""
        truths = [each.truth for each in self._unchanged]
        detections = [each.detections for each in self._unchanged]
        return replace(
            scene,
            truth=replace(
                joined(truths), start=starts_of([len(each.box) for each in truths])
            ),
            detections=replace(
                joined(detections),
                start=starts_of([len(each.box) for each in detections]),
            ),
            detector=self._detector,
            simulated=True,
        )

    def recording(self, world: World) -> Scene:
        """Join the frames of ``world``, with the detections that were shown."""
        scene = _scene(world, self._card, self._name)
        shown = self._detections[: scene.frames]
        start = starts_of([len(detections.score) for detections in shown])
        return replace(
            scene,
            detections=replace(joined(shown), start=start),
            detector=self._detector,
            simulated=True,
        )


def whole_scene(world: World, card: Card, name: str) -> Scene:
    """Return the recording of a drive with the detections then shown."""
    scene = _scene(world, card, name)
    # an open scene draws the noise as it was drawn frame by frame
    open_scene = OpenScene(horizon(card), scene.truth.only(0))
    return perturbed(detected(scene, card, going_on=open_scene), card)


def _scene(world: World, card: Card, name: str, stride: int | None = None) -> Scene:
    """Return every n-th frame of a world as a scene.

    ``stride``: n; None: steps of the simulation per frame of the card.
    """
    world = replace(world, visible=visible_fractions(world.truth, world.ego))
    return scene_of(name, world, card, stride or round(RATE / card.task.rate))


def horizon(card: Card) -> int:
    """Count the frames of the longest drive, the first one too."""
    seconds = float(card.source.traits.scene_seconds or 0)
    return round(seconds * card.task.rate) + 1


CRASH = 100.0  # m of way that a collision at fault costs as reward
_SPEED_SECONDS = 0.3  # in which the ego reaches the allowed speed
# Stronger braking of the planner is never eased. An ego that is only too fast brakes no
# harder.
_EASED_BRAKING_MPS2 = -2.0
_MAX_ACCELERATION_MPS2 = 2.0


@dataclass
class DrivenEpisode(Episode):
    """One drive, for `MTPEnv`.

    Until the drive is over, ``scene`` and ``feed`` have the present frame alone.
    """

    card: Card
    task: Task
    traffic: DrivenTraffic
    shown: DrivenScene
    planner: Planner
    plans: list[Decision] = field(default_factory=list)
    dropped_counts: list[int] = field(default_factory=list)
    # one per step of the simulation
    stations: list[float] = field(default_factory=list)
    accelerations: list[float] = field(default_factory=list)

    @classmethod
    def start(
        cls,
        card: Card,
        task: Task,
        name: str,
        rng: np.random.Generator | None,
    ) -> "DrivenEpisode":
        """Begin the drive ``name``.

        ``rng`` moves the frame of observations at random.
        """
        settings = traffic_of(section_of(card, HighwaySource))
        traffic = DrivenTraffic(settings, int(name.rsplit("-", 1)[1]))
        shown = DrivenScene(card, name)
        scene = shown.current(traffic.world(last_only=True))
        frame = LocalFrame.of(scene, rng)
        section = card.drive or DriveSection()
        planner = Planner(traffic.way, traffic.size, section.planner)
        feed = make_feed(scene, frame, task, card)
        episode = cls(scene, frame, feed, card, task, traffic, shown, planner)
        episode.stations.append(traffic.ego.s)
        return episode

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
        feed_frame = 0
        last_frame = self.frame_index
        if self.over:
            feed_frame = 1  # beyond the only frame of the feed: no detections
            last_frame -= 1
        observation = self.feed.observe(feed_frame)
        time = np.array(last_frame * self.task.dt)
        return {**observation, "time": time, "dt": np.array(self.task.dt)}

    def info(self) -> dict[str, Any]:
        """Return numbers of the present frame, and of the action before."""
        dropped = 0 if self.over else int(self.feed.dropped[0])
        last_action = self.actions[-1] if self.actions else None
        return frame_info(self.frame_index, dropped, last_action)

    def recording(self) -> tuple[Scene, Feed]:
        """Return the frames so far and the observations of them."""
        scene = self.scene
        if not self.over:
            # frames with an action; before the first action, the first frame
            frames = max(self.frame_index, 1)
            scene = self.shown.recording(self._world_of(frames))
        return scene, make_feed(scene, self.frame, self.task, self.card)

    def record(self) -> Drive | None:
        """Return the drive until now, for pictures."""
        return self._drive_until_now() if self.plans else None

    def take(self, action: RecordedAction) -> float:
        """Plan on the action and move the world to the next frame.

        Return the metres driven, less `CRASH` for a collision at fault.
        """
        start_m = self.stations[-1]
        self.actions.append(action)
        # the feed has the present frame alone
        self.dropped_counts.append(int(self.feed.dropped[0]))
        ego = self.traffic.ego
        forecast_obstacles = obstacles(action, self.task.dt)
        plan = self.planner.decide(ego.s, float(ego.speed), forecast_obstacles)
        self.plans.append(plan)
        for _ in range(round(RATE * self.task.dt)):
            if not self.traffic.over:
                self._step_world(plan.acceleration)
        # no action follows the last frame
        if self.traffic.over or self.frame_index == horizon(self.card) - 1:
            self._finish()
        else:
            self.scene = self.shown.current(self.traffic.world(last_only=True))
            self.feed = make_feed(self.scene, self.frame, self.task, self.card)
        reward = self.stations[-1] - start_m
        if self.drive is not None and self.drive.at_fault:
            reward -= CRASH
        return reward

    def _step_world(self, acceleration: float) -> None:
        """Move the world by a step, at the planned ``acceleration`` of the ego.

        It is eased near the allowed speed, where a profile of the planner bends.
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
        """End the drive: keep its record and the scene of all shown frames."""
        world = self._world_of(self.frame_index)
        # states of the simulation after the last shown frame
        ending = rows_from(self.traffic.world().truth, len(world.time))
        self.scene = self.shown.recording(world)
        self.drive = replace(
            self._drive_until_now(), world={**pack(world), "ending": ending}
        )

    def _drive_until_now(self) -> Drive:
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

    The weight of a sample is its probability times the object's confidence.
    """
    box = action.object_box.astype(np.float64)
    weight = np.exp(action.forecast_log_weight.astype(np.float64))
    path = box[:, None, None, :2] + to_metres(action.forecast)
    return Obstacles(box, path, weight * action.object_confidence[:, None], dt)
