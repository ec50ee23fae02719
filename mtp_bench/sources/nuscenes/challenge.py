"""Submissions to the nuScenes prediction challenge: a JSON list of predictions in the global frame.

Each is ``{"instance": token, "sample": token, "prediction": [S, T, 2], "probabilities": [S]}``, with T = 12 places at
2 Hz and at most 25 modes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ...errors import DataError
from ...types import Floats
from .fields import LIMIT
from .json_stream import brief, read_records, unwatched

FUTURE = 12  # places of a mode
MOST_MODES = 25


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is predicted of an object from one sample on."""

    instance: str
    sample: str
    modes: Floats  # [S, 12, 2] m, global frame
    probability: Floats  # [S]


def read_predictions(path: Path) -> Iterator[Prediction]:
    """The predictions of a file, in its order; DataError names the file and the entry that is wrong."""
    seen: set[tuple[str, str]] = set()
    for place, record in enumerate(read_records(path, unwatched)):
        where = f"{path}, entry {place}"
        tokens = []
        for key in ("instance", "sample"):
            if not isinstance(record.get(key), str):
                raise DataError(f"{where}: {key} is {brief(record.get(key))}, expected a token")
            tokens.append(record[key])
        if (tokens[0], tokens[1]) in seen:
            raise DataError(f"{where}: a second prediction of instance {tokens[0]!r} in sample {tokens[1]!r}")
        seen.add((tokens[0], tokens[1]))
        modes = _numbers(where, record, "prediction", ("S", FUTURE, 2))
        probability = _numbers(where, record, "probabilities", (len(modes),))
        if (probability < 0).any():
            raise DataError(f"{where}: probabilities are {brief(probability.tolist())}, expected numbers from 0 on")
        yield Prediction(tokens[0], tokens[1], modes, probability)


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


def _numbers(where: str, record: dict[str, Any], key: str, shape: tuple[int | str, ...]) -> Floats:
    """An array of a record; a text in ``shape`` stands for 1 to `MOST_MODES`."""
    try:
        value = np.asarray(record.get(key), dtype=np.float64)
    except (TypeError, ValueError):
        value = np.zeros(())
    fits = value.ndim == len(shape) and all(
        isinstance(n, str) or n == m for n, m in zip(shape, value.shape, strict=True)
    )
    if not fits or not 1 <= len(value) <= MOST_MODES:
        got = f"shape {list(value.shape)}" if value.ndim else brief(record.get(key))
        raise DataError(f"{where}: {key} is {got}, expected numbers {list(shape)}, at most {MOST_MODES} modes")
    if not (np.abs(value) <= LIMIT).all():
        raise DataError(f"{where}: {key} has a number that is not finite or beyond {LIMIT:g}")
    return value
