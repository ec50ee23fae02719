"""One pass through a scene: its frames, the actions so far, what ``info`` says of them, and what renderers draw."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pkgutil import resolve_name
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..core import DataError, Detections, Drive, Ints, Observation, Rollout, Scene, Task
from ..scoring import FrameScore, FrameScorer, RecordedForecasts
from .observation import Feed, LocalFrame
from .rollouts import RecordedAction, assemble, empty_rollout

RENDERERS = {  # render mode -> class, imported when an env first renders
    "rgb_array": "mtp_bench.viz.drawing.birds_eye:EpisodePictures",
    "rerun": "mtp_bench.viz.rerun.recording:LiveRecording",
}
# starts the episode of a closed loop; named, because the traffic is a room above this one
_START_DRIVE = "mtp_bench.traffic:DrivenEpisode.start"


class EpisodeLike(Protocol):
    """What `MTPEnv` needs of an episode: `Episode`, or a closed loop of the traffic."""

    @property
    def scene(self) -> Scene:
        """Scene that is played; of a closed loop, the frame of now until its end."""

    @property
    def frame(self) -> LocalFrame:
        """Local frame of reference of the observations."""

    @property
    def actions(self) -> Sequence[RecordedAction]:
        """Actions taken so far, in the scene's frame of reference."""

    @property
    def t(self) -> int:
        """Index of the frame that is shown."""

    @property
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit into an observation [F]."""

    @property
    def over(self) -> bool:
        """True after the action for the last frame."""

    @property
    def drive(self) -> Drive | None:
        """Drive of a closed loop that is over."""

    def record(self) -> Drive | None:
        """Return the drive of a closed loop until now, for pictures."""

    def recording(self) -> tuple[Scene, Feed]:
        """Return the scene until now and its observations, for pictures."""

    def observe(self) -> Observation:
        """Return fresh arrays of the frame that is shown."""

    def class_counts(self, classes: int) -> Ints:
        """Count the detections of each class [C] in the frame that is shown."""

    def take(self, action: RecordedAction) -> float:
        """Take the action for the frame that is shown and return its reward."""

    def info(self) -> dict[str, Any]:
        """Return the ``info`` of the frame that is shown, see `frame_info`."""


def start_drive(
    card: Card, task: Task, scene: str, number: int, rng: np.random.Generator | None
) -> EpisodeLike:
    """Start a closed loop; its scene is made while it is driven.

    ``number``: of the scene among `MTPEnv.scene_names`; ``rng`` moves the local frame at random.
    """
    start: Callable[..., EpisodeLike] = resolve_name(_START_DRIVE)
    return start(card, task, scene, number, rng)


def frame_info(
    frame: int, dropped: int, last_action: RecordedAction | None
) -> dict[str, Any]:
    """Return the numbers of ``info`` that do not derive from the truth."""
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
class Episode:
    """One pass through a scene, from frame ``first`` to the one before ``end``."""

    scene: Scene
    number: int  # of the scene among `MTPEnv.scene_names`
    frame: LocalFrame
    feed: Feed
    scorer: FrameScorer | None  # None in evaluation mode
    end: int
    first: int = 0
    # one per frame, in the scene's frame of reference; empty ones before ``first``
    actions: list[RecordedAction] = field(default_factory=list)
    scores: list[FrameScore] = field(
        default_factory=list
    )  # one per action that was taken
    drive: Drive | None = None  # of a closed loop that is over

    @property
    def t(self) -> int:
        """The frame that is shown."""
        return len(self.actions)

    @property
    def row(self) -> int:
        """The frame that is shown, in ``feed``."""
        return self.t

    @property
    def dropped(self) -> Ints:
        """Detections of each frame that did not fit into an observation [F]."""
        return self.feed.dropped

    def observe(self) -> Observation:
        """Fresh arrays of the frame that is shown."""
        return self.feed.observe(self.row)

    def class_counts(self, classes: int) -> Ints:
        """Count the detections of each class [C] in the frame that is shown."""
        return self.feed.of_class(self.row, classes)

    def past_observations(self, frames: int) -> tuple[Observation, ...]:
        """Return the observations of up to ``frames`` frames before the first one."""
        start = max(0, self.first - frames)
        return tuple(self.feed.observe(t) for t in range(start, self.first))

    def recording(self) -> tuple[Scene, Feed]:
        """The scene, and what the agent is shown of it, for pictures."""
        return self.scene, self.feed

    def record(self) -> Drive | None:
        """The drive of a closed loop until now, for pictures."""
        return self.drive

    @property
    def over(self) -> bool:
        """True after the action for the last frame."""
        return self.t == self.end

    def keep_target_frames(self, silence: RecordedAction) -> None:
        """Begin at the first frame that can hold a target, and end at the last one.

        ``silence``: the action of the frames before. Raises DataError for a scene without such a frame.
        """
        live = np.flatnonzero([] if self.scorer is None else self.scorer.live)
        if not len(live):
            raise DataError(
                f"scene {self.scene.name!r} has no frame that can hold a target, expected one with target_frames=True; "
                f"it has {self.scene.frames} frames: leave it out with scenes="
            )
        self.first, self.end = int(live[0]), int(live[-1]) + 1
        self.actions += [silence] * self.first

    def score(self, action: RecordedAction) -> FrameScore:
        """Score of an action for the frame that is shown; zeros in evaluation mode."""
        if self.scorer is None:
            return FrameScore()
        objects = action.object_box, action.object_class, action.object_confidence
        frame = np.full(len(action.object_box), self.t)
        forecasts = RecordedForecasts(
            frame, *objects, action.forecast, action.forecast_log_weight
        )
        return self.scorer.score(self.t, forecasts, action.malformed)

    def take(self, action: RecordedAction) -> float:
        """Take the action for the frame that is shown; its reward."""
        score = self.score(action)
        self.actions.append(action)
        self.scores.append(score)
        return score.reward

    def info(self) -> dict[str, Any]:
        """Numbers of the frame that is shown, and of the action before; of the episode in its last step.

        In evaluation mode none of them derives from the truth.
        """
        acted = self.t > self.first
        dropped = 0 if self.over else int(self.feed.dropped[self.row])
        info = frame_info(self.t, dropped, self.actions[-1] if acted else None)
        if self.scorer is not None:
            info |= {
                "scene": self.number,
                **vars(self.scores[-1] if acted else FrameScore()),
            }
            if self.over:
                total = FrameScore.total(self.scores)
                info["episode_metrics"] = {
                    **vars(total),
                    "fixed_error": total.error / max(total.targets, 1),
                }
        return info


@dataclass(frozen=True, eq=False)
class LiveEpisode:
    """The current episode; every step appends to ``actions``. In evaluation mode no value derives from the truth."""

    card: Card
    scene: Scene  # its detections are those that the agent is shown; its truth is empty if it must not be seen
    actions: Sequence[
        RecordedAction
    ]  # of the frames until now, in the scene's frame of reference
    dropped: Ints  # [F] detections that did not fit into the observation
    drive: Drive | None = None  # of a closed loop, until now

    @property
    def frame(self) -> int:
        """The frame of the last action; 0 before the first one."""
        return max(0, len(self.actions) - 1)

    def rollout(self, first: int = 0) -> Rollout:
        """Actions from frame ``first`` on, as a rollout that begins there; a frame without rows before any action."""
        actions = self.actions[first:]
        if not actions:
            return empty_rollout(self.scene.name)
        rollout = assemble(
            self.scene.name, actions, self.dropped[first : first + len(actions)]
        )
        return replace(rollout, drive=self.drive)


def live_episode(
    card: Card,
    scene: Scene,
    frame: LocalFrame,
    feed: Feed,
    actions: Sequence[RecordedAction],
    evaluation: bool,
) -> LiveEpisode:
    """The current episode of ``scene`` under the rules of ``card``.

    ``feed``: the agent's detections, in the local ``frame``; ``actions``: so far; ``evaluation``: leave out the truth.
    """
    seen = Detections(
        start=np.asarray(feed.start),
        box=frame.to_scene(feed.box.astype(np.float64)),
        velocity=np.full(
            (len(feed.box), 2), np.nan
        ),  # the measured one is in the local frame
        class_id=feed.class_id,
        score=feed.score,
    )
    shown = replace(scene, detections=seen)
    if evaluation:
        hidden = np.zeros(len(scene.truth.box), dtype=bool)
        shown = replace(shown, truth=scene.truth.select(hidden), visible=None)
    return LiveEpisode(card, shown, actions, feed.dropped)


class Renderer(Protocol):
    """Drawing of an episode while it is played; one object serves all episodes of an env."""

    def render(self, episode: LiveEpisode) -> NDArray[np.uint8] | None:
        """Draw the frame that was answered last; returns the picture [height, width, 3], if there is one."""

    def close(self) -> None:
        """Release what drawing has opened."""
