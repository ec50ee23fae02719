"""Score agents on the scenes of an env in memory: no files are written."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Unpack

from ..cards import Card
from ..env.environment import MTPEnv
from ..parallel import SERIAL, reported
from ..scoring import AgentScores, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..scoring.scenes import SceneResult
from ..submission.objects import ObjectSubmission, submission_of
from .options import DEFAULTS, RunKeywords, RunOptions, asked
from .reference import ranked_scenes, reference_for
from .run import AgentFailedError, Job, jobs_of, run_jobs
from .settings import Setting, setting_of, training_note


def evaluate(
    agent: object, env_id: str | Card, options: RunOptions = DEFAULTS, **keywords: Unpack[RunKeywords]
) -> Report:
    """Run and score one agent on the scenes of an env; see `RunKeywords`.

    ``agent``: an agent object, a function ``build(task)`` or a class that makes one, the name of a baseline, or the
    folder of a submission, with the parameters of its manifest. Every scene gets a new agent, or a copy of the object.
    ``env_id``: id of the env, path of its card, or a card. One agent alone has no rank: `compare` gives it one.
    Raises MtpBenchError for errors that the user can mend, such as an agent that fails.
    """
    env_id, options = asked(env_id, options, keywords)
    with reported(f"evaluating on {getattr(env_id, 'id', env_id)}", own=options.progress) as progress:
        return _evaluated(agent, env_id, replace(options, progress=progress))


def _evaluated(agent: object, env_id: str | Card, options: RunOptions) -> Report:
    ranked = RankedScenes.of(env_id, options)
    setting = setting_of(submission_of(agent), ranked.card)
    options.require_tracks_used([setting.submission])
    require_copies([setting], options)
    (scores,) = score_settings([setting], env_id, ranked.card, ranked.chosen, options)
    report = summarise([scores], ranked.card, reference_for(ranked.card, ranked.chosen, options))
    report.condition.update(training_notes([setting], ranked.card) | ranked.note(report))
    return report


@dataclass(frozen=True)
class RankedScenes:
    """Scenes of an env that agents are ranked on."""

    card: Card  # with all changes
    names: tuple[str, ...]  # of the split
    chosen: tuple[str, ...]  # of those with event weights, the ones to run
    missing: int  # scenes of the split without event weights, left out

    @classmethod
    def of(cls, env_id: str | Card, options: RunOptions) -> RankedScenes:
        """The scenes of an env under ``options``."""
        env = MTPEnv(env_id, **options.env_keywords)
        ranked = ranked_scenes(env.card, env.scene_names)
        return cls(env.card, env.scene_names, options.chosen(ranked), len(env.scene_names) - len(ranked))

    def note(self, report: Report) -> dict[str, str]:
        """The condition "weights" of a report, with the number of scenes that are left out."""
        left_out = f"; {self.missing} of {len(self.names)} scenes of the split have none and are left out"
        return {"weights": report.condition["weights"] + (left_out if self.missing else "")}


def jobs_of_setting(
    setting: Setting, seed: int, env_id: str | Card, card: Card, scenes: Sequence[str], options: RunOptions
) -> list[Job]:
    """Jobs of a setting under one seed, one per scene."""
    shown = options.shown_to(setting.submission) if setting.observe == "tracks" else {}
    keywords = {**options.env_keywords, **setting.env_keywords(card), **shown}
    return jobs_of(setting.submission, env_id, keywords, scenes, seed, setting.parameters, setting.label)


def score_settings(
    settings: Sequence[Setting], env_id: str | Card, card: Card, scenes: Sequence[str], options: RunOptions
) -> list[AgentScores]:
    """Run and score each setting on the ``scenes`` with all seeds of ``options``; ``card``: of the env.

    Raises AgentFailedError.
    """
    results = caught_scores(settings, env_id, card, scenes, options, caught=False)
    return [result for result in results if isinstance(result, AgentScores)]


def caught_scores(
    settings: Sequence[Setting],
    env_id: str | Card,
    card: Card,
    scenes: Sequence[str],
    options: RunOptions,
    caught: bool = True,
) -> list[AgentScores | AgentFailedError]:
    """The scores of `score_settings`, or the first error of a setting, by scenes."""
    pairs = itertools.product(settings, options.seeds)
    jobs = list(itertools.chain(*(jobs_of_setting(each, seed, env_id, card, scenes, options) for each, seed in pairs)))

    def finished(place: int, result: SceneScore | AgentFailedError) -> None:
        if options.on_scene is not None and isinstance(result, SceneScore):
            options.on_scene(SceneResult.of(jobs[place].agent, jobs[place].seed, result))

    results = iter(run_jobs(jobs, options, score_scene, finished, caught))
    scored: list[AgentScores | AgentFailedError] = []
    for setting in settings:
        seeds = [tuple(itertools.islice(results, len(scenes))) for _ in options.seeds]
        error = next((each for each in itertools.chain(*seeds) if isinstance(each, AgentFailedError)), None)
        scored.append(error or scores_of(setting, seeds))
    return scored


def scores_of(setting: Setting, seeds: Sequence[tuple[SceneScore, ...]], agent: str = "") -> AgentScores:
    """The scores of a setting, a run per seed, under the name ``agent`` or its label."""
    return AgentScores(
        agent=agent or setting.label,
        hypotheses=setting.hypotheses or stated_hypotheses(seeds),
        samples=setting.samples,
        budget=setting.budget,
        seeds=tuple(seeds),
        observe=setting.observe,
    )


def require_copies(settings: Sequence[Setting], options: RunOptions) -> None:
    """Raise MtpBenchError for an object that cannot be sent to the other processes of ``options``."""
    for setting in settings if options.workers != SERIAL else ():
        if isinstance(setting.submission, ObjectSubmission):
            setting.submission.require_copy()


def training_notes(settings: Sequence[Setting], card: Card) -> dict[str, str]:
    """Submissions trained on scenes that are scored here, under the one key "trained"; empty without any."""
    notes: dict[str, list[str]] = {}
    for submission in {setting.submission.name: setting.submission for setting in settings}.values():
        note = training_note(submission, card)
        if note is not None:
            notes.setdefault(note, []).append(submission.name)
    return {"trained": "; ".join(f"{note}: {', '.join(names)}" for note, names in notes.items())} if notes else {}
