"""Event weights of an env: the frozen file of a shipped card, or made here from the scenes at hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._bundle import bundled, card_ids
from ..agent import Agent
from ..cards import Card, load_card
from ..env.environment import MTPEnv
from ..env.observation import LocalFrame, make_feed
from ..env.rollouts import ARRAYS
from ..errors import CardError, DataError, UnknownNameError
from ..files import require_file
from ..parallel import parallel_map
from ..scoring import score_scene
from ..scoring.definitions import DEFINITIONS
from ..scoring.neutral import evaluated
from ..scoring.targets import find_targets
from ..scoring.weights import Reference, SceneWeights, count_runs, scene_key
from ..scoring.weights import tracking_events as events_of
from ..scoring.weights_file import read_reference, write_reference
from ..submission.loader import Submission, load_submission
from ..types import Bools, Rollout, Scene, Task, starts_of
from .options import DEFAULTS, RunOptions
from .perturbation import (
    ASSIGNMENTS,
    RUNS,
    MatchedDetections,
    Perturbation,
    assignment_of,
    fit_perturbation,
    matched_detections,
    perturbed,
)
from .run import run_scene

_AT_ONCE = 12  # runs of a scene that one worker makes in one go: long scenes must not be waited for


def frozen_path(env_id: str) -> Path:
    """Where the frozen event weights of an env are, if there are any."""
    return bundled("envs") / "reference" / f"{env_id}.json"


def frozen_reference(card: Card) -> Reference | None:
    """The frozen event weights of ``card``; None where there are none, as for a card that is not the shipped one.

    Raises DataError where the file is broken or of other definitions.
    """
    path = frozen_path(card.id)
    if not path.is_file():
        return None
    reference = read_reference(path)
    if reference.env != card.id:
        raise DataError(f"{path}: env is {reference.env!r}, expected {card.id!r}")
    return replace(reference, frozen=True) if reference.card == card.digest else None


def ranked_scenes(card: Card, names: Sequence[str]) -> tuple[str, ...]:
    """Those of the scenes of a split that have frozen event weights, all of them where none has.

    Whoever has more scenes than were there when weights were frozen, such as all 138 of nuScenes' split ``val``, runs
    those that everybody else is ranked on.
    """
    frozen = frozen_reference(card)
    return tuple(name for name in names if frozen is not None and frozen.holds([name])) or tuple(names)


def reference_for(card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS) -> Reference:
    """The frozen event weights of ``card`` where they hold these scenes, else weights made from these scenes.

    ``card``: with all changes. ``options``: data, workers and progress. Raises DataError where the frozen file is
    broken.
    """
    frozen = frozen_reference(card)
    return frozen if frozen is not None and frozen.holds(scenes) else make_reference(card, scenes, options)


def freeze(env_id: str, options: RunOptions = DEFAULTS) -> tuple[Path, Reference]:
    """Make the event weights of a shipped env from all its scenes and write them; their path and what they are.

    Raises UnknownNameError for the path of a card: its weights would be found by no one.
    """
    if env_id not in card_ids():
        raise UnknownNameError("environment", env_id, card_ids(), "only those that ship have frozen event weights")
    card, path = load_card(env_id), frozen_path(env_id)
    path.parent.mkdir(exist_ok=True)
    require_file(path)
    reference = make_reference(card, MTPEnv(card, data=options.data).scene_names, options)
    write_reference(path, reference)
    return path, replace(reference, frozen=True)


def make_reference(
    card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS, seeds: Sequence[int] = range(RUNS)
) -> Reference:
    """Event weights from runs of the card's reference baseline on ``scenes``, one per seed.

    Raises CardError where that baseline cannot be told how to assign and to make no forecasts.
    """
    submission = load_submission(card.reference)
    parts = [seeds[low : low + _AT_ONCE] for low in range(0, len(seeds), _AT_ONCE)]
    options.progress.started(len(scenes) * (1 + len(parts)))
    plain: list[_Plain] = parallel_map(
        _plain_run,
        [(card, options.data, name, submission) for name in scenes],
        options.workers,
        lambda place: options.progress.done(scenes[place]),
    )
    perturbation = fit_perturbation([one.detections for one in plain], len(card.task.classes))
    calls = [(card, options.data, name, submission, perturbation, part) for name in scenes for part in parts]
    counts: list[NDArray[np.uint8]] = parallel_map(
        _perturbed_runs, calls, options.workers, lambda place: options.progress.done(scenes[place // len(parts)])
    )
    per_scene = [counts[low : low + len(parts)] for low in range(0, len(calls), len(parts))]
    return Reference(
        env=card.id,
        card=card.digest,
        definitions=DEFINITIONS,
        agent=submission.name,
        runs=len(seeds),
        parameters=perturbation.parameters(card.task.classes, seeds),
        scenes={
            scene_key(card.id, name): SceneWeights(np.stack(of_parts).sum(axis=0, dtype=np.uint8), *one.of_scene)
            for name, one, of_parts in zip(scenes, plain, per_scene, strict=True)
        },
    )


@dataclass(frozen=True, eq=False)
class _Plain:
    """What the run of the reference as it is, without cut and noise, says of a scene."""

    detections: MatchedDetections
    of_scene: tuple[Bools, tuple[int, int, int], int, int]  # fields of `SceneWeights` but the counts


def _plain_run(card: Card, data: str | None, name: str, submission: Submission) -> _Plain:
    env = MTPEnv(card, data=data, evaluation=True)
    rollout = run_scene(submission.build(env.task), env, name, 0, submission.name)
    scene = env.scene
    events = events_of(scene, rollout, card)
    ids, lost, reacquired = events[~evaluated(scene).truth.neutral].sum(axis=0).tolist()
    score, flags = score_scene(scene, rollout, card), events[find_targets(scene, card).row]
    said = (flags, (ids, lost, reacquired), score.false_forecasts, score.forecasts)
    return _Plain(matched_detections(scene, card), said)


def _perturbed_runs(
    card: Card, data: str | None, name: str, submission: Submission, perturbation: Perturbation, runs: Sequence[int]
) -> NDArray[np.uint8]:
    """Counts [n, 4] of the events of some runs on the targets of a scene."""
    env = MTPEnv(card, data=data, samples=1, hypotheses=1, objects=1, evaluation=True)
    env.reset(options={"scene": name})
    scene, row = env.scene, find_targets(env.scene, card).row
    agents = {assignment: _tracker(submission, env.task, assignment) for assignment in ASSIGNMENTS}
    rollouts = (track(agents[assignment_of(run)], perturbed(scene, perturbation, run), env.task) for run in runs)
    return count_runs((events_of(scene, rollout, card)[row] for rollout in rollouts), len(row))


def _tracker(submission: Submission, task: Task, assignment: str) -> Agent:
    """The reference baseline with this assignment, without forecasts."""
    try:
        return submission.build(task, assignment=assignment, forecasts=False)
    except UnknownNameError as error:
        raise CardError(f"{submission.name!r} cannot be the reference of a card: {error}") from None


def track(agent: Agent, scene: Scene, task: Task) -> Rollout:
    """The tracks that ``agent`` answers the detections of ``scene`` with, one hypothesis, as the env records them.

    Of a trusted agent: its answers are not examined, which takes longer than the tracking.
    """
    frame = LocalFrame.of(scene)
    feed = make_feed(scene, frame, task)
    agent.reset(task)
    said = []
    for t in range(scene.frames):
        action = agent.act(feed.observe(t))
        rows = np.flatnonzero(action["track_valid"])
        box = frame.to_scene(action["track_box"][rows]).astype(np.float32)
        said.append((action["track_id"][rows], box, action["track_class"][rows]))
    track_id, box, class_id = (np.concatenate(column) for column in zip(*said, strict=True))
    return replace(
        _silence(scene, task),
        track_start=starts_of([len(rows) for rows, *_ in said]),
        track_id=track_id.astype(np.int64),
        track_box=box,
        track_class=class_id.astype(np.int64),
        member=np.ones((len(track_id), 1), dtype=bool),
        hypothesis_parent=np.full((scene.frames, 1), -1),
    )


def _silence(scene: Scene, task: Task) -> Rollout:
    """A rollout of ``scene`` with one hypothesis, in which nothing is said."""
    frames, classes = scene.frames, len(task.classes)
    size = {
        "F": frames, "F1": frames + 1, "R": 0, "H": 1, "S": 0, "K": task.samples, "T": task.future, "C1": classes + 1,
    }  # fmt: skip
    arrays = {
        name: np.zeros([size[n] if isinstance(n, str) else n for n in shape], dtype)
        for name, (dtype, shape) in ARRAYS.items()
    }
    return Rollout(scene.name, **arrays)
