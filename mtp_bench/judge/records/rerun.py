"""Runs that check a record: in random order, under secret motion, on hidden scenes.

The public seeds of a record fix how its scenes were turned and shifted, so that an
agent could look its answers up in a table of coordinates. Such a table fails under
another motion. One relative to the first pose of the ego does not, nor one of the roads
that a card with lanes shows: authors declare that they use none. The order is random,
so that a run cannot use what another left in the page cache.

Hidden scenes, which rank on simulated envs, are made for one or more checks and then
deleted. Only their sums per unit are published, since the name of a scene contains its
seed.
"""

import secrets
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

from ...cards import Card
from ...core import Progress, RecordError, Rollout
from ...env import MTPEnv, actions_of
from ...scoring import SUBSETS, Reference, Subset, check_rollout, why_not_on
from ...sources import open_source, package_of
from ..gateway.limits import Isolation, SceneRun
from .canonical import Difference
from .record import HiddenPart, Record
from .running import Plan, Runs, evaluate_plan, isolation, run_seed, unanswered
from .seal import Sealed
from .targets import UnitTargets

# Share of the error by which other draws may be worse, on all targets and on event
# subsets that rank. Seeds of a baseline differ by 0.06 at most, by 0.015 on those.
_MAX_WORSE_SHARE = 0.1
_NEGLIGIBLE_M = 1e-3
_SECRET_SEEDS = 1 << 60  # as many as `Sealed.run_seed` can give
_MAX_WEIGHT_SUM = 1.001  # of the samples of a forecast, rounded
_random = secrets.SystemRandom()


def drive_again(card: Card, rollout: Rollout) -> Rollout:
    """Return the rollout with the drive that its answers give, without the agent.

    Raises MtpBenchError for answers that no env gives.
    """
    from ...traffic import DrivenEpisode

    task = MTPEnv(card, evaluation=True).task
    episode = DrivenEpisode.start(card, task, rollout.scene, rng=None)
    # the check needs a scene of as many frames as there are answers
    check_rollout(replace(episode.scene, time=rollout.seconds), rollout, card)
    # a log-weight above 1 is too large in any case, and could overflow
    weights = np.exp(np.minimum(rollout.forecast_log_weight, 1.0)).sum(axis=1)
    if not (weights < _MAX_WEIGHT_SUM).all():  # also NaN is refused
        raise RecordError(
            f"{rollout.scene}: weights of the samples of a forecast add up to more "
            "than 1"
        )
    for action in actions_of(rollout):
        if not episode.over:
            episode.take(action)
    if not episode.over or episode.frame_index < rollout.frames:
        raise RecordError(
            f"{rollout.scene}: its {rollout.frames} stored answers do not end with the "
            "drive"
        )
    return replace(rollout, drive=episode.drive)


def run_again(plan: Plan, seeds: Sequence[int]) -> Runs:
    """Run seeds and scenes in a random order.

    Returns them in the given one.
    """
    shuffled_seeds = _random.sample(list(seeds), len(seeds))
    runs = {seed: _run_shuffled(plan, seed) for seed in shuffled_seeds}
    return {seed: runs[seed] for seed in seeds}


def errors_under_random_pose(
    plan: Plan, reference: Reference
) -> dict[Subset, float | None]:
    """Return bADE of the submission under one secret seed, which moves the scenes.

    Raises RecordError if a scene was not finished: an agent could refuse to play under
    any but the public seeds.
    """
    seed = secrets.randbelow(_SECRET_SEEDS)
    runs = {seed: _run_shuffled(plan, seed)}
    require_answered(runs, plan.submission.name, "under a secret motion")
    results = evaluate_plan(plan, runs, reference).results
    return {subset: results.row_of(subset).error for subset in results.subsets}


def worse_when_moved(
    record: Record, moved_errors: Mapping[Subset, float | None]
) -> Difference | None:
    """Return the first error that is larger among ``moved_errors``.

    None if none is. A moved run is compared with the mean over seeds, not with the
    worst seed: an agent with a table for all seeds but one would pass.
    """
    # further subsets do not rank
    for subset in SUBSETS:
        row = record.row_of(subset)
        error = moved_errors.get(subset)
        if row.error is None or error is None:
            continue
        subset_sums = record.sums_on(subset, record.samples)
        if subset != "all" and why_not_on(subset, subset_sums):
            continue
        largest_error = row.error * (1 + _MAX_WORSE_SHARE) + _NEGLIGIBLE_M
        # one collision costs a whole scene
        if record.drives is not None and row.interval is not None:
            largest_error = max(largest_error, row.interval[1])
        if error > largest_error:
            error_name = f"error of {subset} under another motion"
            return Difference(error_name, row.error, error)
    return None


def why_unsandboxed(record: Record, isolation_now: Isolation) -> str:
    """Return the reason why another run does not confirm a record.

    Empty if the agent was sandboxed then and now.
    """
    if record.isolation.mechanism == "none":
        return "the agent was unsandboxed when the record was made"
    if isolation_now.mechanism == "none":
        return "the agent was unsandboxed in this run"
    return ""


def run_hidden(
    plan: Plan, record: Record, sealed: Sealed, ends: ExitStack
) -> HiddenPart:
    """Run the submission on the hidden scenes, under a secret seed.

    The scenes are made if they are missing, and deleted when ``ends`` is closed. Raises
    RecordError if the seal is of another card, or the agent was unsandboxed.
    """
    card = plan.card
    if (sealed.seeds.env, sealed.seeds.card_digest) != (card.id, card.digest):
        raise RecordError(
            f"the seal is of {sealed.seeds.env} with card digest "
            f"{sealed.seeds.card_digest}, the record of {card.id} with {card.digest}"
        )
    hidden_card = sealed.card(card)
    package = package_of(hidden_card)
    ends.callback(package.discard, hidden_card)
    package.keep_private(hidden_card)
    public_progress = plan.options.progress
    # the name of a scene would tell its seed
    progress = Progress(
        public_progress.started, lambda _: public_progress.done("a hidden scene")
    )
    options = replace(plan.options, data=None, progress=progress)
    hidden_names = sealed.shuffled(open_source(hidden_card).names)
    hidden_plan = replace(
        plan,
        card=hidden_card,
        scenes=hidden_names,
        scenes_of_split=len(hidden_names),
        options=options,
    )
    runs = run_again(hidden_plan, [sealed.run_seed(record.seeds[0])])
    if why := why_unsandboxed(record, isolation(runs)):
        raise RecordError(
            f"hidden scenes would not stay hidden: {why}; run it on Linux with "
            "bubblewrap"
        )
    require_answered(runs, plan.submission.name, "of hidden scenes")
    reference = sealed.reference(hidden_card, hidden_names, options)
    results = evaluate_plan(hidden_plan, runs, reference).results
    # without names of scenes
    targets = UnitTargets(
        scenes=[],
        scene_units=[],
        nothing_predicted=results.targets.nothing_predicted,
        subsets=results.targets.subsets,
    )
    shared_fields: dict[str, Any] = dict(results) | {"targets": targets}
    return HiddenPart(
        commitment=sealed.commitment,
        weights=reference.digest,
        scenes=len(hidden_names),
        **shared_fields,
    )


def require_answered(runs: Runs, agent: str, where: str) -> None:
    """Raise RecordError unless the agent finished every scene.

    It names no scenes.
    """
    missed = unanswered(runs)
    if missed.crashed_scenes:
        # a reason begins with the status of its scene
        kinds = sorted({reason.split(":")[0] for reason in missed.reasons.values()})
        raise RecordError(
            f"{agent}: {missed.crashed_scenes} runs {where} were not finished "
            f"({', '.join(kinds)}), expected 0"
        )


def _run_shuffled(plan: Plan, seed: int) -> list[SceneRun]:
    """Run the scenes of a plan in random order, and return them in the plan's."""
    scenes = tuple(_random.sample(plan.scenes, len(plan.scenes)))
    runs = {
        run.rollout.scene: run for run in run_seed(replace(plan, scenes=scenes), seed)
    }
    return [runs[scene] for scene in plan.scenes]
