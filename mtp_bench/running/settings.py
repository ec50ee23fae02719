"""Settings: a submission with the parameters and samples of one row of a comparison."""

import itertools
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

from ..agent import (
    ObjectSubmission,
    Role,
    Submission,
    controls,
    load_submission,
    submission_of,
)
from ..cards import Card, with_split
from ..core import MtpBenchError, SubmissionError
from ..scoring import Budget, shipped_env_id
from ..sources import open_source

_REFERENCE_ROLES: tuple[Role, ...] = (
    "single",
    "ground_truth",
    "same_samples",
    "associated_same_samples",
    "associated",
)


Key = tuple[object, ...]  # of what decides how a setting runs: all but its label


@dataclass(frozen=True)
class Setting:
    """One row of a comparison."""

    label: str
    submission: Submission
    parameters: dict[str, Any]
    budget: Budget
    # number that the manifest declares; None: as many as its actions have
    hypotheses: int | None
    samples: int  # K
    observe: str = "detections"

    @property
    def key(self) -> Key:
        """Key that is equal for settings that differ only in their label."""
        parameters = repr(sorted(self.parameters.items()))
        return (
            self.submission.name,
            parameters,
            self.budget,
            self.hypotheses,
            self.samples,
            self.observe,
        )

    @property
    def total_draws(self) -> int:
        """Number of draws of k samples for an object, over all hypotheses."""
        draws = _count(self.submission, self.parameters, self.submission.compare.draws)
        return (self.hypotheses or 1) * (draws or 1)

    def env_keywords(self, card: Card) -> dict[str, Any]:
        """Return the keywords of `MTPEnv` that this setting needs beyond the card."""
        keywords: dict[str, Any] = {"samples": self.samples, "observe": self.observe}
        if self.hypotheses and self.hypotheses > card.size.hypotheses:
            keywords["hypotheses"] = self.hypotheses
        return keywords

    def with_draws(self, draws: int) -> "Setting":
        """Return the setting with more draws, if the agent has a parameter for them."""
        draws_name = self.submission.compare.draws
        if draws_name is None or draws <= self.total_draws:
            return self
        return replace(self, parameters={**self.parameters, draws_name: draws})


def setting_of(
    submission: Submission,
    card: Card,
    chosen: dict[str, Any] | None = None,
    budget: Budget = "equal",
) -> Setting:
    """Return the setting of a submission with its own and ``chosen`` parameters.

    The label names each chosen parameter that differs from the submission's own, except
    the number of hypotheses H. Raises SubmissionError unless the parameters that the
    manifest names as counts are whole numbers.
    """
    chosen = chosen or {}
    compare = submission.compare
    parameters = {**submission.parameters, **chosen}
    label = submission.name
    for parameter_name, value in chosen.items():
        if parameter_name != compare.hypotheses and value != submission.parameters.get(
            parameter_name
        ):
            label += f" {parameter_name}={value}"
    setting = Setting(
        label,
        submission,
        parameters,
        budget,
        _count(submission, parameters, compare.hypotheses),
        card.task.samples,
        compare.observe,
    )
    draws = setting.total_draws  # raises for a wrong count
    if budget == "equal":
        return setting
    return replace(setting, samples=card.task.samples * draws)


def references_of(setting: Setting, card: Card) -> dict[str, Setting]:
    """Return the settings of the reference runs of an agent.

    The keys are fields of `References`. Empty if the manifest states no references.
    The gap of the agent lies between two of them with its own predictor: one has one
    hypothesis, the other the ground-truth tracks.
    """
    compare = setting.submission.compare
    if compare.gap_references == "controls":
        return kinematic_references(setting, card)
    if compare.gap_references is None or setting.observe == "truth":
        return {}
    observe = "detections" if setting.observe == "associated" else setting.observe
    single = replace(
        setting,
        label=f"{setting.submission.name} (reference of its gap)",
        parameters={**setting.parameters, **compare.gap_references},
        hypotheses=1,
        observe=observe,
    )
    truth = replace(single, observe="truth")
    # one hypothesis, beside which better association is measured
    association_single = single
    association = compare.association_references
    if association is not None:
        parameters = {**setting.parameters, **association}
        association_single = replace(single, parameters=parameters)
    same_samples = association_single.with_draws(setting.total_draws)
    references = {
        "single": single,
        "ground_truth": truth,
        "same_samples": same_samples,
    }
    if single.observe == "detections":
        associated = replace(same_samples, observe="associated")
        references["associated_same_samples"] = associated
        references["associated"] = associated
        references["tracks"] = truth.with_draws(setting.total_draws)
    return references


def kinematic_references(setting: Setting, card: Card) -> dict[str, Setting]:
    """Return the controls, which predict as stp, as references.

    If the agent has more draws than one, the references that split its error have the
    number of draws of ``same_samples``.
    """
    role_names = controls()
    references: dict[str, Setting] = {}
    for role in _REFERENCE_ROLES:
        references[role] = setting_of(load_submission(role_names[role]), card)
    truth = references["ground_truth"]
    references["tracks"] = truth
    if setting.total_draws > 1:
        references["associated"] = references["associated_same_samples"]
        draws_name = str(truth.submission.compare.draws)
        chosen = {draws_name: references["same_samples"].total_draws}
        references["tracks"] = setting_of(truth.submission, card, chosen)
    return references


def expand(submission: Submission, card: Card) -> list[Setting]:
    """Return all settings of a submission, in the order of the manifest.

    There is one for each combination of the values of its sweep with each of its
    numbers of samples. Settings that would be the same appear once.
    """
    sweep = submission.compare.sweep
    settings: list[Setting] = []
    for budget in submission.compare.samples:
        for values in itertools.product(*sweep.values()):
            chosen = dict(zip(sweep, values, strict=True))
            setting = setting_of(submission, card, chosen, budget)
            # else the setting is that of the "equal" budget
            has_more_samples = setting.samples > card.task.samples
            if (budget == "equal" or has_more_samples) and setting not in settings:
                settings.append(setting)
    return settings


def all_settings(agents: Iterable[object], card: Card) -> list[Setting]:
    """Return the settings of `distinct` agents, each once."""
    setting_lists = [expand(submission, card) for submission in distinct(agents)]
    return list(itertools.chain(*setting_lists))


def distinct(agents: Iterable[object]) -> list[Submission]:
    """Return the submissions of agents, each once.

    ``agents``: submissions or baselines by name or folder, objects and functions.
    Further objects of one name get numbers. Raises MtpBenchError unless ``agents`` is a
    list of distinct submissions.
    """
    require_list(agents)
    submissions: dict[str, Submission] = {}
    for agent in agents:
        submission = submission_of(agent)
        if isinstance(submission, ObjectSubmission):
            submission = _numbered(agent, submission, submissions)
        first = submissions.setdefault(submission.name, submission)
        if first.path != submission.path:
            raise MtpBenchError(
                f"two submissions are called {submission.name!r}: {first.path} and "
                f"{submission.path}; give them different names in submission.toml"
            )
    return list(submissions.values())


def _numbered(
    agent: object, submission: ObjectSubmission, taken_names: Iterable[str]
) -> ObjectSubmission:
    """Return an object's submission under the first name that is free."""
    numbers = itertools.count(2)
    base_name = submission.name.split("#")[0]
    while submission.name in taken_names:
        submission = ObjectSubmission.of(agent, f"{base_name}#{next(numbers)}")
    return submission


def require_list(agents: object) -> None:
    """Raise MtpBenchError for one agent in place of a list.

    Without this check each letter of a name would be taken for the name of an agent.
    """
    is_path = isinstance(agents, str | PathLike)
    if is_path or not isinstance(agents, Iterable):
        example = str(agents) if is_path else "name"
        raise MtpBenchError(
            f"agents is of type {type(agents).__name__}, "
            f"expected a list such as [{example!r}]"
        )


def training_note(submission: Submission, card: Card) -> str | None:
    """Return the note on parts that were trained on the scenes that ``card`` scores.

    None without such parts. The manifest speaks of the env that ships, so a card with
    another split, detections or scenes has no note.
    """
    return submission.note_on(card.id) if shipped_env_id(card.id, card.digest) else None


def scenes_of_card(names: Collection[str], card: Card, data: str | None) -> list[str]:
    """Return the scenes of ``names`` that are in a card's split, none without data."""
    try:
        split_names = open_source(card, data).names
    except MtpBenchError:
        return []
    return [name for name in names if name in split_names]


def other_split(names: Collection[str], card: Card, data: str | None) -> str | None:
    """Return a split of the card's source with none of the scenes ``names``."""
    for split in card.source.splits:
        with suppress(MtpBenchError):  # not every split has scenes here
            source = open_source(with_split(card, split), data)
            if not {*source.names} & {*names}:
                return split
    return None


def _count(
    submission: Submission, parameters: dict[str, Any], parameter_name: str | None
) -> int | None:
    """Return the value of the parameter that the manifest names as a count.

    None if it names none, or one without a value.
    """
    if parameter_name is None or parameter_name not in parameters:
        return None
    value = parameters[parameter_name]
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise SubmissionError(
            f"{submission.name}: parameter {parameter_name!r} is {value!r}, "
            "expected a whole number of at least 1"
        )
    return value
