"""Settings: a submission with the parameters and the number of samples that one row of a comparison is of."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

from ..cards import Card
from ..errors import MtpBenchError, SubmissionError
from ..scoring.rows import Budget
from ..submission.loader import Submission, load_submission
from ..submission.manifest import MANIFEST


@dataclass(frozen=True)
class Setting:
    """One row of a comparison: a submission with parameters and a number of samples."""

    label: str
    submission: Submission
    parameters: dict[str, Any]
    budget: Budget
    hypotheses: int | None  # as declared; None: what the agent states will tell
    samples: int  # K
    observe: str = "detections"

    @property
    def ends(self) -> tuple[Setting, Setting] | tuple[()] | None:
        """The ends of its gap, STP and true pasts with its own predictor; empty: the controls; None: not stated."""
        stated = self.submission.compare.ends
        if stated is None or self.ideal:
            return None
        if stated == "controls":
            return ()
        parameters = {**self.parameters, **stated}
        label = f"{self.submission.name} (end of its gap)"
        single = replace(self, label=label, parameters=parameters, hypotheses=1)
        return single, replace(single, observe="truth")

    @property
    def ideal(self) -> bool:
        """Whether the agent is fed the truth."""
        return self.observe == "truth"

    def env_keywords(self, card: Card) -> dict[str, Any]:
        """What the env of this setting needs beyond the card."""
        keywords: dict[str, Any] = {"samples": self.samples, "observe": self.observe}
        if self.hypotheses and self.hypotheses > card.size.hypotheses:
            keywords["hypotheses"] = self.hypotheses
        return keywords


def setting_of(
    submission: Submission, card: Card, chosen: dict[str, Any] | None = None, budget: Budget = "equal"
) -> Setting:
    """A submission with its own parameters and ``chosen``: those that are neither the default nor H show in the label.

    Raises SubmissionError unless the parameters that the manifest names as counts are whole numbers.
    """
    chosen = chosen or {}
    parameters = {**submission.parameters, **chosen}
    names = submission.compare
    hypotheses = _count(submission, parameters, names.hypotheses)
    drawn = (hypotheses or 1) * (_count(submission, parameters, names.draws) or 1)
    shown = [f"{k}={v}" for k, v in chosen.items() if k != names.hypotheses and v != submission.parameters.get(k)]
    return Setting(
        label=" ".join([submission.name, *shown]),
        submission=submission,
        parameters=parameters,
        budget=budget,
        hypotheses=hypotheses,
        samples=card.task.samples * (drawn if budget == "free" else 1),
        observe=submission.compare.observe,
    )


def expand(submission: Submission, card: Card) -> list[Setting]:
    """The settings of a submission: its sweep times its budgets, in the order of the manifest."""
    sweep = submission.compare.sweep
    settings = []
    for budget in submission.compare.budgets:
        for values in itertools.product(*sweep.values()):
            chosen = dict(zip(sweep, values, strict=True))
            setting = setting_of(submission, card, chosen, budget)
            if (budget == "equal" or setting.samples > card.task.samples) and setting not in settings:
                settings.append(setting)
    return settings


def submission_of(agent: object) -> Submission:
    """The submission that a caller in Python names; raises MtpBenchError for what is no name, such as an agent."""
    if not isinstance(agent, str | PathLike):
        raise MtpBenchError(
            f"agent is of type {type(agent).__name__}, expected the name of a baseline or a folder with {MANIFEST}; "
            "`mtp-bench new` makes such a folder"
        )
    return load_submission(Path(agent) if isinstance(agent, PathLike) else agent)


def require_list(names: object) -> None:
    """Raise MtpBenchError for one agent in place of a list of them: the letters of a name are no names."""
    if isinstance(names, str | PathLike) or not isinstance(names, Iterable):
        example = str(names) if isinstance(names, str | PathLike) else "stp"
        raise MtpBenchError(f"agents is of type {type(names).__name__}, expected a list such as [{example!r}]")


def all_settings(names: Sequence[str], card: Card) -> list[Setting]:
    """Settings of the submissions or baselines ``names``, each once.

    Raises MtpBenchError where ``names`` are no names, and where two submissions have one name.
    """
    require_list(names)
    seen: dict[str, Submission] = {}
    for submission in map(submission_of, names):
        if submission.name in seen and seen[submission.name].path != submission.path:
            raise MtpBenchError(
                f"two submissions are called {submission.name!r}: {seen[submission.name].path} and {submission.path}; "
                "give them different names in submission.toml"
            )
        seen.setdefault(submission.name, submission)
    return [setting for submission in seen.values() for setting in expand(submission, card)]


def _count(submission: Submission, parameters: dict[str, Any], name: str | None) -> int | None:
    """The value of the parameter that the manifest names as a count; None where it names none or one without value."""
    if name is None or name not in parameters:
        return None
    value = parameters[name]
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise SubmissionError(
            f"{submission.name}: parameter {name!r} is {value!r}, expected a whole number of at least 1"
        )
    return int(value)
