"""What stands in a file of presence: its keys, and how many numbers belong to each of them."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationInfo, field_validator

from ..errors import SubmissionError
from ..strict import Section, read_json, validate


def _a_table(rows: list[list[float]]) -> list[list[float]]:
    if len(rows) != 2 or len(rows[0]) != len(rows[1]) or len(rows[0]) < 2:
        raise ValueError(f"lengths {[len(row) for row in rows]}, expected two lists of one length, at least 2")
    if any(later <= earlier for earlier, later in pairwise(rows[0])):
        raise ValueError("expected a first list whose numbers rise")
    return rows


Table = Annotated[list[list[float]], AfterValidator(_a_table)]  # [2, n] what comes in and what it becomes, n >= 2


class Origin(Section):
    """Scenes of a split that were learnt from."""

    env: str
    split: str
    detector: str
    scenes: list[str]


class _Described(Section):
    """What a file says of itself."""

    detector: str = ""
    terms: str = ""


class ModelFile(_Described):
    """The numbers of a `mtp_bench.prediction.presence.PresenceModel`."""

    fitted_on: list[Origin] = Field(default_factory=list)
    features: Annotated[list[str], Field(min_length=1)]  # F
    low: list[float]  # [F]
    high: list[float]  # [F]
    center: list[float]  # [F]
    scale: list[Annotated[float, Field(gt=0)]]  # [F]
    shared: list[float]  # [1 + F] or [1 + F + F (F + 1) / 2]
    classes: dict[str, list[float]]  # [1 + F] each
    knots: Table  # of probabilities
    held_out: dict[str, Any] = Field(default_factory=dict)  # how good it is on scenes outside its fit

    @field_validator("low", "high", "center", "scale")
    @classmethod
    def _one_per_feature(cls, values: list[float], info: ValidationInfo) -> list[float]:
        return _of_length(values, [_features(info, values)])

    @field_validator("shared")
    @classmethod
    def _with_or_without_products(cls, values: list[float], info: ValidationInfo) -> list[float]:
        f = _features(info, values[1:])
        return _of_length(values, [1 + f, 1 + f + f * (f + 1) // 2])

    @field_validator("classes")
    @classmethod
    def _complete_classes(cls, values: dict[str, list[float]], info: ValidationInfo) -> dict[str, list[float]]:
        for name, row in values.items():
            if len(row) != 1 + _features(info, row[1:]):
                raise ValueError(f"{len(row)} numbers for {name!r}, expected {1 + _features(info, row[1:])}")
        return values

    @field_validator("knots")
    @classmethod
    def _probabilities(cls, values: list[list[float]]) -> list[list[float]]:
        if not all(0 <= value <= 1 for row in values for value in row):
            raise ValueError("expected numbers from 0 to 1")
        return values


class LikeFile(_Described):
    """A detector whose scores are put in place of those of another one, whose model it takes."""

    like: str
    score_map: dict[str, Table]  # of scores, per class


def read_file(path: Path) -> ModelFile | LikeFile:
    """What the file holds. Raises SubmissionError, naming the file and the key, where it is no such file."""
    content = read_json(path, SubmissionError)
    model: type[ModelFile] | type[LikeFile] = LikeFile if "like" in content else ModelFile
    return validate(model, content, str(path), SubmissionError)


def _features(info: ValidationInfo, otherwise: list[float]) -> int:
    """The number of features; where they are wrong themselves, so many as fit, for one error is enough."""
    return len(info.data.get("features", otherwise))


def _of_length(values: list[float], expected: list[int]) -> list[float]:
    if len(values) not in expected:
        raise ValueError(f"{len(values)} numbers, expected {' or '.join(map(str, expected))} for its features")
    return values
