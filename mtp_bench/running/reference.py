"""Event weights of an env, or ways of a closed loop.

They are in the frozen file of a shipped card, or made from the scenes.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..agent import Agent, Submission, controls, load_submission
from ..cards import Card, as_recorded, load_card
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
    COUNTED_EVENTS,
    EVENT_KINDS,
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
_MAX_SEEDS = 255  # as many as a count of `SceneWeights`, an unsigned byte, holds


class _PlainRun(NamedTuple):
    """The run of a scene without score threshold or noise, n targets."""

    detections: MatchedDetections
    stp: Bools  # [n, 3]; this and the next three are fields of `SceneWeights`
    stp_events: tuple[int, int, int]  # switches, lost, reacquired
    false_forecasts: int
    forecasts: int
    live_frames: int
    truth_complete: bool


def frozen_path(env_id: str) -> Path:
    """Return the path of the frozen event weights of an env, which need not exist."""
    return bundled("envs") / "reference" / f"{env_id}.json"


def frozen_reference(card: Card) -> Reference | None:
    """Return the frozen event weights of ``card``.

    None without a file, and for a card that is not the shipped one. Another presence
    model, and other errors of the detector, keep the weights: they do not change who is a
    target of what. Raises DataError if
    the file is broken or of other definitions.
    """
    reference = _read_frozen(card.id)
    if reference is None or reference.card != as_recorded(card).digest:
        return None
    return reference


def card_budget(env_id: str) -> CardBudget:
    """Return the constants that set the budgets of a card.

    Without a frozen file, one false forecast per target. They are of the shipped card
    of this id, whatever is changed in it: scenes, split or detections.
    """
    reference = _read_frozen(env_id)
    return ONE_PER_TARGET if reference is None else reference.budget


def _read_frozen(env_id: str) -> Reference | None:
    """Read the frozen event weights of an env, None without a file."""
    path = frozen_path(env_id)
    if not path.is_file():
        return None
    reference = read_reference(path)
    if reference.env != env_id:
        raise DataError(f"{path}: env is {reference.env!r}, expected {env_id!r}")
    constants = None
    live_frames = _live_frames().get(env_id)
    if live_frames is not None:
        forecasts = reference.totals["forecasts"]
        constants = CardBudget(env_id, forecasts, live_frames, false_known=False)
    return replace(reference, frozen=True, constants=constants)


def _live_frames() -> dict[str, int]:
    """Return the numbers of live frames of scored splits, by env.

    Only envs whose truth is prediction targets alone are listed. The files of event
    weights lack these numbers, and their hash does not cover them.
    """
    path = frozen_path("live_frames")
    return read_json(path, DataError) if path.is_file() else {}


def ranked_scenes(card: Card, scene_names: Sequence[str]) -> tuple[str, ...]:
    """Return the scenes that have frozen weights, or all if none has.

    A user with more scenes than the weights were frozen for, such as all 138 of
    nuScenes' split ``val``, runs only those that all agents are ranked on.
    """
    frozen = frozen_reference(card)
    ranked: tuple[str, ...] = ()
    if frozen is not None:
        ranked = tuple(
            scene_name for scene_name in scene_names if frozen.holds([scene_name])
        )
    return ranked or tuple(scene_names)


def reference_for(
    card: Card, scenes: Sequence[str], options: RunOptions = DEFAULTS
) -> Reference:
    """Return the frozen event weights of ``card``, or weights made from the scenes.

    Weights are made if the frozen ones do not cover the scenes. ``card``: the card with
    all changes of the call. ``options``: data, workers and progress. Raises DataError
    if the frozen file is broken.
    """
    frozen = frozen_reference(card)
    if frozen is not None and frozen.holds(scenes):
        return frozen
    reference = make_reference(as_recorded(card), scenes, options)
    return replace(reference, constants=card_budget(card.id))


def freeze(env_id: str, options: RunOptions = DEFAULTS) -> tuple[Path, Reference]:
    """Write the event weights of a shipped env, made from all its scenes.

    Returns the path and the weights. Raises UnknownNameError for the path of a card:
    only weights of shipped ids are looked up.
    """
    advice = "only those that ship have frozen event weights"
    require_known("environment", env_id, card_ids(), advice)
    card = load_card(env_id)
    path = frozen_path(env_id)
    path.parent.mkdir(exist_ok=True)
    require_file(path)
    scenes = MTPEnv(card, data=options.data).scene_names
    reference = make_reference(card, scenes, options)
    write_reference(path, reference)
    if not reference.budget.false_known:
        live_frames = {**_live_frames(), env_id: reference.budget.divisor}
        text = json.dumps(live_frames, indent=1, sort_keys=True) + "\n"
        write_text(frozen_path("live_frames"), text)
    return path, replace(reference, frozen=True)


def make_reference(
    card: Card,
    scenes: Sequence[str],
    options: RunOptions = DEFAULTS,
    seeds: Sequence[int] = range(RUNS),
) -> Reference:
    """Make event weights from runs of the card's reference baseline on ``scenes``.

    There is one run per seed, and the runs also give the budgets. ``seeds``: at most
    255, since counts are bytes. Raises CardError unless that baseline takes the
    parameters ``assignment`` and ``forecasts``.
    """
    if len(seeds) > _MAX_SEEDS:
        raise MtpBenchError(
            f"got {len(seeds)} seeds of event weights, expected at most {_MAX_SEEDS}"
        )
    if card.drive is not None:
        return _driven_reference(card, scenes, options)
    submission = load_submission(card.reference or controls()["single"])
    starts = range(0, len(seeds), _RUNS_PER_CALL)
    seed_parts = [seeds[start : start + _RUNS_PER_CALL] for start in starts]
    plain_runs: list[_PlainRun]
    event_counts: list[NDArray[np.uint8]]
    text = f"event weights from runs of {submission.name}"
    with long_work(text, progress=options.progress) as progress:
        progress.started(len(scenes) * (1 + len(seed_parts)))
        scene_calls = [
            (card, options.data, scene_name, submission) for scene_name in scenes
        ]
        plain_runs = parallel_map(
            _plain_run,
            scene_calls,
            options.workers,
            lambda index: progress.done(scenes[index]),
        )
        perturbation = Perturbation.fit(
            [plain_run.detections for plain_run in plain_runs], len(card.task.classes)
        )
        calls = [
            (*call, perturbation, part) for call in scene_calls for part in seed_parts
        ]
        event_counts = parallel_map(
            _perturbed_runs,
            calls,
            options.workers,
            lambda index: progress.done(scenes[index // len(seed_parts)]),
        )
    weights = {}
    for i, scene_name in enumerate(scenes):
        plain_run = plain_runs[i]
        part_counts = np.stack(
            event_counts[i * len(seed_parts) : (i + 1) * len(seed_parts)]
        )
        weights[scene_key(card.id, scene_name)] = SceneWeights(
            part_counts.sum(axis=0, dtype=np.uint8),
            plain_run.stp,
            plain_run.stp_events,
            plain_run.false_forecasts,
            plain_run.forecasts,
        )
    return Reference(
        card.id,
        card.digest,
        WEIGHTS_DEFINITIONS,
        submission.name,
        len(seeds),
        perturbation.parameters(card.task.classes, seeds),
        weights,
        constants=_budget_of(card.id, plain_runs),
    )


def _budget_of(env_id: str, runs: Sequence[_PlainRun]) -> CardBudget | None:
    """Return the constants that plain runs set.

    None: false forecasts against targets, as the weights hold them.
    """
    if all(run.truth_complete for run in runs):
        return None
    live_frames = sum(run.live_frames for run in runs)
    forecasts = sum(run.forecasts for run in runs)
    return CardBudget(env_id, forecasts, max(live_frames, 1), false_known=False)


def _driven_reference(
    card: Card, scenes: Sequence[str], options: RunOptions
) -> Reference:
    """Return the distances that the ego drives with ground-truth tracks."""
    submission = load_submission(controls()["ground_truth"])
    jobs = jobs_of(submission, card, {"data": options.data}, scenes)
    ways_m = run_jobs(jobs, options, _way)
    # each scene counts as one target
    no_events = SceneWeights(
        counts=np.zeros((1, len(COUNTED_EVENTS)), dtype=np.uint8),
        stp=np.zeros((1, len(EVENT_KINDS)), dtype=bool),
        stp_events=(0, 0, 0),
        false_forecasts=0,
        forecasts=0,
    )
    weights = {}
    for scene_name, way_m in zip(scenes, ways_m, strict=True):
        weights[scene_key(card.id, scene_name)] = replace(no_events, way=way_m)
    runs = 1
    return Reference(
        card.id, card.digest, WEIGHTS_DEFINITIONS, submission.name, runs, {}, weights
    )


def _way(scene: Scene, rollout: Rollout, card: Card) -> float:
    """Return the way of a drive, m, rounded down: machines differ in the last bits."""
    assert rollout.drive is not None
    return float(np.floor(1e6 * rollout.drive.way)) / 1e6


def _plain_run(
    card: Card, data: str | None, scene_name: str, submission: Submission
) -> _PlainRun:
    """Run the reference baseline on a scene as it is."""
    env = MTPEnv(card, data=data, evaluation=True)
    agent = submission.build(env.task)
    rollout = run_scene(agent, env, scene_name, seed=0, agent_name=submission.name)
    scene = env.scene
    events = events_of(scene, rollout, card)
    object_events = events[~evaluated(scene).truth.neutral]
    event_counts = tuple(object_events.sum(axis=0).tolist())
    score = score_scene(scene, rollout, card)
    return _PlainRun(
        matched_detections(scene, card),
        events[find_targets(scene, card).row],
        event_counts,
        score.false_forecasts,
        score.forecasts,
        score.live,
        scene.truth_complete,
    )


def _perturbed_runs(
    card: Card,
    data: str | None,
    scene_name: str,
    submission: Submission,
    perturbation: Perturbation,
    runs: Sequence[int],
) -> NDArray[np.uint8]:
    """Return counts [n, 4] of the events of the perturbed ``runs`` on n targets."""
    env = MTPEnv(  # only tracks count, so forecasts have the least sizes
        card, data=data, samples=1, hypotheses=1, max_objects=1, evaluation=True
    )
    env.reset(options={"scene": scene_name})
    scene = env.scene
    row = find_targets(scene, card).row
    agents: dict[str, Agent] = {}
    for assignment in ASSIGNMENTS:
        agents[assignment] = _tracker(submission, env.task, assignment)

    def events() -> Iterator[Bools]:
        for run in runs:
            perturbed = perturbation.perturbed(scene, run)
            rollout = track(agents[assignment_of(run)], perturbed, env.task, card)
            yield events_of(scene, rollout, card)[row]

    return count_runs(events(), len(row))


def _tracker(submission: Submission, task: Task, assignment: str) -> Agent:
    """Build the reference baseline with this assignment, without forecasts."""
    try:
        return submission.build(task, assignment=assignment, forecasts=False)
    except UnknownNameError as error:
        raise CardError(
            f"{submission.name!r} cannot be the reference of a card: {error}"
        ) from None


def track(agent: Agent, scene: Scene, task: Task, card: Card) -> Rollout:
    """Return the tracks that ``agent`` makes of the detections of ``scene``.

    The rollout has one hypothesis and no forecasts. For trusted agents: their actions
    are not checked, which takes longer than the tracking.
    """
    frame = LocalFrame.of(scene)
    feed = make_feed(scene, frame, task, card)
    agent.reset(task)
    frame_columns = []
    for t in range(scene.frames):
        action = agent.act(feed.observe(t))
        track_row = np.flatnonzero(action["track_valid"])
        box = frame.to_scene(action["track_box"][track_row]).astype(np.float32)
        frame_columns.append(
            (action["track_id"][track_row], box, action["track_class"][track_row])
        )
    track_id, box, class_id = (
        np.concatenate(column) for column in zip(*frame_columns, strict=True)
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
        track_start=starts_of([len(ids) for ids, *_ in frame_columns]),
        track_id=track_id.astype(np.int64),
        track_box=box,
        track_class=class_id.astype(np.int64),
        member=np.ones((len(track_id), 1), dtype=bool),
        hypothesis_parent=np.full((scene.frames, 1), -1),
    )
