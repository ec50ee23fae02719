"""The Gymnasium environment: one class for every card of ``envs/``.

The observation at frame t holds the detections of frame t only. The action holds hypotheses of tracks and forecasts
of objects as of frame t. ``step`` gives the reward of that action and the observation of frame t + 1.
"""

from dataclasses import replace
from pkgutil import resolve_name
from typing import Any, Unpack, cast, final

import gymnasium
import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from ..agent import examine
from ..cards import CHANGES, Card, changed_card, load_card, with_scenes
from ..core import (
    Action,
    DataError,
    MtpBenchError,
    Observation,
    Rollout,
    RolloutError,
    Scene,
    Task,
)
from ..scoring import DEFINITIONS, FrameScorer
from ..sources import detected, open_source, with_tracks
from .arguments import (
    EnvKeywords,
    checked,
    choose,
    own_scenes,
    require_room,
    size,
    wanted,
)
from .episode import (
    RENDERERS,
    Episode,
    EpisodeLike,
    LiveEpisode,
    Renderer,
    live_episode,
    start_drive,
)
from .feedback import Feedback
from .observation import LocalFrame, make_feed
from .rollouts import RecordedAction, assemble, record_action
from .spaces import ActionSpace, action_numbers, observation_numbers, observation_space


@final
class MTPEnv(gymnasium.Env[Observation, Action]):
    """Tracking and prediction of one log: detections in, hypotheses and forecasts out.

    ``card``: env id, path of a card (.toml), or a card. ``data``: data root. `EnvKeywords` lists the other
    keywords; ``scenes=[scene, ...]`` with `Scene` objects and ``files=folder`` play own scenes by the card's rules.

    Raises UnknownNameError, DataError or CardError (all MtpBenchError) for a wrong argument or missing data.
    """

    metadata = {  # noqa: RUF012  (declared so by gymnasium.Env)
        "render_modes": list(RENDERERS),
        "render_fps": 10,
        "definitions": DEFINITIONS,  # version of the scorer that makes the reward
    }

    def __init__(
        self, card: str | Card, data: str | None = None, **keywords: Unpack[EnvKeywords]
    ) -> None:
        given = checked(data, keywords)
        self.render_mode = given["render_mode"]
        card = card if isinstance(card, Card) else load_card(card)
        own = own_scenes(given)
        card = card if own is None else with_scenes(card, own)
        self.card = changed_card(card, **{name: given[name] for name in CHANGES})
        sizes = {"samples": self.card.task.samples, **self.card.size.model_dump()}
        sizes = {
            name: size(name, given[name], default) for name, default in sizes.items()
        }
        self.task = _task(self.card, given["observe"], sizes)
        require_room(self.card.id, sizes, "observation", observation_numbers(self.task))
        require_room(self.card.id, sizes, "action", action_numbers(self.task))
        self._evaluation, self._rigid_motion = (
            given["evaluation"],
            given["rigid_motion"],
        )
        self._fresh_noise = given["fresh_noise"]
        if self._fresh_noise and (self.card.detector is None or self._evaluation):
            raise MtpBenchError(
                "fresh_noise is for training with a simulated detector, not for evaluation"
            )
        self._target_frames = given["target_frames"]
        if self._target_frames and self._evaluation:
            raise MtpBenchError(
                "target_frames is for training, not for evaluation: a score needs every frame"
            )
        for name in ("fresh_noise", "target_frames", "track_file"):
            if given[name]:
                self.card.require_same_scenes(f"which takes no {name}", "leave it out")
        self._feedback = Feedback(self.task) if given["strict"] else None
        self._source = open_source(self.card, data)
        if given["track_file"] is not None:
            self._source = with_tracks(
                self._source, self.card, data, given["track_file"]
            )
        self.scene_names = choose(
            tuple(self._source.names), given["scenes"] if own is None else None
        )
        self.observation_space = cast(
            "gymnasium.Space[Observation]", observation_space(self.task)
        )
        self.action_space = cast("gymnasium.Space[Action]", ActionSpace(self.task))
        self._episode: EpisodeLike | None = None
        self._past: tuple[Observation, ...] = ()
        self.metadata = {
            **type(self).metadata,
            "render_fps": max(1, round(self.card.task.rate)),
        }
        self._live: LiveEpisode | None = None
        self._renderer: Renderer | None = None

    @property
    def scene(self) -> Scene:
        """The scene of this episode, truth included; in its own frame of reference."""
        return self._started().scene

    @property
    def scene_name(self) -> str:
        """The name of the scene of this episode: ``scene_names[info["scene"]]``."""
        return self.scene.name

    @property
    def past(self) -> tuple[Observation, ...]:
        """Observations [P - 1] of the frames before the first one of the episode; none unless ``target_frames``."""
        self._started()
        return self._past

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """First observation of a scene: the one that ``options={"scene": name}`` names, else one drawn at random."""
        super().reset(seed=seed)
        drawn = self.scene_names[int(self.np_random.integers(len(self.scene_names)))]
        name = wanted(options or {}, self.scene_names, drawn)
        number, rng = (
            self.scene_names.index(name),
            self.np_random if self._rigid_motion else None,
        )
        self._past = ()
        if self.card.drive is not None:
            return self._begin(start_drive(self.card, self.task, name, number, rng))
        scene = self._load(name)
        frame = LocalFrame.of(scene, rng)
        scorer = None if self._evaluation else FrameScorer(scene, self.card)
        episode = Episode(
            scene,
            number,
            frame,
            make_feed(scene, frame, self.task, self.card),
            scorer,
            scene.frames,
        )
        if self._target_frames:
            episode.keep_target_frames(
                record_action(examine(None, self.task), self.task)
            )
            self._past = episode.past_observations(self.task.past - 1)
        return self._begin(episode)

    def _begin(self, episode: EpisodeLike) -> tuple[Observation, dict[str, Any]]:
        self._episode, self._live = episode, None
        self._render_each()
        return episode.observe(), episode.info()

    def step(
        self, action: Action
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take the action for the last observation and show the next frame; ``terminated`` after the last one.

        Nothing can follow the end of a log, so ``truncated`` is never true: no value may be bootstrapped there.
        With ``strict`` an action outside the action space is an ActionError, which leaves the frame as it was. Without,
        invalid rows are taken out of the action and counted in ``info``.
        """
        episode = self._started()
        reward = episode.take(self._recorded(episode, action))
        self._render_each()
        return (
            episode.observe(),
            0.0 if self._evaluation else reward,
            episode.over,
            False,
            episode.info(),
        )

    def reward_of(self, action: Action) -> float:
        """The reward that an action for the last observation would have, without a step; CardError in a closed loop."""
        episode = self._started()
        self.card.require_same_scenes(
            "whose rewards are known after the step alone", "step() returns them"
        )
        assert isinstance(episode, Episode)  # of a recorded scene
        return episode.score(self._recorded(episode, action)).reward

    def rollout(self) -> Rollout:
        """All actions of this episode, in the scene's own frame of reference; RolloutError before its end."""
        episode = self._started()
        if self._target_frames:
            raise RolloutError(
                "an episode with target_frames=True is a part of a scene, expected a whole one"
            )
        if not episode.over:
            raise RolloutError(
                f"scene {episode.scene.name!r} is at frame {episode.t} of {episode.scene.frames}:"
                " a rollout exists after the last frame"
            )
        return replace(
            assemble(episode.scene.name, episode.actions, episode.dropped),
            drive=episode.drive,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the frame of the last action; before the first action, frame 0.

        ``rgb_array``: a bird's-eye picture [720, 960, 3], with true boxes unless in evaluation mode. ``rerun``: every
        frame is logged without this call, into rerun's active recording (`rerun.init`); None, as without a mode.
        """
        if self.render_mode is None:
            logger.warn(
                f"render() without a render mode: make the env with one of {', '.join(RENDERERS)}"
            )
            return None
        episode = self._started()
        if self._live is None or self.card.drive is not None:
            scene, feed = episode.recording()
            live = live_episode(
                self.card, scene, episode.frame, feed, episode.actions, self._evaluation
            )
            self._live = replace(
                live, drive=None if self._evaluation else episode.record()
            )
        renderer = self._renderer or resolve_name(RENDERERS[self.render_mode])()
        self._renderer = renderer
        return renderer.render(self._live)

    def _render_each(self) -> None:
        """Render every frame in mode "rerun", as Gymnasium's "human" does."""
        if self.render_mode == "rerun":
            self.render()

    def close(self) -> None:
        """Close the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _started(self) -> EpisodeLike:
        if self._episode is None:
            raise ResetNeeded("no scene yet: call reset() first")
        return self._episode

    def _load(self, name: str) -> Scene:
        if self._episode is not None and self._episode.scene.name == name:
            scene = self._episode.scene
        else:
            scene = self._source.load(name)
        if self._fresh_noise:
            scene = detected(scene, self.card, int(self.np_random.integers(2**62)))
        if scene.frames == 0:
            raise DataError(
                f"scene {name!r} of {self.card.id} has no frames, expected at least one"
            )
        return scene

    def _recorded(self, episode: EpisodeLike, action: Action) -> RecordedAction:
        """The sound part of an action for the frame that is shown."""
        if episode.over:
            raise ResetNeeded(
                f"step() after the last frame of {episode.scene.name!r}: call reset() first"
            )
        examined = examine(action, self.task)
        if self._feedback is not None:
            self._feedback.give(examined, f"frame {episode.t}")
        seen = episode.class_counts(len(self.task.classes))
        return record_action(examined, self.task, episode.frame, seen)


def _task(card: Card, observe: str, sizes: dict[str, int]) -> Task:
    return Task(
        env_id=card.id,
        classes=card.task.classes,
        dt=1.0 / card.task.rate,
        past=card.task.past,
        future=card.task.future,
        k=min(card.task.samples, sizes["samples"]),
        detector=card.detector_name,
        observe=observe,
        motion_noise=card.motion_noise or "",
        weights_of=card.weights_of or "",
        presence=card.presence or "",
        tracker={name: section.model_dump() for name, section in card.tracker.items()},
        ego_motion=card.source.traits.common_frame,
        velocity=card.velocity,
        lanes=card.lanes.pieces if card.lanes else 0,
        lane_points=card.lanes.points if card.lanes else 0,
        **sizes,
    )
