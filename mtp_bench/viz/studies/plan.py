"""Settings of a study: each agent with one to many hypotheses, with and without sampling, and the controls."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from ...agent import Submission, load_submission
from ...cards import Card
from ...core import MtpBenchError
from ...judge import digest_of
from ...running import (
    HYPOTHESIS_CONTROLS,
    Setting,
    all_settings,
    control_names,
    kinematic_references,
    references_of,
    setting_of,
)
from ...scoring import Budget

HYPOTHESES = (1, 2, 5, 10, 20)


@dataclass(frozen=True)
class StudiedAgent:
    """The settings of an agent that is studied."""

    name: str
    single: Setting  # itself with one hypothesis
    reference: Setting  # start of its gap: ``single``, unless the manifest states more than one hypothesis
    truth: Setting  # ``reference`` on ground-truth tracks
    equal: dict[
        int, Setting
    ]  # by hypotheses, with the k samples of the env; 1 is ``single``
    free: dict[int, Setting] = field(
        default_factory=dict
    )  # by hypotheses, with the samples of all of them
    references: dict[int, dict[str, Setting]] = field(
        default_factory=dict
    )  # by hypotheses, see `references_of`

    @property
    def most(self) -> Setting:
        """The setting with the most hypotheses."""
        return self.equal[max(self.equal)]


@dataclass(frozen=True)
class StudyPlan:
    """Settings of a study; each is run once, however many tables need it."""

    subjects: tuple[StudiedAgent, ...]
    controls: tuple[Setting, ...]

    @property
    def rivals(self) -> list[Setting]:
        """The controls that a gain of hypotheses must exceed: the same samples, and the futures of neighbours."""
        return [
            setting
            for setting in self.controls
            if setting.submission.compare.role in HYPOTHESIS_CONTROLS
        ]

    @property
    def equal(self) -> list[Setting]:
        """Every setting with the k samples of the env, each once; the controls first."""
        settings = [*self.controls]
        for subject in self.subjects:
            settings += [
                subject.single,
                subject.reference,
                subject.truth,
                *subject.equal.values(),
            ]
            settings += [
                setting
                for references in subject.references.values()
                for setting in references.values()
            ]
        return unique(settings)

    @property
    def free(self) -> list[Setting]:
        """Every setting with more than k samples."""
        return unique(
            setting for subject in self.subjects for setting in subject.free.values()
        )


def key_of(setting: Setting) -> str:
    """Digest of what a setting runs: settings with equal keys are the same run."""
    return digest_of(
        [
            setting.submission.digest,
            setting.parameters,
            setting.samples,
            setting.observe,
        ]
    )


def unique(settings: Iterable[Setting]) -> list[Setting]:
    """The first setting of each run, in order."""
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(key_of(setting), setting)
    return list(first.values())


def make_plan(
    names: Sequence[str], card: Card, hypotheses: Sequence[int], free: Sequence[int]
) -> StudyPlan:
    """The plan for submissions on a card.

    ``hypotheses``: numbers of hypotheses to run an agent with, if it has such a parameter; ``free``: those of them to
    run with all samples too. Raises MtpBenchError without a name and for two submissions of one name, and
    SubmissionError for a count that is not a whole number.
    """
    if not names:
        raise MtpBenchError("a study needs an agent: name at least one")
    all_settings(names, card)  # checks the names and manifests
    subjects = (
        subject_of(load_submission(name), card, hypotheses, free)
        for name in dict.fromkeys(names)
    )
    studied = tuple(_with_references(subject, card) for subject in subjects)
    return StudyPlan(studied, tuple(all_settings(control_names(), card)))


def subject_of(
    submission: Submission, card: Card, hypotheses: Sequence[int], free: Sequence[int]
) -> StudiedAgent:
    """The settings of a submission."""
    whole = setting_of(submission, card)
    reference, truth, stated = _reference_pair(whole, card)
    reference = (
        whole if key_of(reference) == key_of(whole) else reference
    )  # one run has one name
    parameter = submission.compare.hypotheses
    swept = submission.compare.sweep.get(parameter, ()) if parameter else ()
    most = max(
        [whole.hypotheses or 1, *(value for value in swept if isinstance(value, int))]
    )
    starts_at_control = (
        most == 1 and not whole.gap_references and reference is not whole
    )
    if parameter is None or submission.compare.observe == "truth" or starts_at_control:
        return StudiedAgent(
            submission.name, reference, reference, truth, {whole.hypotheses or 1: whole}
        )

    def with_hypotheses(count: int, budget: Budget = "equal") -> Setting:
        return setting_of(submission, card, {parameter: count}, budget)

    single = reference
    if (
        whole.gap_references
        and (one := with_hypotheses(1)).parameters != reference.parameters
    ):
        single = (
            whole
            if key_of(one) == key_of(whole)
            else replace(one, label=f"{submission.name}, H = 1")
        )
    counts = (
        sorted({count for count in hypotheses if count <= most} | {most})
        if most > 1
        else [1]
    )
    return StudiedAgent(
        name=submission.name,
        single=single,
        reference=reference,
        truth=truth,
        equal={
            count: single if count == 1 and stated else with_hypotheses(count)
            for count in counts
        },
        free={
            count: with_hypotheses(count, "free")
            for count in counts
            if count > 1 and count in {*free, most}
        },
    )


def _with_references(subject: StudiedAgent, card: Card) -> StudiedAgent:
    """The subject with the runs of its association gap and of the parts of its error, under names of their own."""

    def named(name: str, setting: Setting) -> Setting:
        own = setting.submission.name == subject.name
        return (
            replace(setting, label=f"{subject.name}, {name.replace('_', ' ')}")
            if own
            else setting
        )

    found = {
        count: references_of(setting, card) for count, setting in subject.equal.items()
    }
    references = {
        count: {name: named(name, each) for name, each in of.items()}
        for count, of in found.items()
    }
    return replace(subject, references=references)


def _reference_pair(setting: Setting, card: Card) -> tuple[Setting, Setting, bool]:
    """One hypothesis, and ground-truth tracks, with the setting's own predictor; False if the manifest states none."""
    if not setting.gap_references:
        found = kinematic_references(setting, card)
        return found["single"], found["ground_truth"], setting.gap_references == ()
    single, truth = setting.gap_references
    counted = setting.submission.compare.hypotheses
    changed = [
        f"{k} = {v}"
        for k, v in single.parameters.items()
        if k != counted and setting.parameters.get(k) != v
    ]
    name = ", ".join([setting.submission.name, *changed])  # no other run has this name
    return (
        replace(single, label=f"{name}, H = 1"),
        replace(truth, label=f"{name}, GT tracks"),
        True,
    )
