"""Manifest of a submission: the content of ``submission.toml``; see ``baselines/README.md``."""

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ..core import (
    Section,
    SubmissionError,
    clean_text,
    nearest,
    read_toml,
    rule,
    validate,
)

MANIFEST = "submission.toml"
PARTS = ".part"  # suffix of the folder of an unfinished submit
ROLLOUTS = ".rollouts"  # suffix of the folder beside a record
MOST_NAME = 64  # characters
NAME_RULE = (
    f"expected at most {MOST_NAME} lower-case letters, digits and _ . - after a letter or a digit, no dot before a dot "
    f"or at the end, no {PARTS} or {ROLLOUTS} at the end, and no word that Windows reserves, such as con"
)
_NAME = re.compile(
    rf"(?!(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$))[a-z0-9][a-z0-9_-]*(\.[a-z0-9_-]+)*(?<!\{PARTS})(?<!\{ROLLOUTS})"
)
MOST_SETTINGS = 1000  # of a comparison
Value = bool | int | float | str | list[Any] | dict[str, Any]
Role = Literal[
    "ground_truth",
    "single",
    "several",
    "same_samples",
    "neighbours",
    "bends",
    "hedged",
    "associated",
    "associated_same_samples",
    "standing",
    "blind",
]
NetworkName = Annotated[
    str, Field(pattern=r"^[a-z0-9_]+-(truth|tracklets)$")
]  # network and its training data


def is_name(text: str) -> bool:
    """Return True for a text that can name a submission, and so the folder of its records, on every system."""
    return len(text) <= MOST_NAME and _NAME.fullmatch(text) is not None


SubmissionName = Annotated[str, rule(is_name, NAME_RULE)]
_NOT_EMPTY = Field(min_length=1, strict=False)  # TOML has lists, no tuples
_Shown = rule(  # records and the leaderboard show it
    lambda text: clean_text(text, len(text) + 1) == text,
    "expected one line without controls and other invisible characters",
)
_Author = Annotated[str, Field(max_length=100), _Shown]
_Sentence = Annotated[str, Field(max_length=300), _Shown]
_Url = Annotated[str, Field(pattern=r"^(https?://[!-~]+)?$", max_length=300)]
_Values = Annotated[tuple[Value, ...], _NOT_EMPTY]


class CompareSection(Section):
    """Settings that a comparison runs, and the parameters that are counts."""

    sweep: dict[str, _Values] = Field(
        default_factory=dict
    )  # parameter of the agent -> values to run it with
    samples: Annotated[tuple[Literal["equal", "free"], ...], _NOT_EMPTY] = (
        "equal",
    )  # k per object, or all drawn
    # of the env; only "detections" is ranked, and "associated" is for baselines alone
    observe: Literal["detections", "truth", "associated", "tracks"] = "detections"
    hypotheses: str | None = (
        None  # parameter for the number H of hypotheses; None: as many as the agent states
    )
    draws: str | None = (
        None  # parameter for how often k samples are drawn per hypothesis; None: once
    )
    # Parameters of the reference pair of its gap: a single-hypothesis pipeline, which takes ground-truth tracks if the
    # env observes the truth; "controls": the baselines with these roles have its predictor; None: not known
    gap_references: Literal["controls"] | dict[str, Value] | None = None
    # the same of its association gap, if they are others: its own predictor with and without perfect association
    association_references: dict[str, Value] | None = None
    role: Role | None = None  # of a baseline that others are compared with


class Manifest(Section):
    """Content of ``submission.toml``."""

    name: SubmissionName
    authors: Annotated[
        tuple[_Author, ...], Field(min_length=1, max_length=50, strict=False)
    ]
    agent: Annotated[
        str, Field(pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*$")
    ]  # "module:function"
    description: Annotated[str, Field(max_length=2000), _Shown] = ""
    source: _Url = ""  # of its code
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")] = ""  # of its code
    paper: _Url = ""  # that describes it
    license: Annotated[str, Field(pattern=r"^[A-Za-z0-9 .+()-]*$", max_length=100)] = (
        ""  # as SPDX names it
    )
    training_data: Annotated[
        tuple[_Sentence, ...], Field(max_length=50, strict=False)
    ] = ()
    trained_on_scored: dict[str, _Sentence] = Field(
        default_factory=dict
    )  # env id -> parts trained on its scenes
    networks: Annotated[
        tuple[NetworkName, ...], Field(max_length=50, strict=False)
    ] = ()  # trained on this machine
    parameters: dict[str, Value] = Field(default_factory=dict)
    compare: CompareSection = CompareSection()


def read_manifest(folder: Path) -> Manifest:
    """The manifest of the submission in ``folder``; raises SubmissionError, naming the key that is wrong."""
    where = f"{folder.name}/{MANIFEST}"
    manifest = validate(
        Manifest, read_toml(folder / MANIFEST, SubmissionError), where, SubmissionError
    )
    code = folder.joinpath(*manifest.agent.split(":")[0].split(".")).with_suffix(".py")
    if not code.is_file():
        expected = f"but there is no {code}"
        if ".py:" in manifest.agent:
            expected = f"expected module:function without .py, such as {manifest.agent.replace('.py:', ':')!r}"
        raise SubmissionError(f"{where}: agent is {manifest.agent!r}, {expected}")
    _check_compare(manifest, where)
    return manifest


def _check_compare(manifest: Manifest, where: str) -> None:
    compare, known = manifest.compare, {*manifest.parameters, *manifest.compare.sweep}
    for key, name in (("hypotheses", compare.hypotheses), ("draws", compare.draws)):
        if name is not None and name not in known:
            raise SubmissionError(
                f"{where}: compare.{key}: unknown parameter {name!r}{nearest(name, known)} (it needs a value under "
                "[parameters] or in compare.sweep)"
            )
    settings = math.prod(map(len, compare.sweep.values())) * len(compare.samples)
    if settings > MOST_SETTINGS:
        raise SubmissionError(
            f"{where}: compare.sweep makes {settings} settings, expected at most {MOST_SETTINGS}"
        )
