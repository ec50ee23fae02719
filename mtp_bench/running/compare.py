"""Agents side by side on one env, always with the controls that tell hypotheses from sampling."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ..cards import Card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError, SubmissionError
from ..parallel import Workers
from ..scoring import AgentScores, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..submission.loader import Submission, load_submission
from .jobs import jobs_of
from .reading import total_skipped
from .reference import Reference, find_reference, frozen_reference, reference_of
from .run import Job, run_jobs

TRUTH, STP = "truth_past", "stp"
CONTROLS = (TRUTH, STP, "stp_same_budget", "stp_hedged")  # protocol, "Controls that every comparison prints"


@dataclass(frozen=True)
class Setting:
    """One row of the comparison: a submission with parameters and a number of samples."""

    label: str
    submission: Submission
    parameters: dict[str, Any]
    budget: Literal["equal", "free"]
    hypotheses: int | None  # as declared; None: what the agent states will tell
    samples: int  # K

    @property
    def ideal(self) -> bool:
        """Whether the agent is fed the truth."""
        return self.submission.compare.observe == "truth"

    def env_keywords(self, card: Card) -> dict[str, Any]:
        """What the env of this setting needs beyond the card."""
        keywords: dict[str, Any] = {"samples": self.samples}
        if self.hypotheses and self.hypotheses > card.size.hypotheses:
            keywords["hypotheses"] = self.hypotheses
        return keywords


@dataclass(frozen=True)
class Comparison:
    """A comparison and the events that its subsets come from."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def expand(submission: Submission, card: Card) -> list[Setting]:
    """The settings of a submission: its sweep times its budgets, in the order of the manifest."""
    sweep = submission.compare.sweep
    settings = []
    for budget in submission.compare.budgets:
        for values in itertools.product(*sweep.values()):
            chosen = dict(zip(sweep, values, strict=True))
            setting = setting_of(submission, card, chosen, budget)
            if (budget == "equal" or setting.samples > card.task.samples) and setting not in settings:
                settings.append(setting)
    return settings


def setting_of(
    submission: Submission, card: Card, chosen: dict[str, Any] | None = None, budget: Literal["equal", "free"] = "equal"
) -> Setting:
    """A submission with its own parameters and ``chosen``: those that are neither the default nor H show in the label.

    Raises SubmissionError unless the parameters that count samples are whole numbers.
    """
    chosen = chosen or {}
    parameters = {**submission.parameters, **chosen}
    hypotheses = _count(submission, parameters, "hypotheses")
    draws = _count(submission, parameters, "draws") or 1
    shown = [f"{k}={v}" for k, v in chosen.items() if k != "hypotheses" and v != submission.parameters.get(k)]
    return Setting(
        label=" ".join([submission.name, *shown]),
        submission=submission,
        parameters=parameters,
        budget=budget,
        hypotheses=hypotheses,
        samples=card.task.samples * ((hypotheses or 1) * draws if budget == "free" else 1),
    )


def _count(submission: Submission, parameters: dict[str, Any], name: str) -> int | None:
    if name not in parameters:
        return None
    value = parameters[name]
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise SubmissionError(
            f"{submission.name}: parameter {name!r} is {value!r}, expected a whole number of at least 1"
        )
    return int(value)


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
    reference: str | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
) -> Comparison:
    """Run and score the controls and the agents ``names`` on the first ``scenes`` scenes of an env (None: all).

    ``env_keywords`` go to every env (``data``). ``started`` is told the number of runs (settings x seeds x scenes),
    ``progress`` the scene of each finished one. ``reference`` names another agent whose own events define the subsets
    in place of the frozen ones: a look, not a ranking. ``backend`` and ``scheduler`` as in `run_jobs`. Raises
    MtpBenchError for whatever the user can mend.
    """
    common = env_keywords or {}
    env = MTPEnv(env_id, **common)
    if scenes is not None and scenes < 1:
        raise MtpBenchError(f"scenes is {scenes}, expected at least 1")
    chosen = env.scene_names[:scenes]
    wanted = reference or env.card.reference
    settings = all_settings([*names, wanted], env.card)
    place = _reference_place(settings, wanted)
    frozen_reference(env.card)  # a broken file shows before anything runs
    jobs = [job for s in settings for seed in seeds for job in _jobs(s, env_id, env.card, common, chosen, seed)]
    if started is not None:
        started(len(jobs))
    scores: list[SceneScore] = run_jobs(jobs, Workers(workers, backend, scheduler), score_scene, progress)
    runs = iter([tuple(scores[i : i + len(chosen)]) for i in range(0, len(scores), len(chosen))])
    agents = [_agent_scores(setting, tuple(next(runs) for _ in seeds)) for setting in settings]
    subsets = _subsets(env.card, agents[place], own=settings[place].submission.name == env.card.reference)
    report = summarise(agents, env.card, subsets.subsets, stp=STP, truth=TRUTH)
    skipped = total_skipped(score.skipped for score in scores[: len(chosen)])  # every setting reads the same scenes
    return Comparison(report, subsets, tuple(settings), skipped)


def _jobs(
    setting: Setting, env_id: str, card: Card, keywords: dict[str, Any], scenes: Sequence[str], seed: int
) -> list[Job]:
    keywords = {**keywords, **setting.env_keywords(card)}
    return jobs_of(setting.submission, env_id, keywords, scenes, seed, setting.parameters, setting.label)


def _agent_scores(setting: Setting, seeds: tuple[tuple[SceneScore, ...], ...]) -> AgentScores:
    hypotheses = setting.hypotheses or stated_hypotheses(seeds)
    return AgentScores(setting.label, hypotheses, setting.samples, setting.budget, seeds, setting.ideal)


def _reference_place(settings: Sequence[Setting], name: str) -> int:
    """Where the row of the agent is whose events define the subsets: with its own parameters, else its first."""
    submission = load_submission(name).name
    rows = [i for i, s in enumerate(settings) if s.submission.name == submission and s.budget == "equal"]
    if not rows:
        raise MtpBenchError(f"reference {name!r} has no row with equal k in this comparison")
    return next((i for i in rows if settings[i].parameters == settings[i].submission.parameters), rows[0])


def _subsets(card: Card, agent: AgentScores, own: bool) -> Reference:
    """Subsets by the events of ``agent``, or the frozen ones where it is the card's ``own`` reference."""
    return find_reference(card, agent.seeds[0]) if own else reference_of(card, agent.seeds[0], agent.agent)
