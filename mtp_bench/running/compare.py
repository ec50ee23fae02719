"""Agents side by side on one env, with the controls that separate hypotheses from sampling."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

from ..cards import Card
from ..errors import MtpBenchError, SubmissionError
from ..parallel import SERIAL
from ..scoring import AgentScores, Reference, References, Report
from ..scoring.main_table import preference
from ..submission.loader import controls
from ..submission.manifest import Role
from .evaluate import EnvEvaluation
from .options import DEFAULTS, RunKeywords, RunOptions
from .reading import total_skipped
from .run import AgentFailedError
from .settings import Key, Setting, all_settings, references_of, require_list

CONTROLS: tuple[Role, ...] = (  # docs/definitions, "Controls"
    "ground_truth", "single", "same_samples", "hedged", "associated", "associated_same_samples",
)  # fmt: skip
_IN_FULL: tuple[Role, ...] = ("associated",)  # controls that the main table leaves out


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


def _compared(evaluation: EnvEvaluation, agents: Sequence[object], full: bool) -> Comparison:
    card, role = evaluation.card, controls()
    hidden = {role[each] for each in _IN_FULL} - {each for each in agents if isinstance(each, str)}
    settings = all_settings([*control_names(), *agents], card)
    if not full:
        settings = _main_settings([setting for setting in settings if setting.submission.name not in hidden])
    evaluation.options.require_tracks_used([setting.submission for setting in settings])
    # of several numbers of hypotheses under one label, the references of the last
    stated = {setting.label: references_of(setting, card) for setting in settings if setting.budget == "equal"}
    if not full:  # the guard of ranks takes the single hypothesis alone
        stated = {label: {k: each for k, each in pair.items() if k == "single"} for label, pair in stated.items()}
    runs: dict[Key, Setting] = {}
    for each in itertools.chain(settings, *(references.values() for references in stated.values())):
        runs.setdefault(each.key, each)
    scores, failures = _scored(evaluation, runs, any(each in control_names() for each in agents))
    shown = [setting for setting in settings if setting.submission.name not in failures]
    own = {
        label: References(**{name: scores[each.key] for name, each in references.items()}) if references else None
        for label, references in stated.items()
        if label in {setting.label for setting in shown}
    }
    ends = {"stp": role["single"], "truth": role["ground_truth"]}
    report, reference = evaluation.report([scores[each.key] for each in shown], shown, **ends, references=own)
    names = dict.fromkeys(setting.submission.name for setting in shown)
    report = replace(report, shown=[name for name in names if name not in hidden], failures=failures)
    skipped: dict[str, int] = {}
    for result in scores.values():  # every setting reads the same scenes, but only some read stored tracks
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
        tried = {key: run for key, run in runs.items() if run.submission.name not in failures}
        results = dict(zip(tried, step(list(tried.values())), strict=True))
        for key, result in results.items():
            if isinstance(result, AgentFailedError):
                failures.setdefault(tried[key].submission.name, result.reason)
        all_failed = own and own <= failures.keys() and not with_control
        if fatal := [name for name in failures if all_failed or name not in own]:
            raise SubmissionError("; ".join(f"agent {name!r} {failures[name]}" for name in fatal))
    return {key: result for key, result in results.items() if isinstance(result, AgentScores)}, failures


def control_names() -> list[str]:
    """Names of the baselines that every comparison runs."""
    return [controls()[role] for role in CONTROLS]


def _main_settings(settings: Sequence[Setting]) -> list[Setting]:
    """The setting of each submission that the main table shows: k samples, its own parameters, the most hypotheses."""
    ordered = sorted(settings, key=lambda s: preference(s.budget, s.label == s.submission.name, s.hypotheses or 0))
    best = {setting.submission.name: setting for setting in ordered}
    return [setting for setting in settings if best[setting.submission.name] is setting]
