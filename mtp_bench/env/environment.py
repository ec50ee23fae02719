"""The Gymnasium environment: one class for every card of ``envs/``.

The observation at frame t holds the detections of frame t only. The action holds
hypotheses of tracks and forecasts of objects as of frame t. ``step`` gives the reward
of that action and the observation of frame t + 1.
"""

from dataclasses import replace
from pkgutil import resolve_name
from typing import Any, Unpack, cast, final

import gymnasium
import numpy as np
from gymnasium import logger
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from ..agent import check_action
from ..cards import Card, CardChanges, ChangeKeywords, load_card, with_scenes
from ..core import (
    Action,
    DataError,
    Observation,
    Rollout,
    RolloutError,
    Scene,
    Task,
)
from ..scoring import DEFINITIONS, FrameScorer
from ..sources import detected, open_source, perturbed, with_tracks
from .arguments import (
    EnvKeywords,
    check_keywords,
    choose_scenes,
    chosen_sizes,
    own_scenes,
    require_room,
    require_training,
    scene_option,
)
from .episode import (
    RENDERERS,
    Episode,
    LiveEpisode,
    RecordedEpisode,
    Renderer,
    live_episode,
    start_drive,
)
from .feedback import Feedback
from .observation import LocalFrame, make_feed
from .rollouts import RecordedAction, assemble, record_action
from .spaces import ActionSpace, action_numbers, observation_numbers, observation_space

_MAX_SEED = 2**62
_KEPT_SCENES = 16  # some 40 MiB


@final
class MTPEnv(gymnasium.Env[Observation, Action]):
    """Tracking and prediction of one log: detections in, hypotheses and forecasts out.

    ``card``: env id, path of a card (.toml), or a card. ``data``: data root.
    `EnvKeywords` lists the other keywords; ``scenes=[scene, ...]`` with `Scene` objects
    and ``files=folder`` play own scenes by the card's rules.

    Raises UnknownNameError, DataError or CardError (all MtpBenchError) for a wrong
    argument or missing data.
    """

    metadata = {  # noqa: RUF012  (declared so by gymnasium.Env)
        "render_modes": list(RENDERERS),
        "render_fps": 10,
        "definitions": DEFINITIONS,  # version of the scorer that makes the reward
    }

    def __init__(
        self, card: str | Card, data: str | None = None, **keywords: Unpack[EnvKeywords]
    ) -> None:
        values = check_keywords(data, keywords)
        self.render_mode = values["render_mode"]
        if not isinstance(card, Card):
            card = load_card(card)
        scenes = own_scenes(values)
        if scenes is not None:
            card = with_scenes(card, scenes)
        changes = {name: values[name] for name in ChangeKeywords.__annotations__}
        self.card = CardChanges(**changes).apply(card)
        self.task = _make_task(self.card, values)
        require_training(self.card, values)
        self._evaluation: bool = values["evaluation"]
        self._rigid_motion: bool = values["rigid_motion"]
        self._fresh_noise: bool = values["fresh_noise"]
        self._target_frames: bool = values["target_frames"]
        self._feedback = Feedback(self.task) if values["strict"] else None
        self._source = open_source(self.card, data)
        tracks = values["tracks"]
        if tracks is not None:
            self._source = with_tracks(self._source, self.card, data, tracks)
        chosen = values["scenes"] if scenes is None else None
        self.scene_names = choose_scenes(tuple(self._source.names), chosen)
        self.observation_space = cast(
            "gymnasium.Space[Observation]", observation_space(self.task)
        )
        self.action_space = cast("gymnasium.Space[Action]", ActionSpace(self.task))
        frames_per_second = max(1, round(self.card.task.rate))
        self.metadata = {**type(self).metadata, "render_fps": frames_per_second}
        self._episode: Episode | None = None
        self._kept: dict[str, tuple[Scene, FrameScorer | None]] = {}  # the newest last
        self._past: tuple[Observation, ...] = ()
        self._live: LiveEpisode | None = None
        self._renderer: Renderer | None = None

    @property
    def scene(self) -> Scene:
        """Scene of this episode, truth included.

        In its own frame of reference.
        """
        return self._started().scene

    @property
    def scene_name(self) -> str:
        """Name of the scene of this episode: ``scene_names[info["scene"]]``."""
        return self.scene.name

    @property
    def varies(self) -> bool:
        """True if two episodes of one scene may differ before the first action."""
        is_driven = self.card.drive is not None
        return self._rigid_motion or self._fresh_noise or is_driven

    @property
    def past(self) -> tuple[Observation, ...]:
        """Observations [P - 1] of the frames before the episode.

        Empty without ``target_frames``.
        """
        self._started()
        return self._past

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Return the first observation of a scene.

        ``options={"scene": name}`` names the scene; else it is drawn at random.
        """
        super().reset(seed=seed)
        # drawn in any case: a named scene does not change the random numbers after it
        number = int(self.np_random.integers(len(self.scene_names)))
        name = scene_option(options or {}, self.scene_names)
        if name is not None:
            number = self.scene_names.index(name)
        rng = self.np_random if self._rigid_motion else None
        self._past = ()
        self._live = None
        if self.card.drive is None:
            self._episode = self._start_episode(number, rng)
        else:
            name = self.scene_names[number]
            self._episode = start_drive(self.card, self.task, name, rng)
        self._render_each()
        return self._episode.observe(), self._episode.info()

    def _start_episode(self, number: int, rng: np.random.Generator | None) -> Episode:
        """Start an episode of a recorded scene.

        ``rng`` moves its local frame.
        """
        scene, scorer = self._open(self.scene_names[number])
        frame = LocalFrame.of(scene, rng)
        feed = make_feed(scene, frame, self.task, self.card)
        episode = RecordedEpisode(scene, frame, feed, number, scorer, scene.frames)
        if self._target_frames:
            empty_action = record_action(check_action(None, self.task), self.task)
            episode.keep_target_frames(empty_action)
            self._past = episode.past_observations(self.task.past - 1)
        return episode

    def step(
        self, action: Action
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Take the action for the last observation and show the next frame.

        ``terminated`` after the last one. Nothing can follow the end of a log, so
        ``truncated`` is never true: no value may be bootstrapped there. With ``strict``
        an action outside the action space is an ActionError, which leaves the frame as
        it was. Without, invalid rows are taken out of the action and counted in
        ``info``.
        """
        episode = self._started()
        reward = episode.take(self._recorded(episode, action))
        self._render_each()
        if self._evaluation:
            reward = 0.0
        return episode.observe(), reward, episode.over, False, episode.info()

    def reward_of(self, action: Action) -> float:
        """Return the reward that an action would have, without a step.

        Raises CardError in a closed loop.
        """
        episode = self._started()
        self.card.require_same_scenes(
            "whose rewards are known after the step alone", "step() returns them"
        )
        assert isinstance(episode, RecordedEpisode)
        return episode.score(self._recorded(episode, action)).reward

    def rollout(self) -> Rollout:
        """Return all actions of this episode, in the scene's frame.

        Raises RolloutError before its end.
        """
        episode = self._started()
        if self._target_frames:
            raise RolloutError(
                "an episode with target_frames=True is a part of a scene, "
                "expected a whole one"
            )
        scene = episode.scene
        if not episode.over:
            raise RolloutError(
                f"scene {scene.name!r} is at frame {episode.frame_index} of "
                f"{scene.frames}: a rollout exists after the last frame"
            )
        rollout = assemble(scene.name, episode.actions, episode.dropped)
        return replace(rollout, drive=episode.drive)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the frame of the last action.

        Before the first action, frame 0.
        ``rgb_array``: a bird's-eye picture [720, 960, 3], with true boxes unless in
        evaluation mode. ``rerun``: every frame is logged without this call, into
        rerun's active recording (`rerun.init`); None, as without a mode.
        """
        if self.render_mode is None:
            logger.warn(
                "render() without a render mode: "
                f"make the env with one of {', '.join(RENDERERS)}"
            )
            return None
        episode = self._started()
        # ``_live`` shares the list of actions; a closed loop also adds frames
        if self._live is None or self.card.drive is not None:
            self._live = live_episode(self.card, episode, self._evaluation)
        if self._renderer is None:
            make_renderer = resolve_name(RENDERERS[self.render_mode])
            self._renderer = cast(Renderer, make_renderer())
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

    def _started(self) -> Episode:
        if self._episode is None:
            raise ResetNeeded("no scene yet: call reset() first")
        return self._episode

    def _open(self, name: str) -> tuple[Scene, FrameScorer | None]:
        """Return a scene and the scorer of its frames.

        The last ones stay open: training plays the same scenes again and again.
        """
        scene, scorer = self._kept.pop(name, (None, None))
        if scene is None:
            scene = self._source.load(name)
            if scene.frames == 0:
                raise DataError(
                    f"scene {name!r} of {self.card.id} has no frames, "
                    "expected at least one"
                )
            scorer = self._scorer(scene)
        self._kept[name] = scene, scorer
        if len(self._kept) > (1 if self._evaluation else _KEPT_SCENES):
            del self._kept[next(iter(self._kept))]  # the oldest
        if self._fresh_noise:
            seed = int(self.np_random.integers(_MAX_SEED))
            fresh = detected(scene, self.card, seed)
            if fresh is not scene:  # stored detections are as the source gives them
                scene = perturbed(fresh, self.card)
                scorer = self._scorer(scene)
        return scene, scorer

    def _scorer(self, scene: Scene) -> FrameScorer | None:
        return None if self._evaluation else FrameScorer(scene, self.card)

    def _recorded(self, episode: Episode, action: Action) -> RecordedAction:
        """Return the sound part of an action.

        Raises ResetNeeded after the end, and ActionError in a strict env.
        """
        if episode.over:
            raise ResetNeeded(
                f"step() after the last frame of {episode.scene.name!r}: "
                "call reset() first"
            )
        checked = check_action(action, self.task)
        if self._feedback is not None:
            self._feedback.give(checked, f"frame {episode.frame_index}")
        detections = episode.class_counts(len(self.task.classes))
        return record_action(checked, self.task, episode.frame, detections)


def _make_task(card: Card, values: dict[str, Any]) -> Task:
    """Return the task of a card, with the sizes and the input that keywords choose.

    Raises MtpBenchError for a wrong or too large size.
    """
    defaults = {"samples": card.task.samples, **card.size.model_dump()}
    sizes = chosen_sizes(values, defaults)
    task = Task(
        env_id=card.id,
        classes=card.task.classes,
        dt=1.0 / card.task.rate,
        past=card.task.past,
        future=card.task.future,
        k=min(card.task.samples, sizes["samples"]),
        detector=card.detector_name,
        observe=values["observe"],
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
    require_room(card.id, sizes, "observation", observation_numbers(task))
    require_room(card.id, sizes, "action", action_numbers(task))
    return task
