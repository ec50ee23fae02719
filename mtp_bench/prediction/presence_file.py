"""Files of presence models: their keys, and how many numbers each has."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, model_validator

from ..errors import SubmissionError
from ..strict import Section, read_json, validate


def _increasing(rows: list[list[float]]) -> list[list[float]]:
    if len(rows) != 2 or len(rows[0]) != len(rows[1]) or len(rows[0]) < 2:
        raise ValueError(f"lengths {[len(row) for row in rows]}, expected two lists of one length, at least 2")
    if any(later <= earlier for earlier, later in pairwise(rows[0])):
        raise ValueError("expected a first list whose numbers rise")
    return rows


Table = Annotated[list[list[float]], AfterValidator(_increasing)]  # [2, n] input and output, n >= 2
_Probability = Annotated[float, Field(ge=0, le=1)]


class Origin(Section):
    """Scenes of a split that were learnt from."""

    env: str
    split: str
    detector: str
    scenes: list[str]


class ModelFile(Section):
    """Numbers of a `mtp_bench.prediction.presence.PresenceModel`."""

    detector: str = ""
    terms: str = ""
    fitted_on: list[Origin] = Field(default_factory=list)
    features: Annotated[list[str], Field(min_length=1)]  # F
    low: list[float]  # [F]
    high: list[float]  # [F]
    center: list[float]  # [F]
    scale: list[Annotated[float, Field(gt=0)]]  # [F]
    shared: list[float]  # [1 + F] or [1 + F + F (F + 1) / 2]
    classes: dict[str, list[float]]  # [1 + F] each
    knots: Annotated[list[list[_Probability]], AfterValidator(_increasing)]
    held_out: dict[str, Any] = Field(default_factory=dict)  # quality on scenes outside its fit
    score_map: dict[str, Table] = Field(default_factory=dict)  # per class; scores are mapped by it first

    @model_validator(mode="after")
    def _lengths_fit(self) -> ModelFile:
        f = len(self.features)
        rows: dict[str, tuple[list[float], tuple[int, ...]]]
        rows = {name: (getattr(self, name), (f,)) for name in ("low", "high", "center", "scale")}
        rows["shared"] = (self.shared, (1 + f, 1 + f + f * (f + 1) // 2))
        rows |= {f"classes.{name}": (row, (1 + f,)) for name, row in self.classes.items()}
        for name, (row, lengths) in rows.items():
            if len(row) not in lengths:
                expected = " or ".join(map(str, lengths))
                raise ValueError(f"{name} has {len(row)} numbers, expected {expected} for {f} features")
        return self


def read_file(path: Path) -> ModelFile:
    """The content of a file; raises SubmissionError, naming the file and the key, if it is not a presence model."""
    return validate(ModelFile, read_json(path, SubmissionError), str(path), SubmissionError)
