"""The Gymnasium environment: one class for every card of ``envs/``.

The observation at frame t holds the detections of frame t only. The action holds hypotheses of tracks and forecasts
of objects as of frame t. ``step`` gives the reward of that action and the observation of frame t + 1.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Unpack, cast, final

import gymnasium
import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded

from ..cards import Card, changed_card, load_card, with_scenes
from ..errors import DataError, MtpBenchError, RolloutError
from ..scoring.definitions import DEFINITIONS
from ..scoring.forecasts import RecordedForecasts
from ..scoring.score import frame_error
from ..scoring.targets import Targets, find_targets
from ..sources import detected, open_source, with_tracks
from ..types import Action, Observation, Rollout, Scene, Task
from .arguments import EnvKeywords, checked, choose, own_scenes, require_room, size, wanted
from .checks import examine
from .feedback import Feedback
from .live import RENDERERS, LiveEpisode, Renderer, live_episode, open_renderer
from .observation import Feed, LocalFrame, make_feed
from .rollouts import RecordedAction, assemble, record_action
from .spaces import ActionSpace, action_numbers, observation_numbers, observation_space

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass
class _Episode:
    """One pass through a scene."""

    scene: Scene
    frame: LocalFrame
    feed: Feed
    targets: Targets | None  # None in evaluation mode
    actions: list[RecordedAction] = field(default_factory=list)  # one per frame, in the scene's frame of reference

    @property
    def t(self) -> int:
        return len(self.actions)

    @property
    def over(self) -> bool:
        return self.t == self.scene.frames


@final
class MTPEnv(gymnasium.Env[Observation, Action]):
    """Tracking and prediction of one log: detections in, hypotheses and forecasts out.

    ``card``: env id, path of a card (.toml), or a card. ``data``: data root. `EnvKeywords` lists the other
    keywords; ``scenes=[scene, ...]`` with `Scene` objects and ``files=folder`` play scenes of one's own under the rules
    of the card.

    Raises UnknownNameError, DataError or CardError (all MtpBenchError) for a wrong argument or missing data.
    """

    metadata = {  # noqa: RUF012  (declared so by gymnasium.Env)
        "render_modes": list(RENDERERS),
        "render_fps": 10,
        "definitions": DEFINITIONS,  # version of the scorer that makes the reward
    }

    def __init__(self, card: str | Card, data: str | None = None, **keywords: Unpack[EnvKeywords]) -> None:
        given = checked(data, keywords)
        self.render_mode = given["render_mode"]
        card = card if isinstance(card, Card) else load_card(card)
        own = own_scenes(given)
        card = card if own is None else with_scenes(card, own)
        self.card = changed_card(card, given["split"], given["detector"], given["detection_file"], given["files"])
        sizes = {"samples": self.card.task.samples, **self.card.size.model_dump()}
        sizes = {name: size(name, given[name], default) for name, default in sizes.items()}
        self.task = _task(self.card, given["observe"], sizes)
        require_room(self.card.id, sizes, "observation", observation_numbers(self.task))
        require_room(self.card.id, sizes, "action", action_numbers(self.task))
        self._evaluation, self._rigid_motion = given["evaluation"], given["rigid_motion"]
        self._fresh_noise = given["fresh_noise"]
        if self._fresh_noise and (self.card.detector is None or self._evaluation):
            raise MtpBenchError("fresh_noise is for training with a simulated detector, not for evaluation")
        self._feedback = Feedback(self.task) if given["strict"] else None
        self._source = open_source(self.card, data)
        if given["track_file"] is not None:
            self._source = with_tracks(self._source, self.card, data, given["track_file"])
        self.scene_names = choose(tuple(self._source.names), given["scenes"] if own is None else None)
        self.observation_space = cast("gymnasium.Space[Observation]", observation_space(self.task))
        self.action_space = cast("gymnasium.Space[Action]", ActionSpace(self.task))
        self._episode: _Episode | None = None
        self.metadata = {**type(self).metadata, "render_fps": max(1, round(self.card.task.rate))}
        self._live: LiveEpisode | None = None
        self._renderer: Renderer | None = None

    @property
    def scene(self) -> Scene:
        """The scene of this episode, truth included; in its own frame of reference."""
        return self._started().scene

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """First observation of a scene: the one that ``options={"scene": name}`` names, else one drawn at random."""
        super().reset(seed=seed)
        drawn = self.scene_names[int(self.np_random.integers(len(self.scene_names)))]
        scene = self._load(wanted(options or {}, self.scene_names, drawn))
        frame = LocalFrame.of(scene, self.np_random if self._rigid_motion else None)
        targets = None if self._evaluation else find_targets(scene, self.card)
        self._episode = _Episode(scene, frame, make_feed(scene, frame, self.task, self.card), targets)
        self._live = None
        self._render_each()
        return self._episode.feed.observe(0), _info(self._episode)

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take the action for the last observation and show the next frame; ``terminated`` after the last one.

        Nothing can follow the end of a log, so ``truncated`` is never true: no value may be bootstrapped there.
        With ``strict`` an action outside the action space is an ActionError, which leaves the frame as it was. Without,
        invalid rows are taken out of the action and counted in ``info``.
        """
        episode = self._started()
        if episode.over:
            raise ResetNeeded(f"step() after the last frame of {episode.scene.name!r}: call reset() first")
        examined = examine(action, self.task)
        if self._feedback is not None:
            self._feedback.give(examined, f"frame {episode.t}")
        seen = episode.feed.of_class(episode.t, len(self.task.classes))
        recorded = record_action(examined, self.task, episode.frame, seen)
        reward = 0.0 if episode.targets is None else self._reward(episode, episode.targets, recorded)
        episode.actions.append(recorded)
        self._render_each()
        return episode.feed.observe(episode.t), reward, episode.over, False, _info(episode)

    def rollout(self) -> Rollout:
        """All actions of this episode, in the scene's own frame of reference; RolloutError before its end."""
        episode = self._started()
        if not episode.over:
            raise RolloutError(
                f"scene {episode.scene.name!r} is at frame {episode.t} of {episode.scene.frames}:"
                " a rollout exists after the last frame"
            )
        return assemble(episode.scene.name, episode.actions, episode.feed.dropped)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the frame of the last action; before the first action, frame 0.

        ``rgb_array``: a bird's-eye picture [720, 960, 3], with true boxes unless in evaluation mode. ``rerun``: every
        frame is logged without this call, into rerun's active recording (`rerun.init`); returns
        None, as without a render mode.
        """
        if self.render_mode is None:
            logger.warn(f"render() without a render mode: make the env with one of {', '.join(RENDERERS)}")
            return None
        episode = self._started()
        if self._live is None:
            parts = (self.card, episode.scene, episode.frame, episode.feed, episode.actions)
            self._live = live_episode(*parts, self._evaluation)
        if self._renderer is None:
            self._renderer = open_renderer(self.render_mode)
        return self._renderer.render(self._live)

    def _render_each(self) -> None:
        """Render every frame in mode "rerun", as Gymnasium's "human" does."""
        if self.render_mode == "rerun":
            self.render()

    def close(self) -> None:
        """Close the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _started(self) -> _Episode:
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
            raise DataError(f"scene {name!r} of {self.card.id} has no frames, expected at least one")
        return scene

    def _reward(self, episode: _Episode, targets: Targets, action: RecordedAction) -> float:
        forecasts = RecordedForecasts(
            frame=np.full(len(action.object_box), episode.t),
            box=action.object_box,
            class_id=action.object_class,
            confidence=action.object_confidence,
            offset=action.forecast,
            log_weight=action.forecast_log_weight,
        )
        error = frame_error(episode.scene, targets, self.card, episode.t, forecasts, action.malformed)
        return 0.0 - error  # not -error: no -0.0


def _info(episode: _Episode) -> dict[str, Any]:
    """Integers with fixed keys: of the frame shown, and of the action for the one before."""
    t = episode.t
    invalid = episode.actions[-1].invalid if episode.actions else np.zeros(3, dtype=np.int64)
    return {
        "frame": t,
        "dropped_detections": 0 if episode.over else int(episode.feed.dropped[t]),
        "invalid_tracks": int(invalid[0]),
        "invalid_hypotheses": int(invalid[1]),
        "invalid_objects": int(invalid[2]),
    }


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
        tracker={name: section.model_dump() for name, section in card.tracker.items()},
        ego_motion=card.ego_motion,
        velocity=card.velocity,
        **sizes,
    )
