"""Submissions to the nuScenes prediction challenge: a JSON list of predictions in the global frame.

Each is ``{"instance": token, "sample": token, "prediction": [S, T, 2], "probabilities": [S]}``, with T = 12 places at
2 Hz and at most 25 modes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TextIO

import msgspec
import numpy as np

from ...errors import DataError
from ...types import Floats
from ..text import LIMIT, read_json
from .decoding import Pair

FUTURE = 12  # places of a mode
MOST_MODES = 25

_Mode = Annotated[list[Pair], msgspec.Meta(min_length=FUTURE, max_length=FUTURE)]
_Modes = msgspec.Meta(min_length=1, max_length=MOST_MODES)


class _Entry(msgspec.Struct, gc=False):
    instance: str
    sample: str
    prediction: Annotated[list[_Mode], _Modes]
    probabilities: Annotated[list[Annotated[float, msgspec.Meta(ge=0, le=LIMIT)]], _Modes]


@dataclass(frozen=True, eq=False)
class Prediction:
    """Forecast of an object from one sample on."""

    instance: str
    sample: str
    modes: Floats  # [S, 12, 2] m, global frame
    probability: Floats  # [S]


def read_predictions(path: Path) -> Iterator[Prediction]:
    """The predictions of a file, in its order; DataError names the file and the entry that is wrong."""
    seen: set[tuple[str, str]] = set()
    for row, entry in enumerate(read_json(path, list[_Entry])):
        if (entry.instance, entry.sample) in seen:
            raise DataError(
                f"{path}, entry {row}: a second prediction of instance {entry.instance!r} in sample {entry.sample!r}"
            )
        seen.add((entry.instance, entry.sample))
        if len(entry.prediction) != len(entry.probabilities):
            raise DataError(
                f"{path}, entry {row}: {len(entry.probabilities)} probabilities, expected one for each of "
                f"{len(entry.prediction)} modes"
            )
        yield Prediction(entry.instance, entry.sample, np.array(entry.prediction), np.array(entry.probabilities))


def write_predictions(file: TextIO, predictions: Iterable[Prediction]) -> int:
    """Write a submission and count its predictions; of more modes than are allowed the most probable are kept."""
    count = 0
    file.write("[")
    for each in predictions:
        kept = np.sort(np.argsort(-each.probability, kind="stable")[:MOST_MODES])
        content = {
            "instance": each.instance,
            "sample": each.sample,
            "prediction": each.modes[kept].tolist(),
            "probabilities": (each.probability[kept] / each.probability[kept].sum()).tolist(),
        }
        file.write(("," if count else "") + "\n" + json.dumps(content))
        count += 1
    file.write("\n]\n")
    return count
