"""Evaluation of agents on the scenes of an env in memory; no files are written."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Unpack

from ..agent import submission_of
from ..cards import Card, with_split
from ..core import long_work
from ..env import MTPEnv
from ..scoring import (
    AgentScores,
    Reference,
    References,
    Report,
    SceneResult,
    SceneScore,
    score_scene,
    stated_hypotheses,
    summarise,
)
from .options import DEFAULTS, RunKeywords, RunOptions, resolve_options
from .playing import AgentFailedError, Finish, Job, first_errors, jobs_of, run_jobs
from .reference import ranked_scenes, reference_for
from .settings import Setting, scenes_of_card, setting_of, training_note

Scores = AgentScores | AgentFailedError


def evaluate(
    agent: object,
    env_id: str | Card,
    options: RunOptions = DEFAULTS,
    **keywords: Unpack[RunKeywords],
) -> Report:
    """Run and score one agent on the scenes of an env.

    See `RunKeywords`.
    ``agent``: an agent object, a function ``build(task)`` or a class that makes one,
    the name of a baseline, or the folder of a submission, with the parameters of its
    manifest. Every scene gets a new agent, or a copy of the object. ``env_id``: id of
    the env, path of its card, or a card. One agent alone has no rank: `compare` gives
    it one. Raises MtpBenchError for errors that the user can mend, such as an agent
    that fails.
    """
    with EnvEvaluation.opened("evaluating", env_id, options, keywords) as evaluation:
        evaluation.card.require_same_scenes(
            "in which agents do not meet the same scenes"
        )
        setting = setting_of(submission_of(agent), evaluation.card)
        evaluation.options.require_usable([setting.submission])
        scores = evaluation.scores([setting], caught=False)
        report, _ = evaluation.report(scores, [setting])
        return report


@dataclass(frozen=True)
class EnvEvaluation:
    """An env, the scenes that agents are scored on, and the options of their runs."""

    env: str | Card  # id, path or card
    options: RunOptions
    card: Card  # with all changes
    scenes: tuple[str, ...]
    left_out: str  # note on scenes without event weights

    @classmethod
    @contextmanager
    def opened(
        cls,
        verb: str,
        env_id: str | Card,
        options: RunOptions,
        keywords: Mapping[str, Any],
    ) -> Iterator["EnvEvaluation"]:
        """Yield the evaluation on ranked scenes, with the options of a call.

        ``verb`` names the work in the display of progress. ``keywords``: `RunKeywords`.
        """
        env_id, options = resolve_options(env_id, options, keywords)
        env_name = env_id.id if isinstance(env_id, Card) else env_id
        work = long_work(f"{verb} on {env_name}", progress=options.progress)
        with work as progress:
            options = replace(options, progress=progress)
            env = MTPEnv(env_id, **options.env_keywords)
            # before anything runs, for an error in a file of weights
            ranked = ranked_scenes(env.card, env.scene_names)
            left_out = ""  # continues the text on event weights
            unranked = len(env.scene_names) - len(ranked)
            if unranked:
                left_out = (
                    f"; {unranked} of {len(env.scene_names)} scenes of the split have "
                    "none and are left out"
                )
            yield cls(env_id, options, env.card, options.chosen(ranked), left_out)

    def first_errors(
        self, settings: Sequence[Setting]
    ) -> list[AgentFailedError | None]:
        """Return the errors of building agents and resetting them for the first scene.

        None for the setting of an agent that is ready.
        """
        jobs: list[Job] = []
        for setting in settings:
            jobs += self.jobs(setting, self.options.seeds[0], self.scenes[:1])
        return first_errors(jobs, self.options)

    def scores(self, settings: Sequence[Setting], caught: bool = True) -> list[Scores]:
        """Return the scores of each setting under all seeds, or its first error.

        Without ``caught`` the error is raised.
        """
        return [
            runs if isinstance(runs, AgentFailedError) else scores_of(setting, runs)
            for setting, runs in self.runs(settings, score_scene, caught)
        ]

    def runs(
        self, settings: Sequence[Setting], finish: Finish, caught: bool = True
    ) -> Iterator[tuple[Setting, list[tuple[Any, ...]] | AgentFailedError]]:
        """Yield each setting with its runs, or with its first error.

        There is a run for each seed: the result of ``finish`` for each scene. Without
        ``caught`` the error is raised.
        """
        jobs: list[Job] = []
        for setting in settings:
            for seed in self.options.seeds:
                jobs += self.jobs(setting, seed, self.scenes)

        def end_scene(index: int, result: Any) -> None:
            if self.options.on_scene is not None and isinstance(result, SceneScore):
                job = jobs[index]
                self.options.on_scene(SceneResult.of(job.agent, job.seed, result))

        results = iter(run_jobs(jobs, self.options, finish, end_scene, caught))
        for setting in settings:
            runs = [
                tuple(itertools.islice(results, len(self.scenes)))
                for _ in self.options.seeds
            ]
            setting_results = itertools.chain(*runs)
            errors = (r for r in setting_results if isinstance(r, AgentFailedError))
            yield setting, next(errors, runs)

    def report(
        self,
        scores: Sequence[Any],
        settings: Sequence[Setting],
        references: Mapping[str, References | None] | None = None,
        with_each_other: bool = False,
    ) -> tuple[Report, Reference]:
        """Return the report of the ``scores`` of ``settings``, and the event weights.

        ``references`` and ``with_each_other``: as of `summarise`.
        """
        event_weights = reference_for(self.card, self.scenes, self.options)
        report = summarise(
            scores,
            self.card,
            event_weights,
            references=references,
            with_each_other=with_each_other,
        )
        # the line on weights also names the scenes that have none
        report.condition["weights"] += self.left_out
        agents_of_note: dict[str, list[str]] = {}
        for setting in settings:
            note = training_note(setting.submission, self.card)
            if note:
                names = agents_of_note.setdefault(note, [])
                if setting.submission.name not in names:
                    names.append(setting.submission.name)
        if agents_of_note:
            report.condition["trained"] = "; ".join(
                f"{note}: {', '.join(names)}" for note, names in agents_of_note.items()
            )
            training_card = with_split(self.card, "train")
            shared = scenes_of_card(self.scenes, training_card, self.options.data)
            if shared:
                report.condition["trained"] += f". These scenes: {', '.join(shared)}"
        return report, event_weights

    def jobs(self, setting: Setting, seed: int, scenes: Sequence[str]) -> list[Job]:
        """Return the jobs of a setting on ``scenes``.

        Raises MtpBenchError if stored tracks are needed and not named.
        """
        keywords = {**self.options.env_keywords, **setting.env_keywords(self.card)}
        if setting.observe == "tracks":
            keywords |= self.options.shown_to(setting.submission)
        return jobs_of(
            setting.submission,
            self.env,
            keywords,
            scenes,
            seed,
            setting.parameters,
            setting.label,
        )


def scores_of(setting: Setting, seeds: Sequence[tuple[SceneScore, ...]]) -> AgentScores:
    """Return the scores of a setting, a run per seed."""
    return AgentScores(
        setting.label,
        setting.hypotheses or stated_hypotheses(seeds),
        setting.samples,
        setting.budget,
        tuple(seeds),
        setting.observe,
    )
