"""Check that a submission keeps the contract of an agent, in this process and behind the gateway."""

from collections.abc import Sequence
from typing import Any

from ...agent import Submission, SubmissionFactory
from ...core import Rollout
from ...env import MTPEnv, digest
from ...running import Finding, RunOptions, check_agent, jobs_of, run_jobs
from ..gateway.limits import SceneRun
from ..gateway.run import run_isolated_scenes

SCENES = 3  # at most


def check_submission(
    submission: Submission, env_id: str, options: RunOptions
) -> list[Finding]:
    """Check a submission on the first scenes of an env; actions of its agent never raise.

    ``options``: data, scenes and progress. Raises MtpBenchError for a missing env or data.
    """
    progress = options.progress
    keywords: dict[str, Any] = {
        "data": options.data,
        **options.shown_to(submission),
        "evaluation": True,
    }
    names = options.chosen(MTPEnv(env_id, **keywords).scene_names)
    progress.started(1 + len(names))
    runs = run_isolated_scenes(
        submission.path, env_id, keywords, scenes=names, progress=progress
    )
    # an agent that hung, broke the rules or ended its process would take this process with it
    if any(
        run.status in ("hung", "rejected") or run.reason.startswith("the process ")
        for run in runs
    ):
        return gateway_findings(runs, None)
    make = SubmissionFactory(str(submission.path), submission.parameters)
    findings = check_agent(make, env_id, names[:2], keywords)
    progress.done("conformance")
    if not any(finding.level == "error" for finding in findings):
        findings += gateway_findings(
            runs, run_jobs(jobs_of(submission, env_id, keywords, names))
        )
    return findings


def gateway_findings(
    runs: Sequence[SceneRun], here: Sequence[Rollout] | None
) -> list[Finding]:
    """Findings on an agent behind the gateway; ``here``: its rollouts in this process, if any."""
    findings: list[Finding] = []
    for run in runs:
        where = f"scene {run.rollout.scene}"
        if run.status != "finished":
            advice = "it runs alone there: its own folder, no data, no network, bounded memory"
            findings.append(
                Finding(
                    "error",
                    "gateway",
                    f"{run.status}: {run.reason}",
                    "finished",
                    where,
                    advice,
                )
            )
        if run.malformed:
            got, advice = (
                f"{run.malformed} answers malformed",
                "these frames count as unanswered",
            )
            findings.append(
                Finding("error", "gateway", got, "whole answers", where, advice)
            )
    pairs = zip(runs, here or [run.rollout for run in runs], strict=True)
    others = [
        run.rollout.scene
        for run, rollout in pairs
        if digest(run.rollout) != digest(rollout)
    ]
    if others and not findings:
        advice = (
            "look for hash(), the order of sets, the number of threads, the environment"
        )
        got, where = "answers differ in a process of its own", f"scene {others[0]}"
        findings.append(
            Finding(
                "warning",
                "gateway",
                got,
                "the answers given in this process",
                where,
                advice,
            )
        )
    text = f"{len(runs)} scenes in a process of its own: {max(run.peak_memory for run in runs) >> 20} MiB at most"
    return findings or [Finding("ok", "gateway", text)]
