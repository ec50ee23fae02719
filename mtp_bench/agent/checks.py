"""Checks of an action: what is wrong with it, in words.

The env takes out the rows that the checks find (`env.rollouts`); the conformance suite
and a strict env report them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core import ABSENT_BELOW, Bools, Ints, Task, closest, describe_problem
from .action import ACTION_FIELDS, FIELD_BY_NAME, ROW_KINDS, ActionField, RowKind
from .row_checks import ROW_CHECKS, Arrays

_MAKE_ACTION = "mtp_bench.make_action makes whole actions of plain arrays"
_MAX_SHOWN_NUMBERS = 8  # of one row
_FIELD_NAMES: dict[RowKind, list[str]] = {
    kind: [field.name for field in ACTION_FIELDS if field.rows == kind]
    for kind in ROW_KINDS
}
# the field that declares which rows of a kind are present
_DECLARED_BY: dict[RowKind, str] = {
    "tracks": "track_valid",
    "hypotheses": "hypothesis_log_weight",
    "objects": "object_valid",
}


@dataclass(frozen=True)
class ActionProblem:
    """One thing that is wrong with an action."""

    field: str
    reason: str
    expected: str
    rows: int = 1
    example: str = ""  # the first such row
    kind: str = ""  # one of ROW_KINDS, if its rows are taken out
    level: Literal["warning", "error"] = "error"
    advice: str = ""
    # the action is outside the action space; False: the space cannot express it
    outside: bool = True

    def sentence(self, where: str = "", name: str = "") -> str:
        """Describe what was got and expected, the row and what to do.

        ``where`` names the frame or file, if any. ``name`` replaces the field's name.
        """
        got = f"{name or self.field}: {self.reason}"
        example = self.example
        if self.rows > 1:
            got += f" in {self.rows} rows"
            example = f"first {example}"
        place = ", ".join(text for text in (where, example) if text)
        return describe_problem(got, self.expected, place, self.advice)


@dataclass(frozen=True, eq=False)
class CheckedAction:
    """The usable part of an action, and the problems of the rest."""

    # all fields, numbers in single precision; an unusable field has its fill value
    arrays: Arrays
    # [N], [H], [O] rows that the action declares present
    claimed: dict[RowKind, Bools]
    # [N], [H], [O] those of them that pass all checks; the others are invalid
    sound: dict[RowKind, Bools]
    problems: list[ActionProblem]

    @property
    def outside(self) -> list[ActionProblem]:
        """Problems that put the action outside the action space."""
        return [problem for problem in self.problems if problem.outside]

    @property
    def readable(self) -> bool:
        """True if all fields of the objects could be read."""
        # a problem with an example is that of rows
        needed = {"action", *_FIELD_NAMES["objects"]}
        return not any(
            problem.field in needed and problem.level == "error" and not problem.example
            for problem in self.problems
        )


def check_action(action: object, task: Task) -> CheckedAction:
    """Check ``action`` field by field and row by row.

    Never raise.
    """
    arrays, problems = _read_fields(action, task)
    claimed: dict[RowKind, Bools] = {}
    sound: dict[RowKind, Bools] = {}
    for kind in ROW_KINDS:
        claimed[kind] = _claimed_rows(kind, arrays, task)
        sound[kind] = np.zeros_like(claimed[kind])
        if all(name in arrays for name in _FIELD_NAMES[kind]):
            rows = np.flatnonzero(claimed[kind])
            passed, row_problems = _check_rows(arrays, kind, rows, task)
            sound[kind][rows[passed]] = True
            problems += row_problems
    if "hypothesis_member" in arrays and "hypothesis_log_weight" in arrays:
        problems += _check_membership(arrays, sound, task)
    for field in ACTION_FIELDS:
        if field.name not in arrays:
            arrays[field.name] = field.filled(task)
    return CheckedAction(arrays, claimed, sound, problems)


def _read_fields(action: object, task: Task) -> tuple[Arrays, list[ActionProblem]]:
    """Return the usable fields, and the problems of the others."""
    names = ", ".join(FIELD_BY_NAME)
    content: dict[Any, Any] | None = None
    if isinstance(action, Mapping):
        try:
            content = dict(action)
        except Exception:  # a mapping of the agent's own
            content = None
    if content is None:
        problem = ActionProblem(
            "action",
            f"is a {type(action).__name__}",
            f"a dict with {names}",
            kind="objects",
            advice=_MAKE_ACTION,
        )
        return {}, [problem]
    arrays: Arrays = {}
    problems: list[ActionProblem] = []
    for field in ACTION_FIELDS:
        array = _read_field(content, field, task)
        if isinstance(array, str):
            problem = ActionProblem(
                field.name,
                array,
                field.array_in(task),
                kind=field.rows,
                advice=_MAKE_ACTION,
            )
            problems.append(problem)
        else:
            arrays[field.name] = array
    return arrays, problems + _unknown_keys(content, names)


def _unknown_keys(content: dict[Any, Any], names: str) -> list[ActionProblem]:
    unknown = [key for key in content if key not in FIELD_BY_NAME]
    if not unknown:
        return []
    first = min(key if isinstance(key, str) else type(key).__name__ for key in unknown)
    similar = closest(first, FIELD_BY_NAME)
    advice = f"did you mean {similar!r}?" if similar else ""
    return [
        ActionProblem(
            "action",
            "has unknown keys",
            names,
            example=first,
            level="warning",
            advice=advice,
        )
    ]


def _read_field(
    content: dict[Any, Any], field: ActionField, task: Task
) -> NDArray[Any] | str:
    """Return the field as an array, or why it is unusable."""
    if field.name not in content:
        return field.filled(task) if field.optional else "is missing"
    try:
        array = np.asarray(content[field.name])
    except Exception as error:  # ragged lists, tensors of another device, any object
        return f"is not an array ({type(error).__name__}: {error})"
    if array.dtype.kind not in field.content.kinds:
        return f"has dtype {array.dtype}"
    if array.shape != field.shape_in(task):
        return f"has shape {array.shape}"
    if field.content.dtype is not np.float32 or array.dtype == np.float32:
        return array
    # too large becomes inf, which fails a check
    with np.errstate(over="ignore", invalid="ignore"):
        return array.astype(np.float32)


def _claimed_rows(kind: RowKind, arrays: Arrays, task: Task) -> Bools:
    """Mask the rows that the action declares present.

    All rows if the field that declares them cannot be read.
    """
    name = _DECLARED_BY[kind]
    if name not in arrays:
        return np.ones(FIELD_BY_NAME[name].shape_in(task)[0], dtype=bool)
    if kind == "hypotheses":
        return np.asarray(~(arrays[name] < ABSENT_BELOW))
    return np.asarray(arrays[name] != 0)


def _check_rows(
    arrays: Arrays, kind: RowKind, rows: Ints, task: Task
) -> tuple[Bools, list[ActionProblem]]:
    """Return a mask [n] of the claimed ``rows`` [n] that are sound, and problems."""
    sound = np.ones(len(rows), dtype=bool)
    problems: list[ActionProblem] = []
    if not len(rows):
        return sound, problems
    values = {name: arrays[name][rows] for name in _FIELD_NAMES[kind]}
    for check in ROW_CHECKS:
        field = FIELD_BY_NAME[check.field]
        if field.rows != kind:
            continue
        failed = check.fails(values, check.field, task)
        if failed.any():
            sound &= ~failed
            problem = _row_problem(
                arrays,
                check.field,
                rows[failed],
                reason=check.reason,
                expected=check.expected or field.expected_in(task),
                kind=kind,
                advice=check.advice,
                outside=check.outside,
            )
            problems.append(problem)
    return sound, problems


def _check_membership(
    arrays: Arrays, sound: dict[RowKind, Bools], task: Task
) -> list[ActionProblem]:
    """Find ids twice in a hypothesis, and tracks in none.

    Writes to ``sound``: tracks with such ids are no longer sound.
    """
    problems: list[ActionProblem] = []
    if not sound["tracks"].any():
        return problems
    member = arrays["hypothesis_member"] != 0
    member = member & sound["hypotheses"][:, None] & sound["tracks"]
    unused = np.flatnonzero(sound["tracks"] & ~member.any(axis=0))
    repeated = np.flatnonzero(_repeated_ids(arrays["track_id"], member))
    if len(repeated):
        sound["tracks"][repeated] = False
        problem = _row_problem(
            arrays,
            "track_id",
            repeated,
            reason="twice in one hypothesis",
            expected="an id once per hypothesis",
            kind="tracks",
            advice="give every object an identity of its own",
            outside=False,
        )
        problems.append(problem)
    if len(unused):
        problem = _row_problem(
            arrays,
            "track_valid",
            unused,
            reason="in no hypothesis, so unused",
            expected="every valid track in a hypothesis whose log-weight is present",
            level="warning",
            outside=False,
        )
        problems.append(problem)
    return problems


def _repeated_ids(track_id: Ints, member: Bools) -> Bools:
    """Mask the tracks [N] whose id another track of a hypothesis has.

    ``member`` [H, N]: tracks of each hypothesis.
    """
    repeated = np.zeros(len(track_id), dtype=bool)
    rows = np.flatnonzero(member.any(axis=0))
    ids, number = np.unique(track_id[rows], return_inverse=True)
    if len(ids) < len(rows):
        member_rows = member[:, rows].T
        count = np.zeros((len(ids), len(member)), dtype=np.int64)
        np.add.at(count, number, member_rows)
        repeated[rows] = (member_rows & (count[number] > 1)).any(axis=1)
    return repeated


def _row_problem(arrays: Arrays, field: str, rows: Ints, **texts: Any) -> ActionProblem:
    """Return the problem of ``rows``, with the first as example.

    ``texts``: further fields of `ActionProblem`.
    """
    value = np.asarray(arrays[field][rows[0]])
    example = f"{field}[{rows[0]}]"
    if value.ndim < 2:
        spec = ".4g" if value.dtype.kind == "f" else ""
        shown = value.ravel()[:_MAX_SHOWN_NUMBERS]
        numbers = ", ".join(format(number, spec) for number in shown)
        if value.size > _MAX_SHOWN_NUMBERS:
            numbers += ", ..."
        example += f" = [{numbers}]" if value.ndim else f" = {numbers}"
    return ActionProblem(field, rows=len(rows), example=example, **texts)
