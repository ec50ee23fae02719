"""Agents side by side on one env, with the controls that separate hypotheses from sampling."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

from ..cards import Card
from ..errors import SubmissionError
from ..parallel import reported
from ..scoring import AgentScores, Reference, References, Report, summarise
from ..submission.loader import controls
from ..submission.manifest import Role
from .evaluate import RankedScenes, caught_scores, jobs_of_setting, require_copies, training_notes
from .options import DEFAULTS, RunKeywords, RunOptions, asked
from .reading import total_skipped
from .reference import reference_for
from .run import AgentFailedError, first_errors
from .settings import Setting, all_settings, references_of, require_list

# docs/definitions, "Controls"
CONTROLS: tuple[Role, ...] = (
    "ground_truth", "single", "same_samples", "hedged", "associated", "associated_same_samples",
)  # fmt: skip
_IN_FULL: tuple[Role, ...] = ("hedged", "associated")  # controls that the main table leaves out


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
    env_id, options = asked(env_id, options, keywords)
    with reported(f"comparing on {getattr(env_id, 'id', env_id)}", own=options.progress) as progress:
        return _compared(list(agents), env_id, replace(options, progress=progress), full)


def _compared(agents: Sequence[object], env_id: str | Card, options: RunOptions, full: bool) -> Comparison:
    # first, for an error in a file of weights
    ranked = RankedScenes.of(env_id, options)
    card, scenes, role = ranked.card, ranked.chosen, controls()
    hidden = {role[each] for each in _IN_FULL} - {each for each in agents if isinstance(each, str)}
    settings = all_settings([*control_names(), *agents], card)
    if not full:
        settings = _main_settings([setting for setting in settings if setting.submission.name not in hidden])
    options.require_tracks_used([setting.submission for setting in settings])
    require_copies(settings, options)
    # of several numbers of hypotheses under one label, the references of the last
    stated = {setting.label: references_of(setting, card) for setting in settings if setting.budget == "equal"}
    if not full:  # the guard of ranks takes the single hypothesis alone
        stated = {label: {k: each for k, each in pair.items() if k == "single"} for label, pair in stated.items()}
    runs, known = list(settings), [replace(setting, label="") for setting in settings]
    for each in itertools.chain(*(references.values() for references in stated.values())):
        if (run := replace(each, label="")) not in known:
            runs.append(each)
            known.append(run)
    failures = _first_failures(runs, env_id, card, scenes, options)
    _require_some(failures, agents, settings)
    started = [run for run in runs if run.submission.name not in failures]
    results = dict(zip(map(id, started), caught_scores(started, env_id, card, scenes, options), strict=True))
    for run in started:
        if isinstance(error := results[id(run)], AgentFailedError):
            failures.setdefault(run.submission.name, error.reason)
    _require_some(failures, agents, settings)
    shown = [setting for setting in settings if setting.submission.name not in failures]

    def scores(setting: Setting) -> AgentScores:
        found = results[id(runs[known.index(replace(setting, label=""))])]
        assert isinstance(found, AgentScores)
        return found

    own = {
        setting.label: References(**{name: scores(each) for name, each in stated[setting.label].items()})
        if stated[setting.label]
        else None
        for setting in shown
        if setting.label in stated
    }
    reference = reference_for(card, scenes, options)
    agent_scores = [scores(setting) for setting in shown]
    report = summarise(agent_scores, card, reference, stp=role["single"], truth=role["ground_truth"], references=own)
    names = dict.fromkeys(setting.submission.name for setting in shown)
    report = replace(report, shown=[name for name in names if name not in hidden], failures=failures)
    report.condition.update(training_notes(shown, card) | ranked.note(report))
    skipped: dict[str, int] = {}
    for result in results.values():  # every setting reads the same scenes, but only some read stored tracks
        if isinstance(result, AgentScores):
            skipped |= total_skipped(score.skipped for score in result.seeds[0])
    return Comparison(report, reference, tuple(shown), skipped)


def control_names() -> list[str]:
    """Names of the baselines that every comparison runs."""
    return [controls()[role] for role in CONTROLS]


def _main_settings(settings: Sequence[Setting]) -> list[Setting]:
    """The setting of each submission that the main table shows: k samples, its own parameters, the most hypotheses."""

    def preference(setting: Setting) -> tuple[bool, bool, int]:
        return setting.budget == "equal", setting.label == setting.submission.name, setting.hypotheses or 0

    best = {setting.submission.name: setting for setting in sorted(settings, key=preference)}
    return [setting for setting in settings if best[setting.submission.name] is setting]


def _first_failures(
    runs: Sequence[Setting], env_id: str | Card, card: Card, scenes: Sequence[str], options: RunOptions
) -> dict[str, str]:
    """Reasons why submissions cannot run, by name: each setting is built, and reset for the first scene."""
    jobs = [jobs_of_setting(run, options.seeds[0], env_id, card, scenes[:1], options) for run in runs]
    errors = first_errors(list(itertools.chain(*jobs)), options)
    failures: dict[str, str] = {}
    for run, error in zip(runs, errors, strict=True):
        if error is not None:
            failures.setdefault(run.submission.name, error.reason)
    return failures


def _require_some(failures: Mapping[str, str], agents: Sequence[object], settings: Sequence[Setting]) -> None:
    """Raise SubmissionError, with the reasons, if a control failed, or all ``agents``, unless one is a control."""
    own = {setting.submission.name for setting in settings} - set(control_names())
    failed = failures.keys() & set(control_names())
    if own and own <= failures.keys() and not any(each in control_names() for each in agents):
        failed |= own
    if failed:
        raise SubmissionError("; ".join(f"agent {name!r} {failures[name]}" for name in failures if name in failed))
