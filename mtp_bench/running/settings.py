"""Settings: a submission with the parameters and the number of samples of one row of a comparison."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, NamedTuple

from ..agent import (
    ObjectSubmission,
    Role,
    Submission,
    controls,
    load_submission,
    submission_of,
)
from ..cards import Card
from ..core import MtpBenchError, SubmissionError
from ..scoring import Budget, unchanged

_REFERENCES: tuple[Role, ...] = (
    "single",
    "ground_truth",
    "same_samples",
    "associated_same_samples",
    "associated",
)


class Key(NamedTuple):
    """Fields of settings that run the same; they may differ in their label."""

    submission: str
    parameters: str
    budget: Budget
    hypotheses: int | None
    samples: int
    observe: str


@dataclass(frozen=True)
class Setting:
    """One row of a comparison."""

    label: str
    submission: Submission
    parameters: dict[str, Any]
    budget: Budget
    hypotheses: int | None  # as declared; None: as many as the agent states
    samples: int  # K
    observe: str = "detections"

    @property
    def key(self) -> Key:
        """The same for settings that differ in their label alone."""
        parameters = repr(sorted(self.parameters.items()))
        return Key(
            self.submission.name,
            parameters,
            self.budget,
            self.hypotheses,
            self.samples,
            self.observe,
        )

    @property
    def gap_references(self) -> tuple["Setting", "Setting"] | tuple[()] | None:
        """The reference pair of its gap: one hypothesis, and ground-truth tracks, with its own predictor.

        Empty: the controls are the pair. None: the manifest does not state it.
        """
        stated = self.submission.compare.gap_references
        if stated == "controls":
            return ()
        if stated is None or self.observe == "truth":
            return None
        label = f"{self.submission.name} (reference of its gap)"
        parameters, observe = (
            {**self.parameters, **stated},
            self.observe.replace("associated", "detections"),
        )
        single = replace(
            self, label=label, parameters=parameters, hypotheses=1, observe=observe
        )
        return single, replace(single, observe="truth")

    @property
    def drawn(self) -> int:
        """Number of times that k samples are drawn of an object."""
        return (self.hypotheses or 1) * (
            _count(self.submission, self.parameters, self.submission.compare.draws) or 1
        )

    def env_keywords(self, card: Card) -> dict[str, Any]:
        """Keywords of `MTPEnv` that this setting needs beyond the card."""
        keywords: dict[str, Any] = {"samples": self.samples, "observe": self.observe}
        if self.hypotheses and self.hypotheses > card.size.hypotheses:
            keywords["hypotheses"] = self.hypotheses
        return keywords


def setting_of(
    submission: Submission,
    card: Card,
    chosen: dict[str, Any] | None = None,
    budget: Budget = "equal",
) -> Setting:
    """A submission with its own parameters and ``chosen`` ones; the label names those that are not the default, or H.

    Raises SubmissionError unless the parameters that the manifest names as counts are whole numbers.
    """
    chosen = chosen or {}
    parameters = {**submission.parameters, **chosen}
    names = submission.compare
    shown = [
        f"{k}={v}"
        for k, v in chosen.items()
        if k != names.hypotheses and v != submission.parameters.get(k)
    ]
    label, hypotheses = (
        " ".join([submission.name, *shown]),
        _count(submission, parameters, names.hypotheses),
    )
    setting = Setting(
        label,
        submission,
        parameters,
        budget,
        hypotheses,
        card.task.samples,
        names.observe,
    )
    drawn = setting.drawn  # raises for a wrong count
    return (
        replace(setting, samples=card.task.samples * drawn)
        if budget == "free"
        else setting
    )


def references_of(setting: Setting, card: Card) -> dict[str, Setting]:
    """Settings beside which an agent is measured, by the fields of `References`; empty if its manifest states none."""
    pair = setting.gap_references
    if not pair:
        return {} if pair is None else kinematic_references(setting, card)
    single, truth = pair
    compare = setting.submission.compare
    tracked = single
    if compare.association_references is not None:
        tracked = replace(
            single, parameters={**setting.parameters, **compare.association_references}
        )

    def same_samples(one: Setting) -> Setting:
        if compare.draws is None or setting.drawn <= one.drawn:
            return one
        return replace(one, parameters={**one.parameters, compare.draws: setting.drawn})

    references = {
        "single": single,
        "ground_truth": truth,
        "same_samples": same_samples(tracked),
    }
    if single.observe == "detections":
        references["associated_same_samples"] = replace(
            same_samples(tracked), observe="associated"
        )
        references |= {
            "associated": references["associated_same_samples"],
            "tracks": same_samples(truth),
        }
    return references


def kinematic_references(setting: Setting, card: Card) -> dict[str, Setting]:
    """References with the kinematic predictor: controls, with one draw or with as many as their same samples."""
    references: dict[str, Setting] = {
        role: setting_of(load_submission(controls()[role]), card)
        for role in _REFERENCES
    }
    truth = references["tracks"] = references["ground_truth"]
    if setting.drawn > 1:
        references["associated"] = references["associated_same_samples"]
        draws = {str(truth.submission.compare.draws): references["same_samples"].drawn}
        references["tracks"] = setting_of(truth.submission, card, draws)
    return references


def expand(submission: Submission, card: Card) -> list[Setting]:
    """All settings of a submission: its sweep times its numbers of samples, in the order of the manifest."""
    sweep = submission.compare.sweep
    settings: list[Setting] = []
    for budget, values in itertools.product(
        submission.compare.samples, itertools.product(*sweep.values())
    ):
        setting = setting_of(
            submission, card, dict(zip(sweep, values, strict=True)), budget
        )
        if (
            budget == "equal" or setting.samples > card.task.samples
        ) and setting not in settings:
            settings.append(setting)
    return settings


def all_settings(agents: Iterable[object], card: Card) -> list[Setting]:
    """Settings of agents, each once: submissions or baselines by name or folder, objects and functions.

    Further objects of one name get numbers. Raises MtpBenchError unless ``agents`` is a list of distinct submissions.
    """
    require_list(agents)
    submissions: dict[str, Submission] = {}
    for agent in agents:
        submission = submission_of(agent)
        if isinstance(submission, ObjectSubmission):
            numbers = itertools.count(2)
            while submission.name in submissions:
                submission = ObjectSubmission.of(
                    agent, f"{submission.name.split('#')[0]}#{next(numbers)}"
                )
        other = submissions.setdefault(submission.name, submission)
        if other.path != submission.path:
            both = f"two submissions are called {submission.name!r}: {other.path} and {submission.path}"
            raise MtpBenchError(f"{both}; give them different names in submission.toml")
    return [
        setting
        for submission in submissions.values()
        for setting in expand(submission, card)
    ]


def require_list(agents: object) -> None:
    """Raise MtpBenchError for one agent in place of a list: the letters of a name would be taken as names."""
    if isinstance(agents, str | PathLike) or not isinstance(agents, Iterable):
        example = str(agents) if isinstance(agents, str | PathLike) else "name"
        raise MtpBenchError(
            f"agents is of type {type(agents).__name__}, expected a list such as [{example!r}]"
        )


def training_note(submission: Submission, card: Card) -> str | None:
    """Note on the parts of a submission that were trained on the scenes that ``card`` scores; None without any.

    Other splits, detections or scenes than those of the env that ships are not the ones that the manifest names.
    """
    return submission.note_on(card.id) if unchanged(card.id, card.digest) else None


def _count(
    submission: Submission, parameters: dict[str, Any], name: str | None
) -> int | None:
    """Value of the parameter that the manifest names as a count; None if it names none, or one without a value."""
    if name is None or name not in parameters:
        return None
    value = parameters[name]
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        expected = "expected a whole number of at least 1"
        raise SubmissionError(
            f"{submission.name}: parameter {name!r} is {value!r}, {expected}"
        )
    return value
