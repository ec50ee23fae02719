"""Event weights of an env, or ways of a closed loop: the frozen file of a shipped card, or made from the scenes."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..agent import Agent, Submission, controls, load_submission
from ..cards import Card, load_card, with_presence
from ..core import (
    Bools,
    CardError,
    DataError,
    MtpBenchError,
    Rollout,
    Scene,
    Task,
    UnknownNameError,
    bundled,
    card_ids,
    long_work,
    parallel_map,
    read_json,
    require_file,
    require_known,
    starts_of,
    write_text,
)
from ..env import LocalFrame, MTPEnv, empty_rollout, make_feed
from ..scoring import (
    COUNTED,
    EVENTS,
    ONE_PER_TARGET,
    WEIGHTS_DEFINITIONS,
    CardBudget,
    Reference,
    SceneWeights,
    count_runs,
    evaluated,
    find_targets,
    read_reference,
    scene_key,
    score_scene,
    tracking_events as events_of,
    write_reference,
)
from .options import DEFAULTS, RunOptions
from .perturbation import (
    ASSIGNMENTS,
    RUNS,
    MatchedDetections,
    Perturbation,
    assignment_of,
    matched_detections,
)
from .playing import jobs_of, run_jobs, run_scene

_RUNS_PER_CALL = 12  # of a scene: workers share the runs of a long scene
_MOST_SEEDS = 255  # as many as a count of `SceneWeights`, an unsigned byte, holds


class _PlainRun(NamedTuple):
    """The run of a scene without cut or noise; the fields behind the first are those of `SceneWeights`."""

    detections: MatchedDetections
    stp: Bools  # [n, 3]
    stp_events: tuple[int, int, int]
    false_forecasts: int
    forecasts: int
    live: int
    truth_complete: bool


def frozen_path(env_id: str) -> Path:
    """Path of the frozen event weights of an env; the file need not exist."""
    return bundled("envs") / "reference" / f"{env_id}.json"


def frozen_reference(card: Card) -> Reference | None:
    """The frozen event weights of ``card``; None without a file, and for a card that is not the shipped one.

    Another presence model changes confidences, not events, so it keeps the weights. Raises DataError if the file is
    broken or of other definitions.
    """
    reference = _frozen_file(card.id)
    return (
        reference
        if reference is not None and reference.card == with_presence(card, None).digest
        else None
    )


def card_budget(env_id: str) -> CardBudget:
    """Return the constants that set the budgets of a card; without a frozen file, one false forecast per target.

    They are of the shipped card of this id, whatever is changed in it: scenes, split or detections.
    """
    reference = _frozen_file(env_id)
    return ONE_PER_TARGET if reference is None else reference.budget


def _frozen_file(env_id: str) -> Reference | None:
    """Read the frozen event weights of the shipped card of this id; None without a file."""
    path = frozen_path(env_id)
    if not path.is_file():
        return None
    reference = read_reference(path)
    if reference.env != env_id:
        raise DataError(f"{path}: env is {reference.env!r}, expected {env_id!r}")
    live = _live_frames().get(env_id)
    constants = (
        None
        if live is None
        else CardBudget(env_id, reference.totals["forecasts"], live, false_known=False)
    )
    return replace(reference, frozen=True, constants=constants)


def _live_frames() -> dict[str, int]:
    """Return the live frames of the scored splits whose truth holds prediction targets alone, by env.

    The files of event weights lack them, and their hash does not cover them.
    """
    path = frozen_path("live_frames")
    return read_json(path, DataError) if path.is_file() else {}


def ranked_scenes(card: Card, names: Sequence[str]) -> tuple[str, ...]:
    """The scenes ``names`` of a split that have frozen event weights, or all of them if none has.

    A user with more scenes than the weights were frozen for, such as all 138 of nuScenes' split ``val``, runs only
    those that all agents are ranked on.
    """
    frozen = frozen_reference(card)
    return tuple(
        name for name in names if frozen is not None and frozen.holds([name])
    ) or tuple(names)


def reference_for(
    card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS
) -> Reference:
    """The frozen event weights of ``card`` if they cover the scenes, else weights made from these scenes.

    ``card``: with all changes. ``options``: data, workers and progress. Raises DataError if the frozen file is broken.
    """
    frozen = frozen_reference(card)
    if frozen is not None and frozen.holds(scenes):
        return frozen
    return replace(
        make_reference(with_presence(card, None), scenes, options),
        constants=card_budget(card.id),
    )


def freeze(env_id: str, options: RunOptions = DEFAULTS) -> tuple[Path, Reference]:
    """Make the event weights of a shipped env from all its scenes, write them, and return the path and the weights.

    Raises UnknownNameError for the path of a card: only weights of shipped ids are looked up.
    """
    require_known(
        "environment",
        env_id,
        card_ids(),
        "only those that ship have frozen event weights",
    )
    card, path = load_card(env_id), frozen_path(env_id)
    path.parent.mkdir(exist_ok=True)
    require_file(path)
    reference = make_reference(
        card, MTPEnv(card, data=options.data).scene_names, options
    )
    write_reference(path, reference)
    if not reference.budget.false_known:
        live = {**_live_frames(), env_id: reference.budget.divisor}
        write_text(
            frozen_path("live_frames"),
            json.dumps(live, indent=1, sort_keys=True) + "\n",
        )
    return path, replace(reference, frozen=True)


def make_reference(
    card: Card,
    scenes: Sequence[str],
    options: RunOptions = DEFAULTS,
    seeds: Sequence[int] = range(RUNS),
) -> Reference:
    """Event weights from runs of the card's reference baseline on ``scenes``, one per seed; budgets are theirs, too.

    ``seeds``: at most 255, counts are bytes. Raises CardError unless that baseline takes the parameters ``assignment``
    and ``forecasts``.
    """
    if len(seeds) > _MOST_SEEDS:
        raise MtpBenchError(
            f"got {len(seeds)} seeds of event weights, expected at most {_MOST_SEEDS}"
        )
    if card.drive is not None:
        return _driven_reference(card, scenes, options)
    submission = load_submission(card.reference or controls()["single"])
    parts = [
        seeds[low : low + _RUNS_PER_CALL]
        for low in range(0, len(seeds), _RUNS_PER_CALL)
    ]
    plain: list[_PlainRun]
    counts: list[NDArray[np.uint8]]
    with long_work(
        f"event weights from runs of {submission.name}", progress=options.progress
    ) as progress:
        progress.started(len(scenes) * (1 + len(parts)))
        known = [(card, options.data, name, submission) for name in scenes]
        plain = parallel_map(
            _plain_run,
            known,
            options.workers,
            lambda place: progress.done(scenes[place]),
        )
        perturbation = Perturbation.fit(
            [run.detections for run in plain], len(card.task.classes)
        )
        calls = [(*call, perturbation, part) for call in known for part in parts]
        counts = parallel_map(
            _perturbed_runs,
            calls,
            options.workers,
            lambda i: progress.done(scenes[i // len(parts)]),
        )
    weights = {}
    for i, (name, run) in enumerate(zip(scenes, plain, strict=True)):
        total = np.stack(counts[i * len(parts) : (i + 1) * len(parts)]).sum(
            axis=0, dtype=np.uint8
        )
        weights[scene_key(card.id, name)] = SceneWeights(
            total, run.stp, run.stp_events, run.false_forecasts, run.forecasts
        )
    return Reference(
        card.id,
        card.digest,
        WEIGHTS_DEFINITIONS,
        submission.name,
        len(seeds),
        perturbation.parameters(card.task.classes, seeds),
        weights,
        constants=_counted(card.id, plain),
    )


def _counted(env_id: str, runs: Sequence[_PlainRun]) -> CardBudget | None:
    """Return the constants that plain runs set; None: false forecasts against targets, as the weights hold them."""
    if all(run.truth_complete for run in runs):
        return None
    live = sum(run.live for run in runs)
    return CardBudget(
        env_id, sum(run.forecasts for run in runs), max(live, 1), false_known=False
    )


def _driven_reference(
    card: Card, scenes: Sequence[str], options: RunOptions
) -> Reference:
    """Ways of the ego of a closed loop with ground-truth tracks, one run; each scene counts as one target."""
    submission = load_submission(controls()["ground_truth"])
    drives = run_jobs(
        jobs_of(submission, card, {"data": options.data}, scenes), options, _way
    )
    none = (
        np.zeros((1, len(COUNTED)), dtype=np.uint8),
        np.zeros((1, len(EVENTS)), dtype=bool),
        (0, 0, 0),
        0,
        0,
    )
    weights = {
        scene_key(card.id, name): SceneWeights(*none, way)
        for name, way in zip(scenes, drives, strict=True)
    }
    return Reference(
        card.id, card.digest, WEIGHTS_DEFINITIONS, submission.name, 1, {}, weights
    )


def _way(scene: Scene, rollout: Rollout, card: Card) -> float:
    assert rollout.drive is not None
    return (
        float(np.floor(1e6 * rollout.drive.way)) / 1e6
    )  # machines differ in the last bits


def _plain_run(
    card: Card, data: str | None, name: str, submission: Submission
) -> _PlainRun:
    """Run the reference baseline on a scene as it is; its matched detections and event weights but the counts."""
    env = MTPEnv(card, data=data, evaluation=True)
    rollout = run_scene(submission.build(env.task), env, name, 0, submission.name)
    scene = env.scene
    events = events_of(scene, rollout, card)
    ids, lost, reacquired = events[~evaluated(scene).truth.neutral].sum(axis=0).tolist()
    score, flags = (
        score_scene(scene, rollout, card),
        events[find_targets(scene, card).row],
    )
    return _PlainRun(
        matched_detections(scene, card),
        flags,
        (ids, lost, reacquired),
        score.false_forecasts,
        score.forecasts,
        score.live,
        scene.truth_complete,
    )


def _perturbed_runs(
    card: Card,
    data: str | None,
    name: str,
    submission: Submission,
    perturbation: Perturbation,
    runs: Sequence[int],
) -> NDArray[np.uint8]:
    """Counts [n, 4] of the events of the perturbed ``runs`` on the targets of a scene."""
    env = MTPEnv(
        card, data=data, samples=1, hypotheses=1, max_objects=1, evaluation=True
    )
    env.reset(options={"scene": name})
    scene, row = env.scene, find_targets(env.scene, card).row
    agents = {
        assignment: _tracker(submission, env.task, assignment)
        for assignment in ASSIGNMENTS
    }
    rollouts = (
        track(
            agents[assignment_of(run)],
            perturbation.perturbed(scene, run),
            env.task,
            card,
        )
        for run in runs
    )
    return count_runs(
        (events_of(scene, rollout, card)[row] for rollout in rollouts), len(row)
    )


def _tracker(submission: Submission, task: Task, assignment: str) -> Agent:
    """The reference baseline with this assignment, without forecasts."""
    try:
        return submission.build(task, assignment=assignment, forecasts=False)
    except UnknownNameError as error:
        raise CardError(
            f"{submission.name!r} cannot be the reference of a card: {error}"
        ) from None


def track(agent: Agent, scene: Scene, task: Task, card: Card) -> Rollout:
    """Rollout of the tracks that ``agent`` makes of the detections of ``scene``, one hypothesis, without forecasts.

    For trusted agents: their actions are not checked, which takes longer than the tracking.
    """
    frame = LocalFrame.of(scene)
    feed = make_feed(scene, frame, task, card)
    agent.reset(task)
    columns = []
    for t in range(scene.frames):
        action = agent.act(feed.observe(t))
        rows = np.flatnonzero(action["track_valid"])
        box = frame.to_scene(action["track_box"][rows]).astype(np.float32)
        columns.append((action["track_id"][rows], box, action["track_class"][rows]))
    track_id, box, class_id = (
        np.concatenate(column) for column in zip(*columns, strict=True)
    )
    empty = empty_rollout(
        scene.name,
        scene.frames,
        H=1,
        K=task.samples,
        T=task.future,
        C1=len(task.classes) + 1,
    )
    return replace(
        empty,
        track_start=starts_of([len(ids) for ids, *_ in columns]),
        track_id=track_id.astype(np.int64),
        track_box=box,
        track_class=class_id.astype(np.int64),
        member=np.ones((len(track_id), 1), dtype=bool),
        hypothesis_parent=np.full((scene.frames, 1), -1),
    )
