"""Whether the numbers that an answer uses are finite: one that is not leaves the frame unanswered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..env.action import ABSENT_BELOW

_NOTHING = np.zeros(0)


def finite(action: Mapping[str, NDArray[Any]]) -> bool:
    """Whether every number of the tracks, hypotheses, objects and samples that are there is finite.

    ``action``: arrays of the right shapes; fields may be missing. Rows that are not valid may hold anything, as may
    samples whose log-weight says that they are absent; -inf is such a log-weight, NaN and +inf are none.
    """
    weight, forecast = _claimed(action, "forecast_log_weight", "object"), _claimed(action, "forecast", "object")
    if len(weight) == len(forecast):  # else a field is missing: every sample counts
        forecast = forecast[weight >= ABSENT_BELOW]
    numbers = (_claimed(action, "track_box", "track"), _claimed(action, "object_box", "object"), forecast)
    weights = (weight, action.get("hypothesis_log_weight", _NOTHING))
    return all(np.isfinite(part).all() for part in numbers) and all((part < np.inf).all() for part in weights)


def _claimed(action: Mapping[str, NDArray[Any]], name: str, kind: str) -> NDArray[Any]:
    """Rows of a field that the mask of its kind says are there; all of them without a mask."""
    array, mask = action.get(name, _NOTHING), action.get(f"{kind}_valid")
    return array if mask is None or not len(array) else array[mask != 0]
