"""Checks of an action: what is wrong with it, in words.

The env takes out the rows that the checks find (`rollouts`); the conformance suite and a strict env report them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import (
    ABSENT_BELOW,
    ID_LIMIT,
    Bools,
    Floats,
    Ints,
    Task,
    closest,
    describe_problem,
)
from .action import (
    COORDINATE_LIMIT,
    FIELD,
    FIELDS,
    FORECAST_LIMIT,
    FORECAST_REACH,
    ROWS,
    SIZE_LIMIT,
    Field,
    Rows,
)

Arrays = dict[str, NDArray[Any]]
_LEAVE_OUT = "leave such rows out"
_PADDING = "leave out the padding of the observation, where detection_valid is 0"
_MAKE_ACTION = "mtp_bench.make_action makes whole actions of plain arrays"
_MOST_NUMBERS = 8  # of one row that are shown
_NAMES: dict[Rows, list[str]] = {
    rows: [field.name for field in FIELDS if field.rows == rows] for rows in ROWS
}


@dataclass(frozen=True)
class ActionProblem:
    """One thing that is wrong with an action."""

    field: str
    reason: str
    expected: str
    rows: int = 1
    example: str = ""  # the first such row
    kind: str = ""  # of ROWS, if rows of it are taken out
    level: Literal["warning", "error"] = "error"
    advice: str = ""
    outside: bool = True  # the action is outside the action space; False: the space cannot express it

    def sentence(self, where: str = "", name: str = "") -> str:
        """Got, expected, row and advice in one sentence; ``name`` replaces the name of the field."""
        several = self.rows > 1
        got = f"{name or self.field}: {self.reason}" + (
            f" in {self.rows} rows" if several else ""
        )
        example = f"first {self.example}" if several else self.example
        return describe_problem(
            got,
            self.expected,
            ", ".join(text for text in (where, example) if text),
            self.advice,
        )


@dataclass(frozen=True, eq=False)
class Examined:
    """The usable part of an action, and the problems of the rest."""

    arrays: Arrays  # all fields, numbers in single precision; an unusable field has its fill value
    claimed: dict[Rows, Bools]  # [N], [H], [O] rows that the action declares present
    sound: dict[
        Rows, Bools
    ]  # [N], [H], [O] those of them that pass all checks; the others are invalid
    problems: list[ActionProblem]

    @property
    def outside(self) -> list[ActionProblem]:
        """Problems that put the action outside the action space."""
        return [problem for problem in self.problems if problem.outside]

    @property
    def readable(self) -> bool:
        """True if all fields of the objects could be read, so that the number of stated objects is known."""
        unreadable = {
            problem.field
            for problem in self.problems
            if problem.level == "error" and not problem.example
        }
        return not unreadable & {
            "action",
            *(field.name for field in FIELDS if field.rows == "objects"),
        }


def examine(action: object, task: Task) -> Examined:
    """Check ``action`` field by field and row by row. Never raises."""
    arrays, problems = _read_all(action, task)
    claimed: dict[Rows, Bools] = {rows: _claimed(rows, arrays, task) for rows in ROWS}
    sound: dict[Rows, Bools] = {rows: np.zeros_like(claimed[rows]) for rows in ROWS}
    for rows, names in _NAMES.items():
        claimed_rows = np.flatnonzero(claimed[rows])
        if not len(claimed_rows) or not all(name in arrays for name in names):
            continue
        values = {name: arrays[name][claimed_rows] for name in names}
        bad = np.zeros(len(claimed_rows), dtype=bool)
        for check in _CHECKS:
            field = FIELD[check.field]
            if (
                field.rows == rows
                and (failed := check.bad(values, check.field, task)).any()
            ):
                bad |= failed
                expected, found = (
                    check.expected or field.expected_in(task),
                    claimed_rows[failed],
                )
                problems += _of_rows(
                    arrays,
                    check.field,
                    check.reason,
                    expected,
                    found,
                    rows,
                    check.advice,
                    check.outside,
                )
        sound[rows][claimed_rows[~bad]] = True
    if {"hypothesis_member", "hypothesis_log_weight"} <= set(arrays):
        problems += _check_membership(arrays, sound, task)
    whole = {
        field.name: arrays[field.name] if field.name in arrays else field.filled(task)
        for field in FIELDS
    }
    return Examined(whole, claimed, sound, problems)


def present(log_weight: Floats) -> Bools:
    """Mask of the samples or hypotheses that a log-weight declares present; False for NaN."""
    return np.asarray(log_weight >= ABSENT_BELOW)


def _read_all(action: object, task: Task) -> tuple[Arrays, list[ActionProblem]]:
    """Usable fields, and the problems of the others."""
    names = ", ".join(FIELD)
    try:
        given = dict(action) if isinstance(action, Mapping) else None
    except Exception:  # a mapping of the agent's own
        given = None
    if given is None:
        reason = f"is a {type(action).__name__}"
        return {}, [
            ActionProblem(
                "action",
                reason,
                f"a dict with {names}",
                kind="objects",
                advice=_MAKE_ACTION,
            )
        ]
    arrays: Arrays = {}
    problems: list[ActionProblem] = []
    for field in FIELDS:
        array = _read(given, field, task)
        if isinstance(array, str):
            problems += [
                ActionProblem(
                    field.name,
                    array,
                    field.array_in(task),
                    kind=field.rows,
                    advice=_MAKE_ACTION,
                )
            ]
        else:
            arrays[field.name] = array
    unknown = sorted(
        key if isinstance(key, str) else type(key).__name__
        for key in given
        if key not in FIELD
    )
    if unknown:
        close = closest(unknown[0], FIELD)
        advice = f"did you mean {close!r}?" if close else ""
        problems.append(
            ActionProblem(
                "action",
                "has unknown keys",
                names,
                example=unknown[0],
                level="warning",
                advice=advice,
            )
        )
    return arrays, problems


def _read(action: dict[Any, Any], field: Field, task: Task) -> NDArray[Any] | str:
    """The field as an array, or the reason why it cannot be used."""
    if field.name not in action:
        return field.filled(task) if field.optional else "is missing"
    try:
        array = np.asarray(action[field.name])
    except Exception as error:  # an agent may give any object: ragged lists, tensors of another device, ...
        return f"is not an array ({type(error).__name__}: {error})"
    if array.dtype.kind not in field.content.kinds:
        return f"has dtype {array.dtype}"
    if array.shape != field.shape_in(task):
        return f"has shape {array.shape}"
    if field.content.dtype is not np.float32 or array.dtype == np.float32:
        return array
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # too large becomes inf, which fails a check
        return array.astype(np.float32)


def _claimed(rows: Rows, arrays: Arrays, task: Task) -> Bools:
    """Rows that the action declares present; all if the field that declares it cannot be used."""
    name = {
        "tracks": "track_valid",
        "hypotheses": "hypothesis_log_weight",
        "objects": "object_valid",
    }[rows]
    if name not in arrays:
        return np.ones(FIELD[name].shape_in(task)[0], dtype=bool)
    return ~(arrays[name] < ABSENT_BELOW) if rows == "hypotheses" else arrays[name] != 0


def _box_out_of_range(values: Arrays, name: str, task: Task) -> Bools:
    box = values[name]
    near = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
    sized = ((box[:, 4:] > 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1)
    return np.asarray(np.isfinite(box).all(axis=1) & ~(near & sized))


def _unknown(values: Arrays, name: str, task: Task) -> Bools:
    known = FIELD[name].values_in(task)
    return np.asarray((values[name] < known.start) | (values[name] >= known.stop))


def _not_a_log_weight(values: Arrays, name: str, task: Task) -> Bools:
    broken = np.isnan(values[name]) | np.isposinf(values[name])
    return np.asarray(broken.any(axis=tuple(range(1, broken.ndim))))


def _sample_not_finite(values: Arrays, name: str, task: Task) -> Bools:
    finite = np.isfinite(values[name]).all(axis=(2, 3))
    return np.asarray((~finite & present(values["forecast_log_weight"])).any(axis=1))


def _sample_too_far(values: Arrays, name: str, task: Task) -> Bools:
    if (np.abs(values[name]) <= FORECAST_REACH).all():
        return np.zeros(len(values[name]), dtype=bool)
    offset = values[name].astype(np.float64)
    far = (
        np.hypot(offset[..., 0], offset[..., 1]).max(axis=-1) > FORECAST_LIMIT
    )  # NaN is not far
    far &= present(values["forecast_log_weight"])
    return np.asarray(far.any(axis=1) & ~_sample_not_finite(values, name, task))


class _Check(NamedTuple):
    field: str
    reason: str
    bad: Callable[
        [Arrays, str, Task], Any
    ]  # mask of the claimed rows of all fields of a kind, and the field's name
    advice: str = _LEAVE_OUT
    expected: str = ""  # empty: as the table of fields states
    outside: bool = True  # as in `ActionProblem`


_CHECKS = (
    _Check(
        "track_box",
        "not finite",
        lambda values, name, _: ~np.isfinite(values[name]).all(axis=1),
    ),
    _Check("track_box", "out of range", _box_out_of_range),
    _Check(
        "track_id",
        "out of range",
        lambda values, name, _: (values[name] < 0) | (values[name] > ID_LIMIT),
    ),
    _Check("track_class", "unknown", _unknown),
    _Check("hypothesis_log_weight", "NaN or +inf", _not_a_log_weight),
    _Check("hypothesis_parent", "unknown", _unknown, "-1 for an unknown parent"),
    _Check(
        "object_box",
        "not finite",
        lambda values, name, _: ~np.isfinite(values[name]).all(axis=1),
    ),
    _Check("object_box", "out of range", _box_out_of_range, _PADDING),
    _Check("object_class", "unknown", _unknown, _PADDING),
    _Check(
        "object_confidence",
        "not a probability",
        lambda values, name, _: (
            ~((values[name] >= 0) & (values[name] <= 1))
        ),  # also NaN
        "state how likely it is that the object is there, not the detector's score as it is",
    ),
    _Check("forecast_log_weight", "NaN or +inf", _not_a_log_weight),
    _Check(
        "forecast_log_weight",
        "no sample present",
        lambda values, name, _: ~present(values[name]).any(axis=1),
        _LEAVE_OUT,
        "at least one per valid object",
        outside=False,
    ),
    _Check("forecast", "not finite", _sample_not_finite),
    _Check(
        "forecast",
        "too far",
        _sample_too_far,
        "subtract the centre of the box from absolute positions",
    ),
)


def _check_membership(
    arrays: Arrays, sound: dict[Rows, Bools], task: Task
) -> list[ActionProblem]:
    """Find ids that occur twice in a hypothesis, which are taken out of ``sound``, and tracks without hypothesis."""
    if not sound["tracks"].any():
        return []
    absent = np.zeros(task.tracks, dtype=np.int64)
    arrays = {"track_id": absent, "track_valid": absent, **arrays}
    member = (
        (arrays["hypothesis_member"] != 0)
        & sound["hypotheses"][:, None]
        & sound["tracks"]
    )
    unused = np.flatnonzero(sound["tracks"] & ~member.any(axis=0))
    repeated = np.flatnonzero(_repeated(arrays["track_id"], member))
    sound["tracks"][repeated] = False
    once, advice = (
        "an id once per hypothesis",
        "give every object an identity of its own",
    )
    held = "every valid track in a hypothesis whose log-weight is present"
    return [
        *_of_rows(
            arrays,
            "track_id",
            "twice in one hypothesis",
            once,
            repeated,
            "tracks",
            advice,
            outside=False,
        ),
        *_of_rows(
            arrays,
            "track_valid",
            "in no hypothesis, so unused",
            held,
            unused,
            outside=False,
        ),
    ]


def _repeated(track_id: Ints, member: Bools) -> Bools:
    """Tracks [N] that share their id with another track of one hypothesis; ``member`` is [H, N]."""
    repeated = np.zeros(len(track_id), dtype=bool)
    rows = np.flatnonzero(member.any(axis=0))
    if len(set(track_id[rows].tolist())) < len(rows):
        ids, group = np.unique(track_id[rows], return_inverse=True)
        count = np.zeros((len(ids), len(member)), dtype=np.int64)
        np.add.at(count, group, member[:, rows].T)
        repeated[rows] = (member[:, rows].T & (count[group] > 1)).any(axis=1)
    return repeated


def _of_rows(
    arrays: Arrays,
    field: str,
    reason: str,
    expected: str,
    rows: Ints,
    kind: str = "",
    advice: str = "",
    outside: bool = True,
) -> list[ActionProblem]:
    """The problem of the ``rows`` of a field, with the first as example; empty without rows."""
    if not len(rows):
        return []
    value = np.asarray(arrays[field][rows[0]])
    example = f"{field}[{rows[0]}]"
    if value.ndim < 2:
        numbers = [
            f"{each:.4g}" if value.dtype.kind == "f" else str(each)
            for each in value.ravel()[:_MOST_NUMBERS]
        ]
        more = ", ..." if value.size > _MOST_NUMBERS else ""
        example += (
            f" = [{', '.join(numbers)}{more}]" if value.ndim else f" = {numbers[0]}"
        )
    level: Literal["warning", "error"] = "error" if kind else "warning"
    return [
        ActionProblem(
            field, reason, expected, len(rows), example, kind, level, advice, outside
        )
    ]
