"""Agents side by side on one env, always with the controls that tell hypotheses from sampling."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..cards import Card
from ..env import MTPEnv
from ..errors import MtpBenchError
from ..runner import run_jobs
from ..scoring import AgentScores, Report, SceneScore, score_scene, summarise
from .jobs import jobs_of
from .loader import Submission, load_submission
from .reference import Reference, find_reference

TRUTH, STP = "truth_past", "stp"
CONTROLS = (TRUTH, STP, "stp_same_budget", "stp_hedged")  # protocol, "Controls that every comparison prints"


@dataclass(frozen=True)
class Setting:
    """One row of the comparison: a submission with parameters and a number of samples."""

    label: str
    submission: Submission
    parameters: dict[str, Any]
    budget: Literal["equal", "free"]
    hypotheses: int
    samples: int  # K

    def env_keywords(self, card: Card) -> dict[str, Any]:
        """What the env of this setting needs beyond the card."""
        keywords: dict[str, Any] = {"samples": self.samples}
        if self.hypotheses > card.size.hypotheses:
            keywords["hypotheses"] = self.hypotheses
        return keywords


@dataclass(frozen=True)
class Comparison:
    """A comparison and the events that its subsets come from."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    dataset: str  # name of the card's source


def expand(submission: Submission, card: Card) -> list[Setting]:
    """The settings of a submission: its sweep times its budgets, in the order of the manifest."""
    sweep = submission.compare.sweep
    settings = []
    for budget in submission.compare.budgets:
        for values in itertools.product(*sweep.values()):
            chosen = dict(zip(sweep, values, strict=True))
            setting = _setting(submission, chosen, budget, card)
            if budget == "equal" or setting.samples > card.task.samples:
                settings.append(setting)
    return settings


def _setting(submission: Submission, chosen: dict[str, Any], budget: Literal["equal", "free"], card: Card) -> Setting:
    """``chosen`` are the swept parameters; those that are neither the default nor H show in the label."""
    parameters = {**submission.parameters, **chosen}
    hypotheses = int(parameters.get("hypotheses", 1))
    pool = card.task.samples * hypotheses * int(parameters.get("draws", 1))
    shown = [f"{k}={v}" for k, v in chosen.items() if k != "hypotheses" and v != submission.parameters.get(k)]
    return Setting(
        label=" ".join([submission.name, *shown]),
        submission=submission,
        parameters=parameters,
        budget=budget,
        hypotheses=hypotheses,
        samples=pool if budget == "free" else card.task.samples,
    )


def all_settings(names: Sequence[str], card: Card) -> list[Setting]:
    """Settings of the controls, then of the submissions or baselines ``names``, each once."""
    submissions = [load_submission(name) for name in dict.fromkeys([*CONTROLS, *names])]
    seen: dict[str, Submission] = {}
    for submission in submissions:
        if submission.name in seen and seen[submission.name].path != submission.path:
            raise MtpBenchError(
                f"two submissions are called {submission.name!r}: {seen[submission.name].path} and {submission.path}; "
                "give them different names in submission.toml"
            )
        seen.setdefault(submission.name, submission)
    return [setting for submission in seen.values() for setting in expand(submission, card)]


def compare(
    names: Sequence[str],
    env_id: str,
    env_keywords: dict[str, Any] | None = None,
    scenes: int | None = None,
    seeds: Sequence[int] = (0,),
    workers: int = 1,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> Comparison:
    """Run and score the controls and the agents ``names`` on the first ``scenes`` scenes of an env (None: all).

    ``env_keywords`` go to every env (``data``). ``started`` is told the number of runs (settings x seeds x scenes),
    ``progress`` the scene of each finished one. Raises MtpBenchError for whatever the user can mend.
    """
    common = env_keywords or {}
    env = MTPEnv(env_id, **common)
    if scenes is not None and scenes < 1:
        raise MtpBenchError(f"scenes is {scenes}, expected at least 1")
    chosen = env.scene_names[:scenes]
    settings = all_settings(names, env.card)
    jobs = [
        job
        for s in settings
        for seed in seeds
        for job in jobs_of(
            s.submission, env_id, {**common, **s.env_keywords(env.card)}, chosen, seed, s.parameters, s.label
        )
    ]
    if started is not None:
        started(len(jobs))
    results: list[SceneScore] = run_jobs(jobs, workers, score_scene, progress)
    runs = iter([tuple(results[i : i + len(chosen)]) for i in range(0, len(results), len(chosen))])
    agents = [
        AgentScores(s.label, s.hypotheses, s.samples, s.budget, tuple(next(runs) for _ in seeds)) for s in settings
    ]
    stp = next(agent for agent in agents if agent.agent == env.card.reference and agent.budget == "equal")
    reference = find_reference(env.card, stp.seeds[0])
    report = summarise(agents, env.card, reference.subsets, stp=STP, truth=TRUTH)
    return Comparison(report, reference, tuple(settings), env.card.source.name)
