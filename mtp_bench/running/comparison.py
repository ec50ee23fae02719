"""Score agents on the scenes of an env in memory: one, or several side by side with the controls; no files are written.

The controls separate hypotheses from sampling.
"""

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Unpack

from ..agent import Role, controls, submission_of
from ..cards import Card
from ..core import SERIAL, MtpBenchError, SubmissionError, reported
from ..env import MTPEnv
from ..scoring import (
    AgentScores,
    Reference,
    References,
    Report,
    SceneResult,
    SceneScore,
    preference,
    score_scene,
    stated_hypotheses,
    summarise,
)
from .options import DEFAULTS, RunKeywords, RunOptions, asked
from .playing import AgentFailedError, Job, first_errors, jobs_of, run_jobs
from .reading import total_skipped
from .reference import ranked_scenes, reference_for
from .settings import (
    Key,
    Setting,
    all_settings,
    references_of,
    require_list,
    setting_of,
    training_note,
)

Scores = AgentScores | AgentFailedError
Runs = Mapping[str, References | None]  # of `summarise`, by agent
CONTROLS: tuple[Role, ...] = (  # docs/definitions, "Controls"
    "ground_truth",
    "single",
    "same_samples",
    "neighbours",
    "bends",
    "associated",
    "associated_same_samples",
)
HYPOTHESIS_CONTROLS: tuple[Role, ...] = (
    "same_samples",
    "neighbours",
)  # a gain of hypotheses is beyond both


def evaluate(
    agent: object,
    env_id: str | Card,
    options: RunOptions = DEFAULTS,
    **keywords: Unpack[RunKeywords],
) -> Report:
    """Run and score one agent on the scenes of an env; see `RunKeywords`.

    ``agent``: an agent object, a function ``build(task)`` or a class that makes one, the name of a baseline, or the
    folder of a submission, with the parameters of its manifest. Every scene gets a new agent, or a copy of the object.
    ``env_id``: id of the env, path of its card, or a card. One agent alone has no rank: `compare` gives it one.
    Raises MtpBenchError for errors that the user can mend, such as an agent that fails.
    """
    with EnvEvaluation.opened("evaluating", env_id, options, keywords) as evaluation:
        evaluation.card.require_same_scenes(
            "in which agents do not meet the same scenes"
        )
        setting = setting_of(submission_of(agent), evaluation.card)
        evaluation.options.require_usable([setting.submission])
        return evaluation.report(evaluation.scores([setting], caught=False), [setting])[
            0
        ]


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
        cls,
        verb: str,
        env_id: str | Card,
        options: RunOptions,
        keywords: Mapping[str, Any],
    ) -> Iterator["EnvEvaluation"]:
        """The scenes that agents are ranked on, under the options and `RunKeywords` of a call."""
        env_id, options = asked(env_id, options, keywords)
        with reported(
            f"{verb} on {getattr(env_id, 'id', env_id)}", own=options.progress
        ) as progress:
            env = MTPEnv(env_id, **options.env_keywords)
            names = env.scene_names
            ranked = ranked_scenes(
                env.card, names
            )  # before anything runs, for an error in a file of weights
            note = f"; {len(names) - len(ranked)} of {len(names)} scenes of the split have none and are left out"
            left_out = note if len(ranked) < len(names) else ""
            yield cls(
                env_id,
                replace(options, progress=progress),
                env.card,
                options.chosen(ranked),
                left_out,
            )

    def first_errors(
        self, settings: Sequence[Setting]
    ) -> list[AgentFailedError | None]:
        """Errors of building the agents of settings and of resetting them for the first scene."""
        jobs = (
            self.jobs(each, self.options.seeds[0], self.scenes[:1]) for each in settings
        )
        return first_errors(list(itertools.chain(*jobs)), self.options)

    def scores(self, settings: Sequence[Setting], caught: bool = True) -> list[Scores]:
        """Scores of settings under all seeds, or the first error of a setting; without ``caught`` it is raised."""
        pairs = itertools.product(settings, self.options.seeds)
        jobs = list(
            itertools.chain(
                *(self.jobs(setting, seed, self.scenes) for setting, seed in pairs)
            )
        )

        def finished(place: int, result: SceneScore | AgentFailedError) -> None:
            if self.options.on_scene is not None and isinstance(result, SceneScore):
                self.options.on_scene(
                    SceneResult.of(jobs[place].agent, jobs[place].seed, result)
                )

        results = iter(run_jobs(jobs, self.options, score_scene, finished, caught))
        scored: list[Scores] = []
        for setting in settings:
            seeds = [
                tuple(itertools.islice(results, len(self.scenes)))
                for _ in self.options.seeds
            ]
            error = next(
                (
                    each
                    for each in itertools.chain(*seeds)
                    if isinstance(each, AgentFailedError)
                ),
                None,
            )
            scored.append(error or scores_of(setting, seeds))
        return scored

    def report(
        self,
        scores: Sequence[Any],
        settings: Sequence[Setting],
        references: Runs | None = None,
    ) -> tuple[Report, Reference]:
        """Report of the ``scores`` of ``settings``, and the event weights; ``references``: of `summarise`."""
        reference = reference_for(self.card, self.scenes, self.options)
        report = summarise(scores, self.card, reference, references=references)
        notes: dict[str, list[str]] = {}
        for submission in {
            setting.submission.name: setting.submission for setting in settings
        }.values():
            if note := training_note(submission, self.card):
                notes.setdefault(note, []).append(submission.name)
        report.condition["weights"] += self.left_out
        if notes:
            report.condition["trained"] = "; ".join(
                f"{note}: {', '.join(names)}" for note, names in notes.items()
            )
        return report, reference

    def jobs(self, setting: Setting, seed: int, scenes: Sequence[str]) -> list[Job]:
        """Jobs of a setting on ``scenes``."""
        keywords = {**self.options.env_keywords, **self.env_changes(setting)}
        return jobs_of(
            setting.submission,
            self.env,
            keywords,
            scenes,
            seed,
            setting.parameters,
            setting.label,
        )

    def env_changes(self, setting: Setting) -> dict[str, Any]:
        """Keywords of the env for one setting; raises MtpBenchError if stored tracks are needed and not given."""
        shown = (
            self.options.shown_to(setting.submission)
            if setting.observe == "tracks"
            else {}
        )
        return {**setting.env_keywords(self.card), **shown}


def scores_of(
    setting: Setting, seeds: Sequence[tuple[SceneScore, ...]], agent: str = ""
) -> AgentScores:
    """The scores of a setting, a run per seed, under the name ``agent`` or its label."""
    hypotheses = setting.hypotheses or stated_hypotheses(seeds)
    label = agent or setting.label
    return AgentScores(
        label,
        hypotheses,
        setting.samples,
        setting.budget,
        tuple(seeds),
        setting.observe,
    )


@dataclass(frozen=True, repr=False)
class Comparison:
    """A comparison, and the event weights of its subsets."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason

    def __repr__(self) -> str:
        first = repr(self.report).partition("\n")[0].removeprefix("Report")
        return f"Comparison{first}\nprint(comparison) shows the table, comparison.report has the numbers"

    def __str__(self) -> str:
        return str(self.report)

    def _repr_html_(self) -> str:
        return self.report._repr_html_()


def compare(
    agents: Iterable[object],
    env_id: str | Card,
    options: RunOptions = DEFAULTS,
    full: bool = True,
    **keywords: Unpack[RunKeywords],
) -> Comparison:
    """Run and score the controls and other agents on the same scenes of an env; see `evaluate` for the arguments.

    ``full``: False runs only what the main table and its ranks need, which takes about half the time. An agent that
    cannot be built, or fails in any scene, is named in `Report.failures`, and the others are shown.
    Event weights are the frozen ones of the env, else made from these scenes. Raises MtpBenchError for errors that the
    user can mend, and if a control or every agent fails.
    """
    require_list(agents)
    with EnvEvaluation.opened("comparing", env_id, options, keywords) as evaluation:
        return _compared(evaluation, list(agents), full)


def _compared(
    evaluation: EnvEvaluation, agents: Sequence[object], full: bool
) -> Comparison:
    card, role = evaluation.card, controls()
    card.require_same_scenes("in which agents do not meet the same scenes")
    asked = {each for each in agents if isinstance(each, str)}
    hidden = {role["associated"]} - asked  # from the main table
    settings = all_settings([*control_names(), *agents], card)
    if not full:
        settings = _main_settings(
            [setting for setting in settings if setting.submission.name not in hidden]
        )
    evaluation.options.require_tracks_used([setting.submission for setting in settings])
    # of several numbers of hypotheses under one label, the references of the last
    stated = {
        setting.label: references_of(setting, card)
        for setting in settings
        if setting.budget == "equal"
    }
    if not full:  # the guard of ranks takes the single hypothesis alone
        stated = {
            label: {k: each for k, each in pair.items() if k == "single"}
            for label, pair in stated.items()
        }
    runs: dict[Key, Setting] = {}
    for each in itertools.chain(
        settings, *(references.values() for references in stated.values())
    ):
        runs.setdefault(each.key, each)
    scores, failures = _scored(
        evaluation, runs, any(each in control_names() for each in agents)
    )
    shown = [setting for setting in settings if setting.submission.name not in failures]
    own = {
        label: References(
            **{name: scores[each.key] for name, each in references.items()}
        )
        if references
        else None
        for label, references in stated.items()
        if label in {setting.label for setting in shown}
    }
    report, reference = evaluation.report(
        [scores[each.key] for each in shown], shown, references=own
    )
    if "turning" not in {row.subset for row in report.rows}:
        hidden |= {role["bends"]} - asked
    names = dict.fromkeys(setting.submission.name for setting in shown)
    report = replace(
        report, shown=[name for name in names if name not in hidden], failures=failures
    )
    skipped: dict[str, int] = {}
    for result in (
        scores.values()
    ):  # every setting reads the same scenes, but only some read stored tracks
        skipped |= total_skipped(score.skipped for score in result.seeds[0])
    return Comparison(report, reference, tuple(shown), skipped)


def _scored(
    evaluation: EnvEvaluation, runs: Mapping[Key, Setting], with_control: bool
) -> tuple[dict[Key, AgentScores], dict[str, str]]:
    """Scores of the runs, and the reasons why submissions failed, by name; each is built and reset before any is run.

    Raises SubmissionError, with the reasons, if a control failed, or all others, unless a control was asked for.
    """
    failures: dict[str, str] = {}
    own = {run.submission.name for run in runs.values()} - set(control_names())
    for run in runs.values() if evaluation.options.workers != SERIAL else ():
        try:
            run.submission.require_copy()
        except MtpBenchError as error:
            failures[run.submission.name] = str(error)
    for step in (evaluation.first_errors, evaluation.scores):
        tried = {
            key: run for key, run in runs.items() if run.submission.name not in failures
        }
        results = dict(zip(tried, step(list(tried.values())), strict=True))
        for key, result in results.items():
            if isinstance(result, AgentFailedError):
                failures.setdefault(tried[key].submission.name, result.reason)
        all_failed = own and own <= failures.keys() and not with_control
        if fatal := [name for name in failures if all_failed or name not in own]:
            raise SubmissionError(
                "; ".join(f"agent {name!r} {failures[name]}" for name in fatal)
            )
    return {
        key: result
        for key, result in results.items()
        if isinstance(result, AgentScores)
    }, failures


def control_names() -> list[str]:
    """Names of the baselines that every comparison runs."""
    return [controls()[role] for role in CONTROLS]


def _main_settings(settings: Sequence[Setting]) -> list[Setting]:
    """The setting of each submission that the main table shows: k samples, its own parameters, the most hypotheses."""
    ordered = sorted(
        settings,
        key=lambda s: preference(
            s.budget, s.label == s.submission.name, s.hypotheses or 0
        ),
    )
    best = {setting.submission.name: setting for setting in ordered}
    return [setting for setting in settings if best[setting.submission.name] is setting]
