"""Agents side by side on one env, always with the controls that tell hypotheses from sampling."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from ..env.environment import MTPEnv
from ..errors import MtpBenchError
from ..scoring import AgentScores, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..submission.loader import load_submission
from .frozen_subsets import Reference, find_reference, frozen_reference, reference_of
from .options import DEFAULTS, RunOptions
from .reading import total_skipped
from .run import Job, jobs_of, run_jobs
from .settings import Setting, all_settings

TRUTH, STP = "truth_past", "stp"
CONTROLS = (TRUTH, STP, "stp_same_budget", "stp_hedged")  # protocol, "Controls that every comparison prints"


@dataclass(frozen=True)
class Comparison:
    """A comparison and the events that its subsets come from."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def compare(
    names: Sequence[str], env_id: str, options: RunOptions = DEFAULTS, reference: str | None = None
) -> Comparison:
    """Run and score the controls and other agents on the scenes of an env.

    Args:
        names: Folders of submissions, or names of baselines.
        env_id: Id of the env or path of its card.
        options: Data, scenes, seeds, changes of the card, workers and progress.
        reference: Another agent, whose own events define the subsets in place of the frozen ones: a look, no ranking.

    Raises MtpBenchError for whatever the user can mend.
    """
    env = MTPEnv(env_id, **options.env_keywords)
    card, scenes = env.card, env.scene_names[: options.scenes]
    wanted = reference or card.reference
    settings = all_settings([*CONTROLS, *names, wanted], card)
    place = _reference_place(settings, wanted)
    frozen_reference(card)  # a broken file shows before anything runs
    jobs: list[Job] = []
    for setting, seed in itertools.product(settings, options.seeds):
        keywords = {**options.env_keywords, **setting.env_keywords(card)}
        jobs += jobs_of(setting.submission, env_id, keywords, scenes, seed, setting.parameters, setting.label)
    scores: list[SceneScore] = run_jobs(jobs, options, score_scene)
    runs = iter([tuple(scores[i : i + len(scenes)]) for i in range(0, len(scores), len(scenes))])
    agents = []
    for s in settings:
        seeds = tuple(next(runs) for _ in options.seeds)
        hypotheses = s.hypotheses or stated_hypotheses(seeds)
        agents.append(AgentScores(s.label, hypotheses, s.samples, s.budget, seeds, s.ideal))
    own, first = settings[place].submission.name == card.reference, agents[place].seeds[0]
    subsets = find_reference(card, first) if own else reference_of(card, first, agents[place].agent)
    report = summarise(agents, card, subsets.subsets, stp=STP, truth=TRUTH)
    skipped = total_skipped(score.skipped for score in scores[: len(scenes)])  # every setting reads the same scenes
    return Comparison(report, subsets, tuple(settings), skipped)


def _reference_place(settings: Sequence[Setting], name: str) -> int:
    """Where the row of the agent is whose events define the subsets: with its own parameters, else its first."""
    submission = load_submission(name).name
    rows = [i for i, s in enumerate(settings) if s.submission.name == submission and s.budget == "equal"]
    if not rows:
        raise MtpBenchError(f"reference {name!r} has no row with equal k in this comparison")
    return next((i for i in rows if settings[i].parameters == settings[i].submission.parameters), rows[0])
