"""Manifest of a submission: the content of ``submission.toml``.

See ``baselines/README.md``.
"""

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
PART_SUFFIX = ".part"  # suffix of the folder of an unfinished submit
ROLLOUTS_SUFFIX = ".rollouts"  # suffix of the folder beside a record
MAX_NAME = 64  # characters
NAME_RULE = (
    f"expected at most {MAX_NAME} lower-case letters, digits and _ . - after a letter or "
    "a digit, no dot before a dot or at the end, no "
    f"{PART_SUFFIX} or {ROLLOUTS_SUFFIX} at the end, "
    "and no word that Windows reserves, such as con"
)
_NAME = re.compile(
    r"(?!(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$))"
    r"[a-z0-9][a-z0-9_-]*(\.[a-z0-9_-]+)*"
    rf"(?<!\{PART_SUFFIX})(?<!\{ROLLOUTS_SUFFIX})"
)
_MAX_SETTINGS = 1000  # of a comparison
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
# network and its training data
NetworkName = Annotated[str, Field(pattern=r"^[a-z0-9_]+-(truth|tracklets)$")]


def is_name(text: str) -> bool:
    """Return True for a name of a submission on every system.

    The folder of its records has this name.
    """
    return len(text) <= MAX_NAME and _NAME.fullmatch(text) is not None


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

    # parameter of the agent -> values to run it with
    sweep: dict[str, _Values] = Field(default_factory=dict)
    # k per object, or all drawn
    samples: Annotated[tuple[Literal["equal", "free"], ...], _NOT_EMPTY] = ("equal",)
    # mode of the env; only "detections" is ranked, "associated" is for baselines alone
    observe: Literal["detections", "truth", "associated", "tracks"] = "detections"
    # parameter for the number H of hypotheses; None: as many as the agent states
    hypotheses: str | None = None
    # parameter for how often k samples are drawn per hypothesis; None: once
    draws: str | None = None
    # Parameters of the reference pair of its gap: a single-hypothesis pipeline, which
    # takes ground-truth tracks if the env observes the truth; "controls": the baselines
    # with these roles have its predictor; None: not known
    gap_references: Literal["controls"] | dict[str, Value] | None = None
    # the same of its association gap, if they are others: its own predictor with and
    # without perfect association
    association_references: dict[str, Value] | None = None
    role: Role | None = None  # role as a baseline that others are compared with


class Manifest(Section):
    """Content of ``submission.toml``."""

    name: SubmissionName
    authors: Annotated[
        tuple[_Author, ...], Field(min_length=1, max_length=50, strict=False)
    ]
    # "module:function"
    agent: Annotated[
        str, Field(pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*$")
    ]
    description: Annotated[str, Field(max_length=2000), _Shown] = ""
    source: _Url = ""  # address of its code
    # commit of its code
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")] = ""
    paper: _Url = ""  # address of the paper that describes it
    # SPDX identifier of its licence
    license: Annotated[str, Field(pattern=r"^[A-Za-z0-9 .+()-]*$", max_length=100)] = ""
    training_data: Annotated[
        tuple[_Sentence, ...], Field(max_length=50, strict=False)
    ] = ()
    # env id -> parts trained on its scenes
    trained_on_scored: dict[str, _Sentence] = Field(default_factory=dict)
    # trained on this machine
    networks: Annotated[
        tuple[NetworkName, ...], Field(max_length=50, strict=False)
    ] = ()
    parameters: dict[str, Value] = Field(default_factory=dict)
    compare: CompareSection = CompareSection()


def read_manifest(folder: Path) -> Manifest:
    """Read the manifest of the submission in ``folder``.

    Raises SubmissionError, naming the key that is wrong.
    """
    where = f"{folder.name}/{MANIFEST}"
    manifest = validate(
        Manifest, read_toml(folder / MANIFEST, SubmissionError), where, SubmissionError
    )
    code = folder.joinpath(*manifest.agent.split(":")[0].split(".")).with_suffix(".py")
    if not code.is_file():
        expected = f"but there is no {code}"
        if ".py:" in manifest.agent:
            name = manifest.agent.replace(".py:", ":")
            expected = f"expected module:function without .py, such as {name!r}"
        raise SubmissionError(f"{where}: agent is {manifest.agent!r}, {expected}")
    _check_compare(manifest, where)
    return manifest


def _check_compare(manifest: Manifest, where: str) -> None:
    compare = manifest.compare
    parameters = {*manifest.parameters, *compare.sweep}
    for key, name in (("hypotheses", compare.hypotheses), ("draws", compare.draws)):
        if name is not None and name not in parameters:
            raise SubmissionError(
                f"{where}: compare.{key}: unknown parameter {name!r}"
                f"{nearest(name, parameters)} (it needs a value under [parameters] or in "
                "compare.sweep)"
            )
    settings = math.prod(map(len, compare.sweep.values())) * len(compare.samples)
    if settings > _MAX_SETTINGS:
        raise SubmissionError(
            f"{where}: compare.sweep makes {settings} settings, "
            f"expected at most {_MAX_SETTINGS}"
        )
