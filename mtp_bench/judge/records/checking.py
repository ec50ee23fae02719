"""Check that a submission keeps the contract of an agent, also behind the gateway."""

from collections.abc import Sequence
from typing import Any

from ...agent import Submission, SubmissionFactory
from ...core import Rollout
from ...env import MTPEnv, digest
from ...running import Finding, RunOptions, check_agent, jobs_of, run_jobs
from ..gateway.limits import PROCESS_ENDED, SceneRun
from ..gateway.run import run_isolated_scenes

MAX_CHECKED_SCENES = 3  # at most
_CONTRACT_SCENES = 2  # of these, the ones on which the contract is checked
_SANDBOX_HINT = (
    "it runs alone there: its own folder, no data, no network, bounded memory"
)
_UNANSWERED_HINT = "these frames count as unanswered"
_DIFFERENCE_HINT = (
    "look for hash(), the order of sets, the number of threads, the environment"
)


def check_submission(
    submission: Submission, env_id: str, options: RunOptions
) -> list[Finding]:
    """Check a submission on the first scenes of an env.

    Actions of its agent never raise. ``options``: data, scenes and progress. Raises
    MtpBenchError for a missing env or data.
    """
    progress = options.progress
    keywords: dict[str, Any] = {
        "data": options.data,
        **options.shown_to(submission),
        "evaluation": True,
    }
    names = options.chosen(MTPEnv(env_id, **keywords).scene_names)
    progress.started(len(names) + 1)  # the scenes, and the contract
    runs = run_isolated_scenes(
        submission.path, env_id, keywords, scenes=names, progress=progress
    )
    if any(map(_is_dangerous, runs)):
        return gateway_findings(runs, None)
    make = SubmissionFactory(str(submission.path), submission.parameters)
    findings = check_agent(make, env_id, names[:_CONTRACT_SCENES], keywords)
    progress.done("conformance")
    if any(finding.level == "error" for finding in findings):
        return findings
    rollouts = run_jobs(jobs_of(submission, env_id, keywords, names))
    return findings + gateway_findings(runs, rollouts)


def _is_dangerous(scene_run: SceneRun) -> bool:
    """Return True for an agent that would take this process with it.

    Such an agent hung, broke the rules or ended its process.
    """
    ended = scene_run.reason.startswith(PROCESS_ENDED)
    return ended or scene_run.status in ("hung", "rejected")


def gateway_findings(
    runs: Sequence[SceneRun], rollouts_here: Sequence[Rollout] | None
) -> list[Finding]:
    """Return findings on an agent behind the gateway.

    ``rollouts_here``: its rollouts in this process, if any.
    """
    findings: list[Finding] = []
    for scene_run in runs:
        where = f"scene {scene_run.rollout.scene}"
        if scene_run.status != "finished":
            got = f"{scene_run.status}: {scene_run.reason}"
            findings.append(
                Finding("error", "gateway", got, "finished", where, _SANDBOX_HINT)
            )
        if scene_run.malformed:
            got = f"{scene_run.malformed} answers malformed"
            findings.append(
                Finding(
                    "error", "gateway", got, "whole answers", where, _UNANSWERED_HINT
                )
            )
    if findings:
        return findings
    pairs: list[tuple[SceneRun, Rollout]] = []
    if rollouts_here:
        pairs = list(zip(runs, rollouts_here, strict=True))
    for scene_run, rollout in pairs:
        if digest(scene_run.rollout) != digest(rollout):
            return [
                Finding(
                    "warning",
                    "gateway",
                    "answers differ in a process of its own",
                    "the answers given in this process",
                    f"scene {scene_run.rollout.scene}",
                    _DIFFERENCE_HINT,
                )
            ]
    memory = max(scene_run.peak_memory for scene_run in runs) >> 20
    text = f"{len(runs)} scenes in a process of its own: {memory} MiB at most"
    return [Finding("ok", "gateway", text)]
