"""Check a submission before it is run for a record: contract, gateway, and scores against the reference tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ..env.environment import MTPEnv
from ..env.rollouts import digest
from ..gateway import SceneRun, run_isolated_scenes
from ..parallel import Progress
from ..running.options import RunOptions
from ..running.reference import reference_agent
from ..running.run import jobs_of, run_jobs
from ..scoring import SceneScore, mean_plain_error, score_scene
from ..submission import SubmissionFactory, load_submission
from ..testing import Finding, check_agent
from ..types import Rollout

SCENES = 3  # that are scored


@dataclass(frozen=True)
class SubmissionCheck:
    """Findings and scores of a check."""

    submission: str
    env: str
    findings: tuple[Finding, ...]
    scores: tuple[dict[str, Any], ...] = ()  # per scene, see `_row`
    reference: str = ""  # baseline that was scored beside it

    @property
    def errors(self) -> int:
        """Number of errors; 0 passes."""
        return sum(finding.level == "error" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """Content of ``check --json``."""
        findings = [asdict(finding) for finding in self.findings]
        return {"submission": self.submission, "env": self.env, "findings": findings, "scores": list(self.scores)}


def check_submission(path: str, env_id: str, options: RunOptions) -> SubmissionCheck:
    """Check a submission on the first scenes of an env; actions of its agent never raise.

    ``options`` give data, scenes and progress. Raises MtpBenchError for a folder that cannot be read and an env or
    data that is not there.
    """
    submission, progress = load_submission(path), options.progress
    keywords: dict[str, Any] = {"data": options.data, **options.shown_to(submission), "evaluation": True}
    env = MTPEnv(env_id, **keywords)
    names = options.chosen(env.scene_names)
    progress.started(1 + 2 * len(names))
    runs = run_isolated_scenes(submission.path, env_id, keywords, scenes=names, progress=progress)
    if any(_unsafe(run) for run in runs):  # it would take this process with it
        return SubmissionCheck(submission.name, env_id, tuple(gateway_findings(runs, None)))
    make = SubmissionFactory(str(submission.path), submission.parameters)
    findings = check_agent(make, env_id, names[:2], keywords)
    progress.done("conformance")
    if any(finding.level == "error" for finding in findings):
        return SubmissionCheck(submission.name, env_id, tuple(findings))
    here = run_jobs(jobs_of(submission, env_id, keywords, names))
    findings += gateway_findings(runs, here)
    own = []
    for run in runs:
        env.reset(seed=0, options={"scene": run.rollout.scene})
        own.append(score_scene(env.scene, run.rollout, env.card))
    jobs = jobs_of(load_submission(reference_agent(env.card)), env_id, {"data": options.data}, names)
    beside = run_jobs(jobs, RunOptions(progress=Progress(done=progress.done)), score_scene)
    reference = reference_agent(env.card)
    scores = tuple(_row(each, other, reference) for each, other in zip(own, beside, strict=True))
    return SubmissionCheck(submission.name, env_id, tuple(findings), scores, reference)


def _unsafe(run: SceneRun) -> bool:
    """True if the agent hung, broke the rules or ended its process."""
    return run.status in ("hung", "rejected") or (run.status == "crashed" and run.reason.startswith("the process "))


def gateway_findings(runs: Sequence[SceneRun], here: Sequence[Rollout] | None) -> list[Finding]:
    """Findings on an agent behind the gateway; ``here``: its rollouts in this process, if any."""
    findings: list[Finding] = []
    for run in runs:
        where = f"scene {run.rollout.scene}"
        if run.status != "finished":
            advice = "it runs alone there: its own folder, no data, no network, bounded memory"
            findings.append(Finding("error", "gateway", f"{run.status}: {run.reason}", "finished", where, advice))
        for frames, what in ((run.late, "too late"), (run.malformed, "malformed")):
            if frames:
                got, advice = f"{frames} answers {what}", "these frames count as unanswered"
                findings.append(Finding("error", "gateway", got, "answers in time and whole", where, advice))
    pairs = zip(runs, here or [run.rollout for run in runs], strict=True)
    others = [run.rollout.scene for run, rollout in pairs if digest(run.rollout) != digest(rollout)]
    if others and not findings:
        advice = "look for hash(), the order of sets, the number of threads, the environment"
        got, where = "answers differ in a process of its own", f"scene {others[0]}"
        findings.append(Finding("warning", "gateway", got, "the answers given in this process", where, advice))
    text = (
        f"{len(runs)} scenes in a process of its own: built in at most {max(run.started for run in runs):.1f} s, "
        f"{max(run.peak_memory for run in runs) >> 20} MiB at most"
    )
    return findings or [Finding("ok", "gateway", text)]


def _row(own: SceneScore, beside: SceneScore, reference: str) -> dict[str, Any]:
    """Plain error of one scene (m), coverage and false forecasts, beside those of the reference; None if undefined."""
    return {
        "scene": own.scene,
        "targets": len(own),
        "plain_error": mean_plain_error([own]),
        reference: mean_plain_error([beside]),
        "coverage": float(own.covered.mean()) if len(own) else None,
        "false_forecasts": own.false_forecasts if own.truth_complete else None,
        f"{reference}_false_forecasts": beside.false_forecasts if own.truth_complete else None,
    }
