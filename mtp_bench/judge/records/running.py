"""Runs of a submission behind the gateway, one per seed, and their digests and measurements."""

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

MOST_REASON = 1000  # characters of why a scene was not finished
Runs = Mapping[int, Sequence[SceneRun]]  # seed -> scenes


@dataclass(frozen=True, eq=False)
class Plan:
    """A submission and the scenes of an env on which it is run."""

    submission: Submission
    env: Any  # for MTPEnv: id, path of a card, or a card that is in no file
    card: Card
    scenes: tuple[str, ...]
    scenes_of_split: int
    keywords: dict[str, Any]  # of the env, beyond card and data
    options: RunOptions  # data, workers and progress
    image: Image  # the submission as it runs

    @property
    def setting(self) -> Setting:
        """The submission with its own parameters and k samples."""
        return setting_of(self.submission, self.card)


def plan_run(submission: Submission, env_id: str, options: RunOptions) -> Plan:
    """The scenes of an env for a submission, with its own parameters and k samples.

    Raises MtpBenchError for an unknown env, other scenes or detections, missing data or a wrong parameter.
    """
    if {options.detector, options.detection_file, options.presence} != {None}:
        raise MtpBenchError(
            "a record is of the detections that its env names: no other detector can be chosen, and no presence model"
        )
    if options.files is not None or options.split is not None:
        raise MtpBenchError(
            "a record is of the scenes that its env names: no files and no split can take their place"
        )
    if submission.compare.observe == "tracks":
        raise MtpBenchError(
            f"{submission.name} observes stored tracks, which may have seen the future: it has no record; use "
            "`mtp-bench compare --tracks`"
        )
    options.require_usable([submission])
    env = MTPEnv(
        env_id, evaluation=True, data=options.data, **options.shown_to(submission)
    )
    keywords = setting_of(submission, env.card).env_keywords(env.card)
    del keywords["observe"]  # the record has it in a field of its own
    names = ranked_scenes(env.card, env.scene_names)
    image = image_of(submission, env.card.id, env.card.weights_of)
    if submission.compare.observe == "associated" and image.digest != baseline_digest(
        submission.name, image.weights
    ):
        raise MtpBenchError(
            f"{submission.name}: {FOR_BASELINES}; compare it with `mtp-bench compare`"
        )
    return Plan(
        submission,
        env_id,
        env.card,
        options.chosen(names),
        len(names),
        keywords,
        options,
        image,
    )


def run_seed(
    plan: Plan,
    seed: int,
    parts: Parts | None = None,
    limits: Limits = Limits(),  # noqa: B008  (frozen)
) -> list[SceneRun]:
    """Run every scene of the plan under one seed, in the order of the plan; never raises for the agent's actions.

    Scenes that are among the ``parts`` are not run again; the others are stored there as soon as they are finished.
    """
    runs: dict[str, SceneRun] = {}
    for scene in plan.scenes:
        if parts is not None and (run := parts.read(seed, scene)) is not None:
            runs[scene] = run
            plan.options.progress.done(scene)

    def keep(run: SceneRun) -> None:
        runs[run.rollout.scene] = run
        if parts is not None:
            parts.write(seed, run)

    remaining = [scene for scene in plan.scenes if scene not in runs]
    if remaining:
        run_isolated_scenes(
            plan.submission.path,
            plan.env,
            {
                **plan.keywords,
                "observe": plan.setting.observe,
                "data": plan.options.data,
                "rigid_motion": True,
            },
            seed=seed,
            limits=limits,
            scenes=remaining,
            workers=plan.options.workers,
            progress=plan.options.progress,
            finished=keep,
            digest=plan.image.digest,
        )
    return [runs[scene] for scene in plan.scenes]


def rollouts_of(runs: Runs) -> dict[int, list[Rollout]]:
    """The rollouts of each seed."""
    return {seed: [run.rollout for run in results] for seed, results in runs.items()}


def evaluate_plan(
    plan: Plan, runs: Runs, reference: Reference, *, with_progress: bool = False
) -> Evaluation:
    """Score the runs of a plan; ``with_progress``: report each scene to the progress of the plan's options."""
    setting = plan.setting
    options = (
        plan.options if with_progress else replace(plan.options, progress=NO_PROGRESS)
    )
    name, rollouts = plan.submission.name, rollouts_of(runs)
    return evaluate(
        name,
        plan.card,
        options,
        rollouts,
        reference,
        setting.hypotheses,
        setting.observe,
    )


def info_of(plan: Plan, seed: int) -> RunInfo:
    """Description of a stored run of the plan, without the data root."""
    setting = plan.setting
    env = MTPEnv(
        plan.env,
        data=plan.options.data,
        evaluation=True,
        observe=setting.observe,
        **plan.keywords,
    )
    info = run_info(env, setting, seed, {**plan.keywords, "rigid_motion": True})
    return info.model_copy(update={"submission_digest": plan.image.digest})


def hashes(runs: Runs) -> HashesPart:
    """Digests of the hash chains and rollouts, which a second run must reproduce."""
    chains = {
        key_of(r.rollout.scene, seed): r.seal
        for seed, results in runs.items()
        for r in results
    }
    return HashesPart(
        seals=digest_of(chains), rollouts=rollouts_hash(rollouts_of(runs))
    )


def rollouts_hash(runs: Mapping[int, Sequence[Rollout]]) -> str:
    """Hash over the answers of each seed; the drives that they give are made again where a record is verified."""
    answers = {
        key_of(r.scene, seed): replace(r, drive=None)
        for seed, rollouts in runs.items()
        for r in rollouts
    }
    return digest_of({key: digest(rollout) for key, rollout in answers.items()})


def unanswered(runs: Runs) -> MissedPart:
    """Frames without an accepted answer, and scenes that were not finished."""
    every = [run for results in runs.values() for run in results]
    reasons = {
        key_of(
            run.rollout.scene, seed
        ): f"{run.status}: {clean_text(run.reason, MOST_REASON)}"
        for seed, results in runs.items()
        for run in results
        if run.status != "finished"
    }
    return MissedPart(malformed=sum(run.malformed for run in every), reasons=reasons)


def isolation(runs: Runs) -> Isolation:
    """The weakest isolation of all runs."""
    every = [run.isolation for results in runs.values() for run in results]
    return min(every, key=lambda each: (each.sandboxed, each.memory == "cgroup"))


def latency(rollouts: Sequence[Rollout]) -> LatencyPart:
    """Percentiles over the frames of all rollouts but the first of each, up to the end of the agent.

    Malformed answers count with the time that the judge waited for them.
    """
    seconds = np.concatenate(
        [np.zeros(0), *(rollout.seconds[1:] for rollout in rollouts)]
    )
    seconds = seconds[np.isfinite(seconds) & (seconds > 0)]
    if not len(seconds):
        return LatencyPart(p50_ms=None, p95_ms=None, max_ms=None)
    p50, p95, most = (
        float(value) for value in np.percentile(1e3 * seconds, [50, 95, 100])
    )
    return LatencyPart(p50_ms=p50, p95_ms=p95, max_ms=most)


def hardware() -> HardwarePart:
    """Description of this machine, without names that identify it."""
    lines = (
        Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
        if Path("/proc/cpuinfo").is_file()
        else []
    )
    models = (
        line.partition(":")[2].strip()
        for line in lines
        if line.startswith("model name")
    )
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    cpu = next(models, "") or platform.processor() or platform.machine()
    return HardwarePart(cpu=cpu, cores=cores(), memory_gib=round(memory / 2**30, 1))
