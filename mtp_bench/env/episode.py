"""One pass through a scene: its frames, the actions so far, and what ``info`` says of them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import DataError
from ..scoring.forecasts import RecordedForecasts
from ..scoring.frame import FrameScore, FrameScorer
from ..types import Drive, Ints, Observation, Scene
from .observation import Feed, LocalFrame
from .rollouts import RecordedAction


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
    scores: list[FrameScore] = field(default_factory=list)  # one per action that was taken
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

    def recording(self) -> tuple[Scene, Feed]:
        """The scene, and what the agent is shown of it, for pictures."""
        return self.scene, self.feed

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
        forecasts = RecordedForecasts(frame, *objects, action.forecast, action.forecast_log_weight)
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
        t = self.t
        acted = t > self.first
        invalid = self.actions[-1].invalid if acted else np.zeros(3, dtype=np.int64)
        info: dict[str, Any] = {
            "frame": t,
            "dropped_detections": 0 if self.over else int(self.feed.dropped[self.row]),
            "invalid_tracks": int(invalid[0]),
            "invalid_hypotheses": int(invalid[1]),
            "invalid_objects": int(invalid[2]),
        }
        if self.scorer is not None:
            info |= {"scene": self.number, **vars(self.scores[-1] if acted else FrameScore())}
            if self.over:
                total = FrameScore.total(self.scores)
                info["episode_metrics"] = {**vars(total), "fixed_error": total.error / max(total.targets, 1)}
        return info
