"""Runs of a submission behind the gateway, one per seed, with digests and times."""

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...agent import Submission
from ...cards import Card
from ...core import NO_PROGRESS, MtpBenchError, Rollout, clean_text, cores
from ...env import MTPEnv, digest
from ...running import RunInfo, RunOptions, Setting, ranked_scenes, run_info, setting_of
from ...scoring import Reference
from ..gateway.layout import Image, image_of
from ..gateway.limits import Isolation, Limits, SceneRun
from ..gateway.run import run_isolated_scenes
from .canonical import digest_of
from .evaluation import Evaluation, evaluate
from .parts import Parts
from .record import HardwarePart, HashesPart, LatencyPart, MissedPart, key_of
from .shipped import FOR_BASELINES, baseline_digest

_MAX_REASON = 1000  # characters of why a scene was not finished
Runs = Mapping[int, Sequence[SceneRun]]  # seed -> scenes


@dataclass(frozen=True, eq=False)
class Plan:
    """A submission and the scenes of an env on which it is run."""

    submission: Submission
    card: Card
    scenes: tuple[str, ...]
    scenes_of_split: int
    keywords: dict[str, Any]  # keywords of the env, beyond card and data
    options: RunOptions  # data, workers and progress
    image: Image  # the submission as it runs

    @property
    def setting(self) -> Setting:
        """The submission with its own parameters and the env's k samples."""
        return setting_of(self.submission, self.card)


def plan_run(submission: Submission, env_id: str, options: RunOptions) -> Plan:
    """Return the plan for a submission on an env, with its own parameters.

    The agent gives the env's k samples per object. Raises MtpBenchError for an unknown
    env, missing data, a wrong parameter, and options that replace the scenes or
    detections of the env.
    """
    _require_env_data(submission, options)
    options.require_usable([submission])
    env = MTPEnv(
        env_id, evaluation=True, data=options.data, **options.shown_to(submission)
    )
    keywords = setting_of(submission, env.card).env_keywords(env.card)
    del keywords["observe"]  # the record has it in a field of its own
    scenes = ranked_scenes(env.card, env.scene_names)
    image = image_of(submission, env.card.id, env.card.weights_of)
    is_baseline = image.digest == baseline_digest(submission.name, image.weights)
    if submission.compare.observe == "associated" and not is_baseline:
        raise MtpBenchError(
            f"{submission.name}: {FOR_BASELINES}; compare it with `mtp-bench compare`"
        )
    return Plan(
        submission=submission,
        card=env.card,
        scenes=options.chosen(scenes),
        scenes_of_split=len(scenes),
        keywords=keywords,
        options=options,
        image=image,
    )


def _require_env_data(submission: Submission, options: RunOptions) -> None:
    """Raise MtpBenchError for options that a record of an env cannot have."""
    replaced = (options.detector, options.detections, options.presence)
    if any(option is not None for option in replaced):
        raise MtpBenchError(
            "a record uses the detections of its env, so no other detector and no "
            "presence model can be chosen"
        )
    if options.files is not None or options.split is not None:
        raise MtpBenchError(
            "a record uses the scenes of its env, so no files and no split can be "
            "chosen"
        )
    if submission.compare.observe == "tracks":
        raise MtpBenchError(
            f"{submission.name} observes stored tracks, which may have seen the "
            "future: "
            "it has no record; use `mtp-bench compare --tracks`"
        )


def run_seed(
    plan: Plan,
    seed: int,
    parts: Parts | None = None,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
) -> list[SceneRun]:
    """Run every scene of the plan under one seed.

    Returns runs in the plan's order. Scenes that are among the ``parts`` are not run
    again; the others are stored there as soon as they are finished. Never raises for
    the agent's actions.
    """
    runs: dict[str, SceneRun] = {}

    def keep(scene_run: SceneRun) -> None:
        runs[scene_run.rollout.scene] = scene_run
        if parts is not None:
            parts.write(seed, scene_run)

    for scene in plan.scenes:
        scene_run = None if parts is None else parts.read(seed, scene)
        if scene_run is not None:
            runs[scene] = scene_run
            plan.options.progress.done(scene)
    remaining = [scene for scene in plan.scenes if scene not in runs]
    env_keywords = {
        **plan.keywords,
        "observe": plan.setting.observe,
        "data": plan.options.data,
        "rigid_motion": True,
    }
    if remaining:
        run_isolated_scenes(
            plan.submission.path,
            plan.card,
            env_keywords,
            seed=seed,
            limits=limits,
            scenes=remaining,
            workers=plan.options.workers,
            progress=plan.options.progress,
            finished=keep,
            image=plan.image,
        )
    return [runs[scene] for scene in plan.scenes]


def rollouts_of(runs: Runs) -> dict[int, list[Rollout]]:
    """Return the rollouts of each seed."""
    return {
        seed: [run.rollout for run in seed_runs] for seed, seed_runs in runs.items()
    }


def evaluate_plan(
    plan: Plan, runs: Runs, reference: Reference, *, with_progress: bool = False
) -> Evaluation:
    """Score the runs of a plan.

    ``with_progress``: report each scene.
    """
    setting = plan.setting
    options = plan.options
    if not with_progress:
        options = replace(options, progress=NO_PROGRESS)
    return evaluate(
        plan.submission.name,
        plan.card,
        options,
        rollouts_of(runs),
        reference,
        setting.hypotheses,
        setting.observe,
    )


def info_of(plan: Plan, seed: int) -> RunInfo:
    """Return the description of a stored run of the plan, without the data root."""
    setting = plan.setting
    env = MTPEnv(
        plan.card,
        data=plan.options.data,
        evaluation=True,
        observe=setting.observe,
        **plan.keywords,
    )
    info = run_info(env, setting, seed, {**plan.keywords, "rigid_motion": True})
    return info.model_copy(update={"submission_digest": plan.image.digest})


def hashes(runs: Runs) -> HashesPart:
    """Return digests of hash chains and rollouts, which a second run must repeat."""
    seals = {
        key_of(scene_run.rollout.scene, seed): scene_run.seal
        for seed, seed_runs in runs.items()
        for scene_run in seed_runs
    }
    rollouts = rollouts_hash(rollouts_of(runs))
    return HashesPart(seals=digest_of(seals), rollouts=rollouts)


def rollouts_hash(runs: Mapping[int, Sequence[Rollout]]) -> str:
    """Return the hash over the answers of each seed.

    Drives are left out, since they are made again when a record is verified.
    """
    digests = {
        key_of(rollout.scene, seed): digest(replace(rollout, drive=None))
        for seed, rollouts in runs.items()
        for rollout in rollouts
    }
    return digest_of(digests)


def unanswered(runs: Runs) -> MissedPart:
    """Count malformed answers and unfinished scenes."""
    reasons = {}
    malformed = 0
    for seed, seed_runs in runs.items():
        for scene_run in seed_runs:
            malformed += scene_run.malformed
            if scene_run.status != "finished":
                reason = clean_text(scene_run.reason, _MAX_REASON)
                reasons[key_of(scene_run.rollout.scene, seed)] = (
                    f"{scene_run.status}: {reason}"
                )
    return MissedPart(malformed=malformed, reasons=reasons)


def isolation(runs: Runs) -> Isolation:
    """Return the weakest isolation of all runs."""
    # False sorts first
    isolations = [run.isolation for seed_runs in runs.values() for run in seed_runs]
    return min(isolations, key=lambda part: (part.sandboxed, part.memory == "cgroup"))


def latency(rollouts: Sequence[Rollout]) -> LatencyPart:
    """Return percentiles of the times of all answers but the first of each rollout.

    Frames count up to the end of the agent, malformed answers with the time that the
    judge waited for them.
    """
    answer_seconds = [rollout.seconds[1:] for rollout in rollouts]
    seconds = np.concatenate([np.zeros(0), *answer_seconds])
    seconds = seconds[np.isfinite(seconds) & (seconds > 0)]
    if not len(seconds):
        return LatencyPart(p50_ms=None, p95_ms=None, max_ms=None)
    p50, p95, largest = np.percentile(1e3 * seconds, [50, 95, 100]).tolist()
    return LatencyPart(p50_ms=p50, p95_ms=p95, max_ms=largest)


def hardware() -> HardwarePart:
    """Describe this machine, without names that identify it."""
    cpu = platform.processor() or platform.machine()
    cpu_file = Path("/proc/cpuinfo")
    if cpu_file.is_file():
        for line in cpu_file.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                cpu = line.partition(":")[2].strip() or cpu
                break
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return HardwarePart(cpu=cpu, cores=cores(), memory_gib=round(memory / 2**30, 1))
