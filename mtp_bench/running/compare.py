"""Agents side by side on one env, with the controls that separate hypotheses from sampling."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..cards import Card
from ..env.environment import MTPEnv
from ..scoring import (
    AgentScores,
    Reference,
    References,
    Report,
    SceneScore,
    score_scene,
    stated_hypotheses,
    summarise,
)
from ..submission.loader import controls
from ..submission.manifest import Role
from .options import DEFAULTS, RunOptions
from .reading import total_skipped
from .reference import ranked_scenes, reference_for
from .run import Job, jobs_of, run_jobs
from .settings import Setting, all_settings, references_of, require_list

# docs/definitions, "Controls"
CONTROLS: tuple[Role, ...] = (
    "ground_truth", "single", "same_samples", "hedged", "associated", "associated_same_samples",
)  # fmt: skip
_IN_FULL: tuple[Role, ...] = ("hedged", "associated")  # controls that the main table leaves out


@dataclass(frozen=True)
class Comparison:
    """A comparison, and the event weights of its subsets."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason


def compare(names: Sequence[str], env_id: str | Card, options: RunOptions = DEFAULTS) -> Comparison:
    """Run and score the controls and other agents on the scenes of an env.

    ``names``: folders of submissions, or names of baselines. ``env_id``: id of the env, path of its card, or a card.
    Event weights are the frozen ones of the env, else made from these scenes. Raises MtpBenchError for errors that the
    user can mend.
    """
    require_list(names)
    env = MTPEnv(env_id, **options.env_keywords)
    # first, for an error in a file of weights
    card, ranked = env.card, ranked_scenes(env.card, env.scene_names)
    scenes, role = options.chosen(ranked), controls()
    settings = all_settings([*control_names(), *names], card)
    options.require_tracks_used([setting.submission for setting in settings])
    # of several numbers of hypotheses under one label, the references of the last
    stated = {setting.label: references_of(setting, card) for setting in settings if setting.budget == "equal"}
    runs, known = list(settings), [replace(setting, label="") for setting in settings]
    for each in itertools.chain(*(references.values() for references in stated.values())):
        if (run := replace(each, label="")) not in known:
            runs.append(each)
            known.append(run)
            # they run last: errors show before anything runs
            each.submission.require_parameters(**each.parameters)
    agents = score_settings(runs, env_id, card, scenes, options)
    own = {
        label: References(**{name: agents[known.index(replace(each, label=""))] for name, each in references.items()})
        if references
        else None
        for label, references in stated.items()
    }
    reference = reference_for(card, scenes, options)
    report = summarise(
        agents[: len(settings)], card, reference, stp=role["single"], truth=role["ground_truth"], references=own
    )
    hidden = {role[each] for each in _IN_FULL} - set(map(str, names))
    shown = dict.fromkeys(setting.submission.name for setting in settings)
    report = replace(report, shown=[name for name in shown if name not in hidden])
    report.condition.update(_training_notes(settings, card))
    if len(ranked) < len(env.scene_names):
        missing = f"{len(env.scene_names) - len(ranked)} of {len(env.scene_names)} scenes of the split have none"
        report.condition["weights"] += f"; {missing} and are left out"
    skipped: dict[str, int] = {}
    for agent in agents:  # every setting reads the same scenes, but only some read stored tracks
        skipped |= total_skipped(score.skipped for score in agent.seeds[0])
    return Comparison(report, reference, tuple(settings), skipped)


def control_names() -> list[str]:
    """Names of the baselines that every comparison runs."""
    return [controls()[role] for role in CONTROLS]


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
        observe=setting.observe,
    )


def _training_notes(settings: Sequence[Setting], card: Card) -> dict[str, str]:
    """Submissions trained on scenes that are scored here, under the one key "trained"; empty without any."""
    notes: dict[str, list[str]] = {}
    for submission in {setting.submission.name: setting.submission for setting in settings}.values():
        note = submission.note_on(card.id, card.source.name)
        if note is not None:
            notes.setdefault(note, []).append(submission.name)
    return {"trained": "; ".join(f"{note}: {', '.join(names)}" for note, names in notes.items())} if notes else {}
