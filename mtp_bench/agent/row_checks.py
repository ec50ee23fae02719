"""Checks of the present rows of an action, one array after the other."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import ABSENT_BELOW, ID_LIMIT, Bools, Floats, Task
from .action import (
    COORDINATE_LIMIT,
    FIELD_BY_NAME,
    FORECAST_LIMIT,
    FORECAST_REACH,
    SIZE_LIMIT,
)

Arrays = dict[str, NDArray[Any]]
_LEAVE_OUT = "leave such rows out"
_PADDING = "leave out the padding of the observation, where detection_valid is 0"


def is_present(log_weight: Floats) -> Bools:
    """Mask the samples or hypotheses whose log-weight says present.

    False for NaN.
    """
    return np.asarray(log_weight >= ABSENT_BELOW)


def _not_finite(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray(~np.isfinite(values[name]).all(axis=1))


def _box_out_of_range(values: Arrays, name: str, task: Task) -> Bools:
    box = values[name]
    placed = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
    sized = ((box[:, 4:] > 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1)
    return np.asarray(np.isfinite(box).all(axis=1) & ~(placed & sized))


def _id_out_of_range(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray((values[name] < 0) | (values[name] > ID_LIMIT))


def _unknown(values: Arrays, name: str, task: Task) -> Bools:
    allowed = FIELD_BY_NAME[name].values_in(task)
    return np.asarray((values[name] < allowed.start) | (values[name] >= allowed.stop))


def _not_a_log_weight(values: Arrays, name: str, task: Task) -> Bools:
    broken = np.isnan(values[name]) | np.isposinf(values[name])
    # a row has one number, or one per sample
    return np.asarray(broken.any(axis=tuple(range(1, broken.ndim))))


def _not_a_probability(values: Arrays, name: str, task: Task) -> Bools:
    # NaN is not
    return np.asarray(~((values[name] >= 0) & (values[name] <= 1)))


def _no_sample(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray(~is_present(values[name]).any(axis=1))


def _sample_not_finite(values: Arrays, name: str, task: Task) -> Bools:
    finite = np.isfinite(values[name]).all(axis=(2, 3))
    sampled = is_present(values["forecast_log_weight"])
    return np.asarray((~finite & sampled).any(axis=1))


def _sample_too_far(values: Arrays, name: str, task: Task) -> Bools:
    if (np.abs(values[name]) <= FORECAST_REACH).all():  # quick, and nearly always
        return np.zeros(len(values[name]), dtype=bool)
    offset = values[name].astype(np.float64)
    length = np.hypot(offset[..., 0], offset[..., 1]).max(axis=-1)
    sampled = is_present(values["forecast_log_weight"])
    # NaN is not above the limit
    too_far = ((length > FORECAST_LIMIT) & sampled).any(axis=1)
    return np.asarray(too_far & ~_sample_not_finite(values, name, task))


class RowCheck(NamedTuple):
    """One check of all present rows of a kind."""

    field: str
    reason: str
    # mask of the claimed rows, from all fields of their kind and the field's name
    fails: Callable[[Arrays, str, Task], Bools]
    advice: str = _LEAVE_OUT
    expected: str = ""  # empty: as the table of fields states
    outside: bool = True  # as in `ActionProblem`


ROW_CHECKS = (
    RowCheck("track_box", "not finite", _not_finite),
    RowCheck("track_box", "out of range", _box_out_of_range),
    RowCheck("track_id", "out of range", _id_out_of_range),
    RowCheck("track_class", "unknown", _unknown),
    RowCheck("hypothesis_log_weight", "NaN or +inf", _not_a_log_weight),
    RowCheck("hypothesis_parent", "unknown", _unknown, "-1 for an unknown parent"),
    RowCheck("object_box", "not finite", _not_finite),
    RowCheck("object_box", "out of range", _box_out_of_range, _PADDING),
    RowCheck("object_class", "unknown", _unknown, _PADDING),
    RowCheck(
        "object_confidence",
        "not a probability",
        _not_a_probability,
        "state how likely it is that the object is there, "
        "not the detector's score as it is",
    ),
    RowCheck("forecast_log_weight", "NaN or +inf", _not_a_log_weight),
    RowCheck(
        "forecast_log_weight",
        "no sample present",
        _no_sample,
        expected="at least one per valid object",
        outside=False,
    ),
    RowCheck("forecast", "not finite", _sample_not_finite),
    RowCheck(
        "forecast",
        "too far",
        _sample_too_far,
        "subtract the centre of the box from absolute positions",
    ),
)
