"""What `mtp-bench check` does: the conformance suite, three quick scenes beside STP, and all of it as tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from ..errors import SubmissionError

if TYPE_CHECKING:
    from rich.table import Table

    from ..env.environment import MTPEnv
    from ..gateway import SceneRun
    from ..scoring import SceneScore
    from ..submission import Submission
    from ..testing import Finding
    from ..types import Rollout

SCENES = 3  # that are scored
BESIDE = "stp"
_STYLE = {"error": "bold red", "warning": "yellow", "ok": "green"}


@dataclass(frozen=True)
class Checked:
    """What a check found and scored."""

    submission: str
    env: str
    findings: tuple[Finding, ...]
    scores: tuple[
        dict[str, Any], ...
    ]  # per scene: scene, targets, missing_aware and stp (m), coverage; None: no target

    @property
    def errors(self) -> int:
        """Number of errors; 0 passes."""
        return sum(finding.level == "error" for finding in self.findings)

    def to_json(self) -> dict[str, Any]:
        """The content of ``check --json``."""
        findings = [asdict(finding) for finding in self.findings]
        return {"submission": self.submission, "env": self.env, "findings": findings, "scores": list(self.scores)}


def check_submission(
    path: str, env_id: str, data: str | None, started: Callable[[int], object], done: Callable[[str], object]
) -> Checked:
    """Check a submission on ``env_id``; nothing that its agent does raises.

    Raises MtpBenchError for a folder that cannot be read and an env or data that is not there. ``started`` is told the
    number of steps, ``done`` the name of each.
    """
    from ..env.environment import MTPEnv
    from ..gateway import run_isolated_scenes
    from ..running.jobs import jobs_of
    from ..running.run import run_jobs
    from ..submission import SubmissionFactory, load_submission
    from ..testing import check_agent

    submission = load_submission(path)
    keywords: dict[str, Any] = {"data": data, "observe": submission.compare.observe, "evaluation": True}
    env = MTPEnv(env_id, **keywords)
    names = env.scene_names[:SCENES]
    started(1 + 2 * len(names))
    runs = run_isolated_scenes(submission.path, env_id, keywords, scenes=names, progress=done)
    if any(_unsafe(run) for run in runs):  # it would take this process with it
        return Checked(submission.name, env_id, tuple(gateway_findings(runs, None)), ())
    make = SubmissionFactory(str(submission.path), submission.parameters)
    findings = check_agent(make, env_id, names[:2], keywords)
    done("conformance")
    if any(finding.level == "error" for finding in findings):
        return Checked(submission.name, env_id, tuple(findings), ())
    here = run_jobs(jobs_of(submission, env_id, keywords, names))
    findings += gateway_findings(runs, here)
    own = [_scored(env, run) for run in runs]
    scores = _beside(own, _trusted(load_submission(BESIDE), env_id, data, names, done))
    return Checked(submission.name, env_id, tuple(findings), scores)


def _unsafe(run: SceneRun) -> bool:
    """Whether the agent did worse than to raise: hung, broke the rules, or ended its process."""
    return run.status in ("hung", "rejected") or (run.status == "crashed" and run.reason.startswith("the process "))


def gateway_findings(runs: Sequence[SceneRun], here: Sequence[Rollout] | None) -> list[Finding]:
    """What the gateway says of an agent in a process of its own; ``here`` are its rollouts in this process, if any."""
    from ..env.rollouts import digest
    from ..testing import Finding

    found: list[Finding] = []
    for run in runs:
        where = f"scene {run.rollout.scene}"
        if run.status != "finished":
            advice = "it runs alone there: its own folder, no data, no network, bounded memory"
            found.append(Finding("error", "gateway", f"{run.status}: {run.reason}", "finished", where, advice))
        for frames, what in ((run.late, "too late"), (run.malformed, "malformed")):
            if frames:
                got = f"{frames} answers {what}"
                found.append(Finding("error", "gateway", got, "answers in time and whole", where, "they are missed"))
    pairs = zip(runs, here or [run.rollout for run in runs], strict=True)
    others = [run.rollout.scene for run, rollout in pairs if digest(run.rollout) != digest(rollout)]
    if others and not found:
        advice = "look for hash(), the order of sets, the number of threads, the environment"
        got, where = "answers differ in a process of its own", f"scene {others[0]}"
        found.append(Finding("warning", "gateway", got, "the answers given in this process", where, advice))
    text = (
        f"{len(runs)} scenes in a process of its own: built in at most {max(run.started for run in runs):.1f} s, "
        f"{max(run.peak_memory for run in runs) >> 20} MiB at most"
    )
    return found or [Finding("ok", "gateway", text)]


def _scored(env: MTPEnv, run: SceneRun) -> SceneScore:
    from ..scoring import score_scene

    env.reset(seed=0, options={"scene": run.rollout.scene})
    return score_scene(env.scene, run.rollout, env.card)


def _trusted(
    submission: Submission, env_id: str, data: str | None, names: Sequence[str], done: Callable[[str], object]
) -> list[SceneScore]:
    """Scores of a baseline, in this process."""
    from ..running.jobs import jobs_of
    from ..running.run import run_jobs
    from ..scoring import score_scene

    return list(run_jobs(jobs_of(submission, env_id, {"data": data}, names), finish=score_scene, progress=done))


def _beside(own: Sequence[SceneScore], stp: Sequence[SceneScore]) -> tuple[dict[str, Any], ...]:
    from ..scoring import mean_error

    return tuple(
        {
            "scene": score.scene,
            "targets": len(score),
            "missing_aware": mean_error([score]),
            BESIDE: mean_error([other]),
            "coverage": float(score.covered.mean()) if len(score) else None,
        }
        for score, other in zip(own, stp, strict=True)
    )


def finding_table(checked: Checked) -> Table:
    """The findings; what was expected, where and what to do stands below each that is not ok."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(f"{checked.submission} on {checked.env}"), title_justify="left")
    table.add_column("", no_wrap=True)
    table.add_column("check", no_wrap=True)
    table.add_column("found", overflow="fold")
    for finding in checked.findings:
        lines = [finding.got, *(f"  {line}" for line in finding.traceback)]
        for label, text in (("expected", finding.expected), ("where", finding.where), ("to do", finding.advice)):
            lines += [f"{label}: {text}"] if text else []
        style = _STYLE[finding.level]
        table.add_row(f"[{style}]{finding.level}[/{style}]", finding.check, escape("\n".join(lines)))
    return table


def score_table(checked: Checked) -> Table:
    """Missing-aware error per scene beside STP's."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="missing-aware error (m), lower is better", title_justify="left")
    for heading in ("scene", "targets", escape(checked.submission), BESIDE, "covered"):
        table.add_column(heading, justify="left" if heading == "scene" else "right")
    for row in checked.scores:
        cells = [f"{row[key]:.3f}" if row[key] is not None else "–" for key in ("missing_aware", BESIDE)]
        covered = "–" if row["coverage"] is None else f"{row['coverage']:.0%}"
        table.add_row(escape(row["scene"]), str(row["targets"]), *cells, covered)
    return table


def verdict(checked: Checked, path: str) -> str:
    """What to do with a submission that passed; raises SubmissionError for one that did not."""
    import shlex

    if checked.errors:
        noun = "1 error" if checked.errors == 1 else f"{checked.errors} errors"
        raise SubmissionError(f"{checked.submission} does not pass: {noun}; the table says what, where and what to do")
    return f"{checked.submission} passes; next: `mtp-bench compare {shlex.quote(path)} --env {checked.env}`"
