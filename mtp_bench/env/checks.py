"""The checks of an answer, each once and with its reason in words.

The env takes out the rows that they find (`decoding`), and the conformance suite shows why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import closest
from ..types import ABSENT_BELOW, ID_LIMIT, Bools, Floats, Ints, Task
from .action import COORDINATE_LIMIT, FIELD, FIELDS, FORECAST_LIMIT, MASK, ROWS, SIZE_LIMIT, Field, Rows
from .problems import Problem, rows_problem

Arrays = dict[str, NDArray[Any]]
_IN_ONE = "every valid track in a hypothesis whose log-weight is present"
_LEAVE_OUT = "leave such rows out"
_PADDING = "leave out the padding of the observation, where detection_valid is 0"
_BUILDER = "mtp_bench.make_action makes whole actions of plain arrays"


@dataclass(frozen=True, eq=False)
class Examined:
    """What of an action can be used, and why the rest cannot."""

    arrays: Arrays  # all fields, numbers in single precision; one that cannot be used is as if nothing was said
    claimed: dict[Rows, Bools]  # [N], [H], [O] the rows that the action says are there
    sound: dict[Rows, Bools]  # [N], [H], [O] those of them that keep the contract; the others are invalid
    problems: list[Problem]

    @property
    def outside(self) -> list[Problem]:
        """What puts the action outside the action space."""
        return [problem for problem in self.problems if problem.outside]

    @property
    def readable(self) -> bool:
        """Whether the fields of the objects could be read, so that it is known which objects are stated."""
        unreadable = {problem.field for problem in self.problems if problem.level == "error" and not problem.example}
        return not unreadable & {"action", *(field.name for field in FIELDS if field.rows == "objects")}


def examine(action: object, task: Task) -> Examined:
    """What is sound in ``action`` and what is not. Never raises."""
    arrays, problems = _read_all(action, task)
    claimed: dict[Rows, Bools] = {rows: _claimed(rows, arrays, task) for rows in ROWS}
    sound: dict[Rows, Bools] = {rows: np.zeros_like(claimed[rows]) for rows in ROWS}
    for rows in ROWS:
        names = [field.name for field in FIELDS if field.rows == rows]
        if all(name in arrays for name in names):
            place = np.flatnonzero(claimed[rows])
            values = {name: arrays[name][place] for name in names}
            bad = np.zeros(len(place), dtype=bool)
            for check in _CHECKS:
                if FIELD[check.field].rows == rows:
                    found = check.bad(values, check.field, task)
                    bad |= found
                    problems += _problem(check, place[found], arrays, task)
            sound[rows][place[~bad]] = True
    if {"hypothesis_member", "hypothesis_log_weight"} <= set(arrays):
        problems += _check_membership(arrays, sound, task)
    problems += _check_masks(arrays)
    whole = {field.name: arrays[field.name] if field.name in arrays else field.filled(task) for field in FIELDS}
    return Examined(whole, claimed, sound, problems)


def present(log_weight: Floats) -> Bools:
    """Which log-weights say that a sample or a hypothesis is there; NaN does not."""
    return np.asarray(log_weight >= ABSENT_BELOW)


def _read_all(action: object, task: Task) -> tuple[Arrays, list[Problem]]:
    """The fields that can be used, and what is wrong with the others."""
    known = ", ".join(FIELD)
    try:
        given = dict(action) if isinstance(action, Mapping) else None
    except Exception:  # a mapping of the agent's own
        given = None
    if given is None:
        reason = f"is a {type(action).__name__}"
        return {}, [Problem("action", reason, f"a dict with {known}", kind="objects", advice=_BUILDER)]
    arrays: Arrays = {}
    problems: list[Problem] = []
    for field in FIELDS:
        got = _read(given, field, task)
        if isinstance(got, str):
            problems.append(Problem(field.name, got, field.array_in(task), kind=field.rows, advice=_BUILDER))
        else:
            arrays[field.name] = got
    unknown = sorted(key if isinstance(key, str) else type(key).__name__ for key in given if key not in FIELD)
    if unknown:
        close = closest(unknown[0], FIELD)
        advice = f"did you mean {close!r}?" if close else ""
        reason = "has keys that nobody reads"
        problems.append(Problem("action", reason, known, example=unknown[0], level="warning", advice=advice))
    return arrays, problems


def _read(action: dict[Any, Any], field: Field, task: Task) -> NDArray[Any] | str:
    """The field as an array, or why there is none."""
    if field.name not in action:
        return field.filled(task) if field.optional else "is missing"
    try:
        array = np.asarray(action[field.name])
    except Exception as error:  # whatever an agent hands over: ragged lists, tensors of another device, ...
        return f"is no array ({type(error).__name__}: {error})"
    if array.dtype.kind not in field.content.kinds:
        return f"has dtype {array.dtype}"
    if array.shape != field.shape_in(task):
        return f"has shape {array.shape}"
    if field.content.dtype is not np.float32:
        return array
    with np.errstate(over="ignore", invalid="ignore"):  # too large becomes inf, which is refused afterwards
        return array.astype(np.float32, copy=False)


def _claimed(rows: Rows, arrays: Arrays, task: Task) -> Bools:
    """The rows that the action says are there; all of them where it does not say."""
    says = {"tracks": "track_valid", "hypotheses": "hypothesis_log_weight", "objects": "object_valid"}[rows]
    if says not in arrays:
        return np.ones(FIELD[says].shape_in(task)[0], dtype=bool)
    return ~(arrays[says] < ABSENT_BELOW) if rows == "hypotheses" else arrays[says] != 0


def _not_finite(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray(~np.isfinite(values[name]).all(axis=1))


def _out_of_range(values: Arrays, name: str, task: Task) -> Bools:
    box = values[name]
    near = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
    sized = ((box[:, 4:] > 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1)
    return np.asarray(np.isfinite(box).all(axis=1) & ~(near & sized))


def _no_id(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray((values[name] < 0) | (values[name] > ID_LIMIT))


def _unknown(values: Arrays, name: str, task: Task) -> Bools:
    known = FIELD[name].values_in(task)
    return np.asarray((values[name] < known.start) | (values[name] >= known.stop))


def _no_probability(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray(~((values[name] >= 0) & (values[name] <= 1)))  # NaN is none either


def _no_log_weight(values: Arrays, name: str, task: Task) -> Bools:
    broken = np.isnan(values[name]) | np.isposinf(values[name])
    return np.asarray(broken.any(axis=tuple(range(1, broken.ndim))))


def _no_sample(values: Arrays, name: str, task: Task) -> Bools:
    return np.asarray(~present(values[name]).any(axis=1))


def _sample_not_finite(values: Arrays, name: str, task: Task) -> Bools:
    finite = np.isfinite(values[name]).all(axis=(2, 3))
    return np.asarray((~finite & present(values["forecast_log_weight"])).any(axis=1))


def _sample_too_far(values: Arrays, name: str, task: Task) -> Bools:
    offset = values[name].astype(np.float64)
    far = np.hypot(offset[..., 0], offset[..., 1]).max(axis=-1) > FORECAST_LIMIT  # NaN is not far
    far &= present(values["forecast_log_weight"])
    return np.asarray(far.any(axis=1) & ~_sample_not_finite(values, name, task))


class _Check(NamedTuple):
    field: str
    reason: str
    bad: Callable[[Arrays, str, Task], Bools]  # of the claimed rows of all fields of a kind, and the field's name
    advice: str = _LEAVE_OUT
    expected: str = ""  # empty: what the table of fields says of its entries
    outside: bool = True  # as in `Problem`


_CHECKS = (
    _Check("track_box", "not finite", _not_finite),
    _Check("track_box", "out of range", _out_of_range),
    _Check("track_id", "out of range", _no_id),
    _Check("track_class", "unknown", _unknown),
    _Check("hypothesis_log_weight", "NaN or +inf", _no_log_weight),
    _Check("hypothesis_parent", "unknown", _unknown, "-1 where it is not known"),
    _Check("object_box", "not finite", _not_finite),
    _Check("object_box", "out of range", _out_of_range, _PADDING),
    _Check("object_class", "unknown", _unknown, _PADDING),
    _Check(
        "object_confidence", "no probability", _no_probability,
        "state how likely it is that the object is there, not the detector's score as it is",
    ),
    _Check("forecast_log_weight", "NaN or +inf", _no_log_weight),
    _Check(
        "forecast_log_weight", "no sample present", _no_sample, _LEAVE_OUT, "at least one per valid object",
        outside=False,
    ),
    _Check("forecast", "not finite", _sample_not_finite),
    _Check("forecast", "too far", _sample_too_far, "subtract the centre of the box from absolute positions"),
)  # fmt: skip


def _check_membership(arrays: Arrays, sound: dict[Rows, Bools], task: Task) -> list[Problem]:
    """Take out of ``sound`` the tracks whose id occurs twice in a hypothesis; tracks in none are only warned of."""
    track_id, valid = (arrays.get(name, np.zeros(task.tracks, dtype=np.int64)) for name in ("track_id", "track_valid"))
    member = (arrays["hypothesis_member"] != 0) & sound["hypotheses"][:, None] & sound["tracks"]
    loose = np.flatnonzero(sound["tracks"] & ~member.any(axis=0))
    twice = np.flatnonzero(_repeated(track_id, member))
    sound["tracks"][twice] = False
    once = "an id once per hypothesis"
    apart = "give every object an identity of its own"
    return [
        *rows_problem("track_id", "twice in one hypothesis", once, twice, track_id, "tracks", apart, outside=False),
        *rows_problem("track_valid", "in no hypothesis, so unused", _IN_ONE, loose, valid, outside=False),
    ]


def _check_masks(arrays: Arrays) -> list[Problem]:
    """Entries of masks that are neither 0 nor 1 are taken as 1, and only warned of."""
    problems: list[Problem] = []
    for field in FIELDS:
        if field.content is MASK and field.name in arrays:
            mask = arrays[field.name].reshape(len(arrays[field.name]), -1)
            rows = np.flatnonzero(((mask < 0) | (mask > 1)).any(axis=1))
            problems += rows_problem(field.name, "neither 0 nor 1", field.content.expected, rows, arrays[field.name])
    return problems


def _repeated(track_id: Ints, member: Bools) -> Bools:
    """Which tracks [N] share their id with another track of one hypothesis; ``member`` is [H, N]."""
    repeated = np.zeros(len(track_id), dtype=bool)
    rows = np.flatnonzero(member.any(axis=0))
    ids, group = np.unique(track_id[rows], return_inverse=True)
    if len(ids) < len(rows):
        count = np.zeros((len(ids), len(member)), dtype=np.int64)
        np.add.at(count, group, member[:, rows].T)
        repeated[rows] = (member[:, rows].T & (count[group] > 1)).any(axis=1)
    return repeated


def _problem(check: _Check, rows: Ints, arrays: Arrays, task: Task) -> list[Problem]:
    """The problem of the bad ``rows``, with the first of them as example; none without any."""
    field = FIELD[check.field]
    expected = check.expected or field.expected_in(task)
    values = arrays[field.name]
    return rows_problem(field.name, check.reason, expected, rows, values, field.rows, check.advice, check.outside)
