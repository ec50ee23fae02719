"""One pass through a scene: its frames, actions, ``info``, and what renderers draw."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pkgutil import resolve_name
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import DataError, Detections, Drive, Ints, Observation, Rollout, Scene, Task
from ..scoring import FrameScore, FrameScorer, RecordedForecasts
from .observation import Feed, LocalFrame
from .rollouts import RecordedAction, assemble, empty_rollout

# render mode -> class, imported when an env first renders
RENDERERS = {
    "rgb_array": "mtp_bench.viz.drawing.birds_eye:EpisodePictures",
    "rerun": "mtp_bench.viz.rerun.recording:LiveRecording",
}
# starts the episode of a closed loop; named, because the traffic is a room above this
# one
_START_DRIVE = "mtp_bench.traffic:DrivenEpisode.start"


@dataclass
class Episode(ABC):
    """One pass through a scene: recorded, or a closed loop of the traffic."""

    scene: Scene  # in a closed loop the present frame alone until the loop ends
    frame: LocalFrame  # of the observations
    feed: Feed
    _: KW_ONLY
    # one per frame, in the scene's frame of reference
    actions: list[RecordedAction] = field(default_factory=list)
    drive: Drive | None = None  # record of a closed loop; None until it is over

    @property
    def frame_index(self) -> int:
        """Index of the frame that is shown, also the number of actions so far."""
        return len(self.actions)

    @property
    @abstractmethod
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit into an observation [F]."""

    @property
    @abstractmethod
    def over(self) -> bool:
        """True after the last frame."""

    @abstractmethod
    def record(self) -> Drive | None:
        """Return the drive of a closed loop until now, for pictures."""

    @abstractmethod
    def recording(self) -> tuple[Scene, Feed]:
        """Return the scene until now and its observations, for pictures."""

    @abstractmethod
    def observe(self) -> Observation:
        """Return fresh arrays of the frame that is shown."""

    @abstractmethod
    def class_counts(self, classes: int) -> Ints:
        """Count the shown detections of each class [C]."""

    @abstractmethod
    def take(self, action: RecordedAction) -> float:
        """Take the action for this frame and return its reward."""

    @abstractmethod
    def info(self) -> dict[str, Any]:
        """Return the ``info`` of the frame that is shown, see `frame_info`."""


def start_drive(
    card: Card, task: Task, scene: str, rng: np.random.Generator | None
) -> Episode:
    """Start a closed loop.

    Its scene is made while it is driven. ``rng`` moves the local frame at random.
    """
    start_episode: Callable[..., Episode] = resolve_name(_START_DRIVE)
    return start_episode(card, task, scene, rng)


def frame_info(
    frame: int, dropped: int, last_action: RecordedAction | None
) -> dict[str, Any]:
    """Return the numbers of ``info`` that do not derive from the truth.

    ``frame``: index of the frame that is shown; ``dropped``: number of its detections
    that did not fit; ``last_action``: that of the frame before, if there was one.
    """
    invalid = (
        np.zeros(3, dtype=np.int64) if last_action is None else last_action.invalid
    )
    return {
        "frame": frame,
        "dropped_detections": dropped,
        "invalid_tracks": int(invalid[0]),
        "invalid_hypotheses": int(invalid[1]),
        "invalid_objects": int(invalid[2]),
    }


@dataclass
class RecordedEpisode(Episode):
    """One pass through a recorded scene, from frame ``first`` to before ``end``.

    The actions before ``first`` are empty.
    """

    number: int  # index of the scene in `MTPEnv.scene_names`
    scorer: FrameScorer | None  # None in evaluation mode
    end: int
    first: int = 0
    # score of each action so far
    scores: list[FrameScore] = field(default_factory=list)

    @property
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit into an observation [F]."""
        return self.feed.dropped

    @property
    def over(self) -> bool:
        """True after the action for the last frame."""
        return self.frame_index == self.end

    def observe(self) -> Observation:
        """Return fresh arrays of the frame that is shown."""
        return self.feed.observe(self.frame_index)

    def class_counts(self, classes: int) -> Ints:
        """Count the shown detections of each class [C]."""
        return self.feed.class_counts(self.frame_index, classes)

    def past_observations(self, frames: int) -> tuple[Observation, ...]:
        """Return the observations of up to ``frames`` frames before the first one."""
        start = max(0, self.first - frames)
        return tuple(self.feed.observe(t) for t in range(start, self.first))

    def recording(self) -> tuple[Scene, Feed]:
        """Return the scene and its observations, for pictures."""
        return self.scene, self.feed

    def record(self) -> Drive | None:
        """Return None, as a recorded scene is not driven."""
        return self.drive

    def keep_target_frames(self, empty_action: RecordedAction) -> None:
        """Play only from the first frame with targets to the last.

        ``empty_action``: recorded for the frames before. Raises DataError for a scene
        without such a frame.
        """
        frames = np.zeros(0, dtype=np.int64)
        if self.scorer is not None:
            frames = np.flatnonzero(self.scorer.live)
        if not len(frames):
            raise DataError(
                f"scene {self.scene.name!r} has no frame that can hold a target, "
                f"expected one with target_frames=True; it has {self.scene.frames} "
                "frames: leave it out with scenes="
            )
        self.first = int(frames[0])
        self.end = int(frames[-1]) + 1
        self.actions += [empty_action] * self.first

    def score(self, action: RecordedAction) -> FrameScore:
        """Score an action for the frame that is shown.

        Zeros in evaluation mode.
        """
        if self.scorer is None:
            return FrameScore()
        forecasts = RecordedForecasts(
            np.full(len(action.object_box), self.frame_index),
            action.object_box,
            action.object_class,
            action.object_confidence,
            action.forecast,
            action.forecast_log_weight,
        )
        return self.scorer.score(self.frame_index, forecasts, action.malformed)

    def take(self, action: RecordedAction) -> float:
        """Take the action for this frame and return its reward."""
        score = self.score(action)
        self.actions.append(action)
        self.scores.append(score)
        return score.reward

    def info(self) -> dict[str, Any]:
        """Return numbers of this frame and of the action before.

        In its last step also those of the episode. In evaluation mode none of them
        derives from the truth.
        """
        dropped = 0 if self.over else int(self.feed.dropped[self.frame_index])
        last_action = self.actions[-1] if self.frame_index > self.first else None
        info = frame_info(self.frame_index, dropped, last_action)
        if self.scorer is None:
            return info
        score = FrameScore() if last_action is None else self.scores[-1]
        info |= {"scene": self.number, **vars(score)}
        if self.over:
            total = FrameScore.total(self.scores)
            fixed_error = total.error / max(total.targets, 1)
            info["episode_metrics"] = {**vars(total), "fixed_error": fixed_error}
        return info


@dataclass(frozen=True, eq=False)
class LiveEpisode:
    """Current episode.

    Every step appends to ``actions``.
    In evaluation mode no value derives from the truth.
    """

    card: Card
    # its detections are those that the agent is shown; its truth is empty if it must
    # not be seen
    scene: Scene
    # actions in the frames until now, in the scene's frame of reference
    actions: Sequence[RecordedAction]
    dropped: Ints  # [F] detections that did not fit into the observation
    drive: Drive | None = None  # the drive until now, in a closed loop

    @property
    def frame(self) -> int:
        """Index of the frame of the last action.

        0 before the first one.
        """
        return max(0, len(self.actions) - 1)

    def rollout(self, first: int = 0) -> Rollout:
        """Return the actions from frame ``first`` on as a rollout.

        Before any action it has one frame without rows.
        """
        actions = self.actions[first:]
        if not actions:
            return empty_rollout(self.scene.name)
        dropped = self.dropped[first : first + len(actions)]
        rollout = assemble(self.scene.name, actions, dropped)
        return replace(rollout, drive=self.drive)


def live_episode(card: Card, episode: Episode, evaluation: bool) -> LiveEpisode:
    """Return what renderers draw of an episode under the rules of ``card``.

    ``evaluation``: leave out the truth.
    """
    scene, feed = episode.recording()
    detections = Detections(
        start=np.asarray(feed.start),
        box=episode.frame.to_scene(feed.box.astype(np.float64)),
        # the measured velocity is in the local frame
        velocity=np.full((len(feed.box), 2), np.nan),
        class_id=feed.class_id,
        score=feed.score,
    )
    scene = replace(scene, detections=detections)
    drive = episode.record()
    if evaluation:
        no_boxes = np.zeros(len(scene.truth.box), dtype=bool)
        scene = replace(scene, truth=scene.truth.select(no_boxes), visible=None)
        drive = None
    return LiveEpisode(card, scene, episode.actions, feed.dropped, drive)


class Renderer(Protocol):
    """Drawing of an episode while it is played.

    One object serves all episodes of an env.
    """

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8] | None:
        """Draw the frame of the last action.

        Returns the picture [height, width, 3], if there is one.
        """

    def close(self) -> None:
        """Release what drawing opened."""
