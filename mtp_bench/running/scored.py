"""Settings run and scored, as the scorer reads them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from ..cards import Card
from ..scoring import AgentScores, SceneScore, score_scene, stated_hypotheses
from .options import RunOptions
from .run import Job, jobs_of, run_jobs
from .settings import Setting


def score_settings(
    settings: Sequence[Setting], env_id: str | Card, card: Card, scenes: Sequence[str], options: RunOptions
) -> list[AgentScores]:
    """Run and score each setting on the ``scenes`` with all seeds of ``options``; ``card``: of the env."""
    jobs: list[Job] = []
    for setting, seed in itertools.product(settings, options.seeds):
        shown = options.shown_to(setting.submission) if setting.observe == "tracks" else {}
        keywords = {**options.env_keywords, **setting.env_keywords(card), **shown}
        jobs += jobs_of(setting.submission, env_id, keywords, scenes, seed, setting.parameters, setting.label)
    scores: list[SceneScore] = run_jobs(jobs, options, score_scene)
    runs = iter([tuple(scores[i : i + len(scenes)]) for i in range(0, len(scores), len(scenes))])
    return [scores_of(setting, [next(runs) for _ in options.seeds]) for setting in settings]


def scores_of(setting: Setting, seeds: Sequence[tuple[SceneScore, ...]], agent: str = "") -> AgentScores:
    """The scores of a setting, a run per seed, under the name ``agent`` or its label."""
    return AgentScores(
        agent=agent or setting.label,
        hypotheses=setting.hypotheses or stated_hypotheses(seeds),
        samples=setting.samples,
        budget=setting.budget,
        seeds=tuple(seeds),
        ideal=setting.ideal,
        stored_tracks=setting.observe == "tracks",
    )
