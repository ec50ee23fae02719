"""The manifest of a submission: what ``submission.toml`` may say; see ``baselines/README.md``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from ..errors import SubmissionError, nearest
from ..files import clean_text
from ..strict import Section, read_toml, validate

MANIFEST = "submission.toml"
NAME_PATTERN = r"^[a-z0-9][a-z0-9_.-]*$"
MOST_NAME = 64  # characters
PARTS = ".part"  # ending of the folder of a submit that is not done
ROLLOUTS = ".rollouts"  # ending of the folder beside a record
BESIDE_RECORDS = (PARTS, ROLLOUTS)
Value = bool | int | float | str | list[Any] | dict[str, Any]
NetworkName = Annotated[str, Field(pattern=r"^[a-z0-9_]+-(truth|tracklets)$")]  # network and what it was trained on
Role = Literal["ground_truth", "single", "several", "same_samples", "hedged"]
MOST_SETTINGS = 1000  # that a comparison runs


def _visible(text: str) -> str:
    if clean_text(text, len(text) + 1) != text:
        raise ValueError("expected one line without controls and other invisible characters")
    return text


def _no_part(name: str) -> str:
    if name.endswith(BESIDE_RECORDS):
        raise ValueError(
            f"expected another ending than {' and '.join(BESIDE_RECORDS)}: folders beside records have these"
        )
    return name


_FolderName = Annotated[str, Field(pattern=NAME_PATTERN, max_length=MOST_NAME), AfterValidator(_no_part)]
_NOT_EMPTY = Field(min_length=1, strict=False)  # not strict: TOML has lists, no tuples
_Shown = AfterValidator(_visible)  # records and the leaderboard show it
_Author = Annotated[str, Field(max_length=100), _Shown]
_Sentence = Annotated[str, Field(max_length=300), _Shown]
_Values = Annotated[tuple[Value, ...], _NOT_EMPTY]


class CompareSection(Section):
    """How a comparison runs the submission, and which of its parameters are counts."""

    sweep: dict[str, _Values] = Field(default_factory=dict)  # parameter of the agent -> values to run it with
    samples: Annotated[tuple[Literal["equal", "free"], ...], _NOT_EMPTY] = ("equal",)  # k per object, or all drawn
    observe: Literal["detections", "truth", "tracks"] = "detections"  # what the env feeds; others are never ranked
    hypotheses: str | None = None  # parameter that is the number H of hypotheses; None: what the agent states
    draws: str | None = None  # parameter that is the number of times k samples are drawn per hypothesis; None: once
    # Parameters of the reference pair of its gap: a single-hypothesis pipeline, which takes ground-truth tracks if the
    # env observes the truth; "controls": the baselines with these roles have its predictor; None: not known
    gap_references: Literal["controls"] | dict[str, Value] | None = None
    role: Role | None = None  # of a baseline that others are compared with


class Manifest(Section):
    """The content of ``submission.toml``."""

    name: _FolderName  # it names a folder of records
    authors: Annotated[tuple[_Author, ...], Field(min_length=1, max_length=50, strict=False)]
    agent: Annotated[str, Field(pattern=r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*$")]
    description: Annotated[str, Field(max_length=2000), _Shown] = ""
    source: Annotated[str, Field(pattern=r"^(https?://[!-~]+)?$", max_length=300)] = ""  # where its code is
    commit: Annotated[str, Field(pattern=r"^([0-9a-f]{7,64})?$")] = ""
    paper: Annotated[str, Field(pattern=r"^(https?://[!-~]+)?$", max_length=300)] = ""  # where it is described
    license: Annotated[str, Field(pattern=r"^[A-Za-z0-9 .+()-]*$", max_length=100)] = ""  # as SPDX names it
    training_data: Annotated[tuple[_Sentence, ...], Field(max_length=50, strict=False)] = ()
    trained_on_scored: dict[str, _Sentence] = Field(default_factory=dict)  # env id -> what saw scenes it scores
    networks: Annotated[tuple[NetworkName, ...], Field(max_length=50, strict=False)] = ()  # whose weights it takes
    parameters: dict[str, Value] = Field(default_factory=dict)
    compare: CompareSection = CompareSection()


def read_manifest(folder: Path) -> Manifest:
    """The manifest of the submission in ``folder``; raises SubmissionError, naming the key, where it is wrong."""
    where = f"{folder.name}/{MANIFEST}"
    manifest = validate(Manifest, read_toml(folder / MANIFEST, SubmissionError), where, SubmissionError)
    code = folder.joinpath(*manifest.agent.split(":")[0].split(".")).with_suffix(".py")
    if not code.is_file():
        if ".py:" in manifest.agent:
            meant = manifest.agent.replace(".py:", ":")
            raise SubmissionError(
                f"{where}: agent is {manifest.agent!r}, expected module:function without .py, such as {meant!r}"
            )
        raise SubmissionError(f"{where}: agent is {manifest.agent!r}, but there is no {code}")
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
        raise SubmissionError(f"{where}: compare.sweep makes {settings} settings, expected at most {MOST_SETTINGS}")
