"""A stored run, the card it was made for and the source of its scenes: where scores, lists and pictures start."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from .._bundle import card_ids
from ..cards import Card, changed_card, load_card, parse_card
from ..env.observation import shown_boxes
from ..errors import RolloutError, UnknownNameError
from ..sources import CameraImage, SceneSource, camera_images, open_source, with_map, with_tracks
from ..types import Rollout, Scene
from .options import CHANGES
from .rollout_files import Run, RunInfo, load_run


@dataclass(frozen=True, eq=False)
class OpenedRun:
    """A stored run, checked, and where its scenes come from."""

    folder: Path
    run: Run
    card: Card  # with the run's own split and detector
    source: SceneSource
    data: str | None  # root that the scenes come from

    def rollouts(self, scene: str | None = None) -> Sequence[Rollout]:
        """All rollouts, or that of one scene; raises UnknownNameError where the run has none of it."""
        if scene is None:
            return self.run.rollouts
        chosen = [rollout for rollout in self.run.rollouts if rollout.scene == scene]
        if not chosen:
            raise UnknownNameError(f"scene of {self.folder}", scene, [rollout.scene for rollout in self.run.rollouts])
        return chosen

    def first(self, scene: str | None = None) -> Rollout:
        """The rollout of ``scene``, or the first there is; raises RolloutError where there is none."""
        rollouts = self.rollouts(scene)
        if not rollouts:
            raise RolloutError(f"{self.folder}: holds no scene; run the agent again")
        return rollouts[0]

    def scene(self, name: str) -> Scene:
        """The scene of this name with the boxes that the agent was shown as its detections: see `shown_boxes`.

        Raises UnknownNameError where the source has none of this name, and DataError where stored tracks are gone.
        """
        scene, info = self.recorded(name), self.run.info
        if info.observe == "tracks":
            file = _text(self.folder, info, "track_file")
            if file is None:
                raise RolloutError(f"{self.folder}: does not say where the stored tracks are that its agent was given")
            scene = with_tracks(self.source, self.card, self.data, file).load(name)
        return replace(scene, detections=shown_boxes(scene, info.observe)[0])

    def drawn(self, name: str, note: Callable[[str], object] = lambda text: None) -> Scene:
        """The `scene` of this name as pictures show it, with its road; ``note`` is told where its map is broken."""
        return with_map(self.scene(name), self.card, self.data, note)

    def images(self, scene: Scene, note: Callable[[str], object] = lambda text: None) -> tuple[CameraImage, ...]:
        """The camera images of a scene, where they are there; ``note`` is told where a table of them is broken."""
        return camera_images(scene, self.card, self.data, note)

    def recorded(self, name: str) -> Scene:
        """The scene of this name as its source has it: what is scored, whatever the agent was shown.

        Raises UnknownNameError where the source has none of this name.
        """
        if name not in self.source.names:
            raise UnknownNameError(f"scene of {self.folder}", name, self.source.names)
        return self.source.load(name)


def open_run(folder: Path, data: str | None = None, env: str | Card | None = None) -> OpenedRun:
    """The run stored in ``folder``, by the card that it keeps; ``env``: id, path or card, where another one is meant.

    Raises RolloutError where the run was made for another version of the card, or says other things than its rollouts,
    and DataError where its data is missing.
    """
    run = load_run(folder)
    card = _card(folder, run, env)
    _check(folder, run)
    return OpenedRun(folder, run, card, open_source(card, data), data)


def _card(folder: Path, run: Run, env: str | Card | None) -> Card:
    """The card that the run was made for, by its digest."""
    info = run.info
    if env is None and info.card is not None:
        card = parse_card(info.card, f"{folder}, card")
    else:
        if env is None and info.env_id not in card_ids():
            raise RolloutError(
                f"{folder}: made for {info.env_id!r}, which does not ship here; name its card with --env"
            )
        card = env if isinstance(env, Card) else load_card(env or info.env_id)
        if card.digest != info.card_digest:
            card = changed_card(card, *(_text(folder, info, key) for key in CHANGES))
    if card.digest != info.card_digest:
        raise RolloutError(
            f"{folder}: made for {info.env_id} with card digest {info.card_digest}, {card.id} now has {card.digest}; "
            "run the agent again"
        )
    return card


def _text(folder: Path, info: RunInfo, key: str) -> str | None:
    value = info.keywords.get(key)
    if value is not None and not isinstance(value, str):
        raise RolloutError(f"{folder}: {key} is {value!r}, expected a name")
    return value


def _check(folder: Path, run: Run) -> None:
    """Raise RolloutError where what the run says of itself is not what its rollouts hold."""
    for rollout in run.rollouts:
        if rollout.forecast.shape[1] != run.info.samples:
            raise RolloutError(
                f"{folder}: says {run.info.samples} samples per object, scene {rollout.scene!r} has "
                f"{rollout.forecast.shape[1]}; run the agent again"
            )
    scene, count = Counter(rollout.scene for rollout in run.rollouts).most_common(1)[0] if run.rollouts else ("", 0)
    if count > 1:
        raise RolloutError(f"{folder}: names scene {scene!r} {count} times, expected once; run the agent again")
