"""What a study runs: each agent with one to many hypotheses, with and without sampling, and the controls."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..cards import Card
from ..errors import MtpBenchError
from ..running.compare import PARAMETER, control_names, threshold_agents
from ..running.settings import Setting, all_settings, setting_of
from ..submission.loader import Submission, controls, load_submission
from .retracking import retracking_settings

HYPOTHESES = (1, 2, 5, 10, 20)
QUANTILES = (0.1, 0.25, 0.5)  # of the scores of detections of true objects: where the input is cut
SAME_BUDGET = "stp_same_budget"
HEDGED = "stp_hedged"


@dataclass(frozen=True)
class Subject:
    """An agent that is studied."""

    name: str
    single: Setting  # itself with one hypothesis
    end: Setting  # where its gap begins: ``single``, unless the manifest states more than one hypothesis
    truth: Setting  # ``end`` on true pasts
    equal: dict[int, Setting]  # by hypotheses: with the k samples of the env; 1 is ``single``
    free: dict[int, Setting] = field(default_factory=dict)  # by hypotheses: with the samples of all of them
    own_ends: bool = True  # False: what it is with one hypothesis is not stated, and STP stands for it

    @property
    def most(self) -> Setting:
        """The setting with the most hypotheses."""
        return self.equal[max(self.equal)]


@dataclass(frozen=True)
class Plan:
    """Settings of a study; each is run once, however many tables need it."""

    subjects: tuple[Subject, ...]
    controls: tuple[Setting, ...]
    retracking: tuple[Setting, ...] = ()  # the rows of the paper's table of people
    cuts: dict[float, tuple[Setting, ...]] = field(default_factory=dict)  # share of true detections below -> settings

    @property
    def equal(self) -> list[Setting]:
        """Every setting with the k samples of the env that the report ranks, each once; the controls first."""
        every = [*self.controls, *self.retracking]
        for subject in self.subjects:
            every += [subject.single, subject.end, subject.truth, *subject.equal.values()]
        return unique(every)

    @property
    def free(self) -> list[Setting]:
        """Every setting with more samples."""
        return unique(setting for subject in self.subjects for setting in subject.free.values())

    @property
    def cut(self) -> list[Setting]:
        """Every setting with a cut input."""
        return [setting for settings in self.cuts.values() for setting in settings]


def key_of(setting: Setting) -> str:
    """What tells settings apart: equal keys, equal runs."""
    content = {
        "submission": setting.submission.digest,
        "parameters": setting.parameters,
        "samples": setting.samples,
        "observe": setting.observe,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def unique(settings: Iterable[Setting]) -> list[Setting]:
    """The settings in their order, without those that are the same run as one before."""
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(key_of(setting), setting)
    return list(first.values())


def make_plan(
    names: Sequence[str], card: Card, hypotheses: Sequence[int] = HYPOTHESES, free: Sequence[int] = HYPOTHESES[1:]
) -> Plan:
    """The plan for some submissions on a card, without cuts of the input, which depend on its detections.

    ``hypotheses``: numbers to run an agent with that takes one; ``free``: of them, those to run without sampling too.
    Raises MtpBenchError without a name and where two submissions have one name, and SubmissionError for a count that is
    none.
    """
    if not names:
        raise MtpBenchError("a study is of an agent: name at least one")
    all_settings(names, card)  # two of one name, and broken manifests, show here
    compared = tuple(all_settings(control_names(), card))
    subjects = tuple(subject_of(load_submission(name), card, hypotheses, free) for name in dict.fromkeys(names))
    return Plan(subjects, compared, retracking_settings(card))


def subject_of(submission: Submission, card: Card, hypotheses: Sequence[int], free: Sequence[int]) -> Subject:
    """A submission in the settings of a study."""
    whole = setting_of(submission, card)
    end, truth, stated = _ends(whole, card)
    end = _named_once(end, whole)
    parameter, most = submission.compare.hypotheses, _most_hypotheses(whole)
    alone = (
        most == 1 and not whole.gap_references and key_of(end) != key_of(whole)
    )  # a control is where its gap begins, not it
    if parameter is None or submission.compare.observe == "truth" or alone:
        return Subject(submission.name, end, end, truth, {whole.hypotheses or 1: whole}, own_ends=stated)

    def with_hypotheses(count: int, budget: Any = "equal") -> Setting:
        return setting_of(submission, card, {parameter: count}, budget)

    single = end
    if whole.gap_references and (one := with_hypotheses(1)).parameters != end.parameters:
        single = _named_once(replace(one, label=f"{submission.name}, H = 1"), whole)
    counts = sorted({count for count in hypotheses if count <= most} | {most}) if most > 1 else [1]
    return Subject(
        name=submission.name,
        single=single,
        end=end,
        truth=truth,
        equal={count: single if count == 1 and stated else with_hypotheses(count) for count in counts},
        free={count: with_hypotheses(count, "free") for count in counts if count > 1 and count in {*free, most}},
        own_ends=stated,
    )


def _most_hypotheses(setting: Setting) -> int:
    """The largest number that the manifest states, as its parameter or in its sweep."""
    compare = setting.submission.compare
    swept = compare.sweep.get(compare.hypotheses, ()) if compare.hypotheses else ()
    return max([setting.hypotheses or 1, *(value for value in swept if isinstance(value, int))])


def _named_once(setting: Setting, whole: Setting) -> Setting:
    """``whole`` where the setting is the same run: one run has one name."""
    return whole if key_of(setting) == key_of(whole) else setting


def _ends(setting: Setting, card: Card) -> tuple[Setting, Setting, bool]:
    """One hypothesis, and true pasts, with the setting's own predictor; whether the manifest states them."""
    if setting.gap_references:
        single, truth = setting.gap_references
        name = ", ".join([setting.submission.name, *_changed(setting, single)])  # no other run has this name
        return replace(single, label=f"{name}, H = 1"), replace(truth, label=f"{name}, true pasts"), True
    role = controls()
    stp, past = (setting_of(load_submission(role[name]), card) for name in ("single", "ground_truth"))
    return stp, past, setting.gap_references == ()


def _changed(setting: Setting, end: Setting) -> list[str]:
    """What differs at an end of the gap beside the number of hypotheses, such as what its network was trained on."""
    counted = setting.submission.compare.hypotheses
    return [f"{k} = {v}" for k, v in end.parameters.items() if k != counted and setting.parameters.get(k) != v]


def with_cuts(plan: Plan, card: Card, cuts: dict[float, dict[str, float]]) -> Plan:
    """The plan, and the baselines with the input cut: share of true detections below -> least score per class."""
    settings = {
        share: tuple(setting_of(load_submission(name), card, {PARAMETER: cut}) for name in threshold_agents())
        for share, cut in cuts.items()
    }
    return replace(plan, cuts=settings)
