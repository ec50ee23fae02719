"""Comparison of agents with each other and with the controls, in memory.

The controls separate hypotheses from sampling.
"""

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from ..agent import Role, controls, submission_of
from ..cards import Card
from ..core import (
    SERIAL,
    MtpBenchError,
    SubmissionError,
    baseline_names,
)
from ..scoring import AgentScores, Reference, References, Report, preference
from .evaluation import EnvEvaluation
from .options import DEFAULTS, RunKeywords, RunOptions
from .playing import AgentFailedError
from .reading import total_skipped
from .rollout_files import RUN_FILE
from .settings import (
    Key,
    Setting,
    all_settings,
    references_of,
    require_list,
    setting_of,
)
from .stored import open_runs, run_scores

CONTROLS: tuple[Role, ...] = (  # docs/definitions, "Controls"
    "ground_truth",
    "single",
    "same_samples",
    "neighbours",
    "bends",
    "associated",
    "associated_same_samples",
)
# Several hypotheses gain only what exceeds the gains of both.
HYPOTHESIS_CONTROLS: tuple[Role, ...] = ("same_samples", "neighbours")

# Reference settings of agents, by label and field of `References`.
_ReferenceSettings = Mapping[str, Mapping[str, Setting]]


@dataclass(frozen=True, repr=False)
class Comparison:
    """A comparison, and the event weights of its subsets."""

    report: Report
    reference: Reference
    settings: tuple[Setting, ...]
    skipped: dict[str, int]  # rows of the data that could not be used, by reason

    def names(self, agents: Container[str]) -> list[str]:
        """Return the names of the agents, controls only if ``agents`` names them."""
        names = self.report.shown
        return [name for name in names if name in agents or name not in control_names()]

    def __str__(self) -> str:
        return str(self.report)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return self.report._repr_html_()

    def to_frame(self) -> Any:
        """Return the rows, as `Report.to_frame`."""
        return self.report.to_frame()

    def to_markdown(self) -> str:
        """Return the main table in Markdown."""
        return self.report.to_markdown()

    def to_latex(self) -> str:
        """Return the main table in LaTeX, for the package booktabs."""
        return self.report.to_latex()


def compare(
    agents: Iterable[object],
    env_id: str | Card,
    options: RunOptions = DEFAULTS,
    full: bool = True,
    **keywords: Unpack[RunKeywords],
) -> Comparison:
    """Run and score the controls and other agents on the same scenes of an env.

    See `evaluate` for the arguments; an agent may also be the folder of a stored run,
    which is scored beside the others. ``full``: False runs only what the main table and
    its ranks need, which takes about half the time. An agent that cannot be built, or
    fails in any scene, is named in `Report.failures`, and the others are shown. Event
    weights are the frozen ones of the env, else made from these scenes. Raises
    MtpBenchError for errors that the user can mend, and if a control or every agent
    fails.
    """
    require_list(agents)
    agents = list(agents)
    with EnvEvaluation.opened("comparing", env_id, options, keywords) as evaluation:
        playing = [agent for agent in agents if not is_run(agent)]
        folders = [Path(str(agent)) for agent in agents if is_run(agent)]
        return _compare(evaluation, playing, full, folders)


def compare_files(
    agents: Sequence[str], env_id: str | Card, choices: Mapping[str, RunOptions]
) -> Comparison:
    """Compare agents on several files of tracks or detections, a row for each.

    ``choices``: the options of a run by the path of its file. Agents that do not read
    such a file have one row. Each row is tested against each other; there are no
    controls. Raises MtpBenchError as `compare`, and if an agent fails.
    """
    submissions = [submission_of(agent) for agent in agents]
    next(iter(choices.values())).require_tracks_used(submissions)
    varies_tracks = len({options.tracks for options in choices.values()}) > 1
    rows: dict[str, Any] = {}
    settings: list[Setting] = []
    evaluations: list[EnvEvaluation] = []
    for name, options in choices.items():
        with EnvEvaluation.opened(f"comparing {name}", env_id, options, {}) as opened:
            evaluations.append(opened)
            for submission in submissions:
                setting = setting_of(submission, opened.card)
                reads_tracks = setting.observe == "tracks"
                is_read = reads_tracks if varies_tracks else setting.observe != "truth"
                label = f"{setting.label}:{name}" if is_read else setting.label
                if label not in rows:
                    setting = replace(setting, label=label)
                    settings.append(setting)
                    (rows[label],) = opened.scores([setting], caught=False)
    scores = list(rows.values())
    first = evaluations[0]  # whose event weights count for all
    report, reference = first.report(scores, settings, with_each_other=True)
    report = replace(report, shown=list(rows))
    skipped = total_skipped(scene.skipped for row in scores for scene in row.seeds[0])
    return Comparison(report, reference, tuple(settings), skipped)


def is_run(agent: object) -> bool:
    """Return True for the folder of a stored run, and no name of a baseline."""
    if not isinstance(agent, str | Path) or str(agent) in baseline_names():
        return False
    return (Path(agent) / RUN_FILE).is_file()


def _stored(
    evaluation: EnvEvaluation, folders: Sequence[Path], taken: Sequence[str]
) -> list[AgentScores]:
    """Return the scores of stored runs on the scenes of a comparison.

    ``taken``: names of its agents. Raises RolloutError for a run of another task, and
    UnknownNameError for one without one of the scenes.
    """
    rows = []
    data = evaluation.options.data
    for opened in open_runs(folders, data, taken=taken, like=evaluation.card):
        rollouts = tuple(opened.first(scene) for scene in evaluation.scenes)
        chosen = replace(opened, run=replace(opened.run, rollouts=rollouts))
        rows.append(run_scores(chosen, evaluation.options.unchanged))
    return rows


def _compare(
    evaluation: EnvEvaluation,
    agents: Sequence[object],
    full: bool,
    folders: Sequence[Path],
) -> Comparison:
    card = evaluation.card
    card.require_same_scenes("in which agents do not meet the same scenes")
    settings = all_settings([*control_names(), *agents], card)
    hidden = _hidden_controls(("associated",), agents)
    if not full:
        settings = _main_settings(settings, hidden)
    submissions = [setting.submission for setting in settings]
    evaluation.options.require_tracks_used(submissions)
    references = _reference_settings(settings, card, full)
    runs = _distinct_runs(settings, references)
    control_asked_for = any(agent in control_names() for agent in agents)
    scores, failures = _scores(evaluation, runs, control_asked_for)

    stored = _stored(evaluation, folders, [setting.label for setting in settings])
    finished = _without(failures, settings)
    report, reference = evaluation.report(
        [*(scores[setting.key] for setting in finished), *stored],
        finished,
        _reference_scores(finished, references, scores),
    )
    # `bends` is shown for comparison on turning targets
    if all(row.subset != "turning" for row in report.rows):
        hidden |= _hidden_controls(("bends",), agents)
    visible = _without(hidden, finished)
    names = [setting.submission.name for setting in visible]
    shown = dict.fromkeys([*names, *(row.agent for row in stored)])
    report = replace(report, shown=list(shown), failures=failures)
    skipped: dict[str, int] = {}
    # every setting reads the same scenes, but only some read stored tracks
    for agent_scores in scores.values():
        skipped |= total_skipped(scene.skipped for scene in agent_scores.seeds[0])
    return Comparison(report, reference, tuple(finished), skipped)


def _without(names: Container[str], settings: Iterable[Setting]) -> list[Setting]:
    """Return the settings of submissions that are not in ``names``."""
    return [setting for setting in settings if setting.submission.name not in names]


def control_names() -> list[str]:
    """Return the names of the baselines that every comparison runs."""
    return [controls()[role] for role in CONTROLS]


def _hidden_controls(roles: Sequence[Role], agents: Sequence[object]) -> set[str]:
    """Return the controls that the main table hides unless they are asked for."""
    return {controls()[role] for role in roles}.difference(
        agent for agent in agents if isinstance(agent, str)
    )


def _main_settings(settings: Sequence[Setting], hidden: set[str]) -> list[Setting]:
    """Return the setting of each submission that the main table shows.

    Settings with the env's k samples come before others, then those with the
    submission's own parameters, then those with the most hypotheses.
    """
    shown = _without(hidden, settings)

    def rank(setting: Setting) -> tuple[Any, ...]:
        is_default = setting.label == setting.submission.name
        return preference(setting.budget, is_default, setting.hypotheses or 0)

    best: dict[str, Setting] = {}
    # the last one, with the largest rank, stays
    for setting in sorted(shown, key=rank):
        best[setting.submission.name] = setting
    return [setting for setting in shown if best[setting.submission.name] is setting]


def _reference_settings(
    settings: Sequence[Setting], card: Card, full: bool
) -> _ReferenceSettings:
    """Return the settings beside which agents are measured.

    If settings with several numbers of hypotheses have one label, the last of them
    decides. Unless ``full``, only the reference with one hypothesis is returned, which
    `guard_reason` needs.
    """
    references: dict[str, dict[str, Setting]] = {}
    for setting in settings:
        if setting.budget == "equal":
            roles = references_of(setting, card)
            if not full:
                roles = {role: roles[role] for role in roles if role == "single"}
            references[setting.label] = roles
    return references


def _distinct_runs(
    settings: Sequence[Setting], references: _ReferenceSettings
) -> dict[Key, Setting]:
    """Return settings and references by key, each run once."""
    runs: dict[Key, Setting] = {}
    for setting in settings:
        runs.setdefault(setting.key, setting)
    for roles in references.values():
        for setting in roles.values():
            runs.setdefault(setting.key, setting)
    return runs


def _reference_scores(
    finished: Sequence[Setting],
    references: _ReferenceSettings,
    scores: Mapping[Key, AgentScores],
) -> dict[str, References | None]:
    """Return the scores of the references of finished agents, by label.

    None for an agent whose manifest states no references.
    """
    labels = {setting.label for setting in finished}
    reference_scores: dict[str, References | None] = {}
    for label, roles in references.items():
        if label in labels:
            role_scores = {role: scores[s.key] for role, s in roles.items()}
            reference_scores[label] = References(**role_scores) if roles else None
    return reference_scores


def _scores(
    evaluation: EnvEvaluation, runs: Mapping[Key, Setting], control_asked_for: bool
) -> tuple[dict[Key, AgentScores], dict[str, str]]:
    """Return the scores of runs, and why submissions failed, by name.

    Each is built and reset before any is run. Raises SubmissionError as
    `_require_success`.
    """
    failures = _copy_failures(evaluation, runs)
    scores: dict[Key, AgentScores] = {}
    # the first step has an error or None per setting, the second an error or scores
    for step in (evaluation.first_errors, evaluation.scores):
        remaining = _without(failures, runs.values())
        for run, result in zip(remaining, step(remaining), strict=True):
            if isinstance(result, AgentFailedError):
                failures.setdefault(run.submission.name, result.reason)
            elif result is not None:
                scores[run.key] = result
        _require_success(failures, runs, control_asked_for)
    return scores, failures


def _copy_failures(
    evaluation: EnvEvaluation, runs: Mapping[Key, Setting]
) -> dict[str, str]:
    """Return why submissions cannot be sent to workers, by name."""
    failures: dict[str, str] = {}
    if evaluation.options.workers != SERIAL:
        for run in runs.values():
            try:
                run.submission.require_copy()
            except MtpBenchError as error:
                failures[run.submission.name] = str(error)
    return failures


def _require_success(
    failures: Mapping[str, str], runs: Mapping[Key, Setting], control_asked_for: bool
) -> None:
    """Raise SubmissionError, with the reasons, if a control failed.

    Also if all other agents failed, unless the user asked for a control.
    """
    competitors = {run.submission.name for run in runs.values()} - {*control_names()}
    all_failed = bool(competitors) and competitors <= failures.keys()
    fatal = [agent_name for agent_name in failures if agent_name not in competitors]
    if all_failed and not control_asked_for:
        fatal = list(failures)
    if fatal:
        sentences = [
            f"agent {agent_name!r} {failures[agent_name]}" for agent_name in fatal
        ]
        raise SubmissionError("; ".join(sentences))
