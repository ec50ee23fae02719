"""Score agents on the scenes of an env in memory: no files are written."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Unpack

from ..cards import Card
from ..env.environment import MTPEnv
from ..parallel import reported
from ..scoring import AgentScores, Reference, Report, SceneScore, score_scene, stated_hypotheses, summarise
from ..scoring.scenes import SceneResult
from ..submission.objects import submission_of
from .options import DEFAULTS, RunKeywords, RunOptions, asked
from .reference import ranked_scenes, reference_for
from .run import AgentFailedError, Job, first_errors, jobs_of, run_jobs
from .settings import Setting, setting_of, training_note

Scores = AgentScores | AgentFailedError


def evaluate(
    agent: object, env_id: str | Card, options: RunOptions = DEFAULTS, **keywords: Unpack[RunKeywords]
) -> Report:
    """Run and score one agent on the scenes of an env; see `RunKeywords`.

    ``agent``: an agent object, a function ``build(task)`` or a class that makes one, the name of a baseline, or the
    folder of a submission, with the parameters of its manifest. Every scene gets a new agent, or a copy of the object.
    ``env_id``: id of the env, path of its card, or a card. One agent alone has no rank: `compare` gives it one.
    Raises MtpBenchError for errors that the user can mend, such as an agent that fails.
    """
    with EnvEvaluation.opened("evaluating", env_id, options, keywords) as evaluation:
        setting = setting_of(submission_of(agent), evaluation.card)
        evaluation.options.require_usable([setting.submission])
        return evaluation.report(evaluation.scores([setting], caught=False), [setting])[0]


@dataclass(frozen=True)
class EnvEvaluation:
    """An env, the scenes of it that agents are scored on, and the options of their runs."""

    env: str | Card  # id, path or card
    options: RunOptions
    card: Card  # with all changes
    scenes: tuple[str, ...]
    left_out: str  # note on scenes without event weights

    @classmethod
    @contextmanager
    def opened(
        cls, verb: str, env_id: str | Card, options: RunOptions, keywords: Mapping[str, Any]
    ) -> Iterator["EnvEvaluation"]:
        """The scenes that agents are ranked on, under the options and `RunKeywords` of a call."""
        env_id, options = asked(env_id, options, keywords)
        with reported(f"{verb} on {getattr(env_id, 'id', env_id)}", own=options.progress) as progress:
            env = MTPEnv(env_id, **options.env_keywords)
            names = env.scene_names
            ranked = ranked_scenes(env.card, names)  # before anything runs, for an error in a file of weights
            note = f"; {len(names) - len(ranked)} of {len(names)} scenes of the split have none and are left out"
            left_out = note if len(ranked) < len(names) else ""
            yield cls(env_id, replace(options, progress=progress), env.card, options.chosen(ranked), left_out)

    def first_errors(self, settings: Sequence[Setting]) -> list[AgentFailedError | None]:
        """Errors of building the agents of settings and of resetting them for the first scene."""
        jobs = (self.jobs(each, self.options.seeds[0], self.scenes[:1]) for each in settings)
        return first_errors(list(itertools.chain(*jobs)), self.options)

    def scores(self, settings: Sequence[Setting], caught: bool = True) -> list[Scores]:
        """Scores of settings under all seeds, or the first error of a setting; without ``caught`` it is raised."""
        pairs = itertools.product(settings, self.options.seeds)
        jobs = list(itertools.chain(*(self.jobs(setting, seed, self.scenes) for setting, seed in pairs)))

        def finished(place: int, result: SceneScore | AgentFailedError) -> None:
            if self.options.on_scene is not None and isinstance(result, SceneScore):
                self.options.on_scene(SceneResult.of(jobs[place].agent, jobs[place].seed, result))

        results = iter(run_jobs(jobs, self.options, score_scene, finished, caught))
        scored: list[Scores] = []
        for setting in settings:
            seeds = [tuple(itertools.islice(results, len(self.scenes))) for _ in self.options.seeds]
            error = next((each for each in itertools.chain(*seeds) if isinstance(each, AgentFailedError)), None)
            scored.append(error or scores_of(setting, seeds))
        return scored

    def report(self, scores: Sequence[Any], settings: Sequence[Setting], **further: Any) -> tuple[Report, Reference]:
        """Report of the ``scores`` of ``settings``, and the event weights; ``further``: of `summarise`."""
        reference = reference_for(self.card, self.scenes, self.options)
        report = summarise(scores, self.card, reference, **further)
        notes: dict[str, list[str]] = {}
        for submission in {setting.submission.name: setting.submission for setting in settings}.values():
            if note := training_note(submission, self.card):
                notes.setdefault(note, []).append(submission.name)
        report.condition["weights"] += self.left_out
        if notes:
            report.condition["trained"] = "; ".join(f"{note}: {', '.join(names)}" for note, names in notes.items())
        return report, reference

    def jobs(self, setting: Setting, seed: int, scenes: Sequence[str]) -> list[Job]:
        """Jobs of a setting on ``scenes``."""
        shown = self.options.shown_to(setting.submission) if setting.observe == "tracks" else {}
        keywords = {**self.options.env_keywords, **setting.env_keywords(self.card), **shown}
        return jobs_of(setting.submission, self.env, keywords, scenes, seed, setting.parameters, setting.label)


def scores_of(setting: Setting, seeds: Sequence[tuple[SceneScore, ...]], agent: str = "") -> AgentScores:
    """The scores of a setting, a run per seed, under the name ``agent`` or its label."""
    hypotheses = setting.hypotheses or stated_hypotheses(seeds)
    label = agent or setting.label
    return AgentScores(label, hypotheses, setting.samples, setting.budget, tuple(seeds), setting.observe)
