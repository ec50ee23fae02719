"""Why the judge refuses parts of an answer: `mtp_bench.env.decoding` counts them, this names field and reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..env.decoding import decode
from ..env.spaces import ABSENT_BELOW, COORDINATE_LIMIT, FORECAST_LIMIT, ID_LIMIT, SIZE_LIMIT
from ..types import Bools, Task
from .findings import Level

KINDS = ("tracks", "hypotheses", "objects")  # in the order of `Rollout.invalid`
_MOST_NUMBERS = 8  # of one row that are shown
_OPTIONAL = "track_class"
_BOX = f"finite x y z yaw up to {COORDINATE_LIMIT:g}, and l w h above 0 up to {SIZE_LIMIT:g} m"
_KIND_NAMES = {"f": "floating", "i": "integer", "u": "integer", "b": "bool"}


@dataclass(frozen=True)
class Problem:
    """One reason to refuse rows of an answer; ``example`` is the first such row, the rest does not change with it."""

    field: str
    reason: str
    expected: str
    rows: int = 1
    example: str = ""
    kind: str = ""  # of KINDS, where rows of it are refused
    level: Level = "error"


def answer_problems(action: object, task: Task) -> list[Problem]:
    """Every reason why the judge takes something out of ``action``, and what it ignores without a word."""
    if not isinstance(action, Mapping):
        expected = f"a dict with {', '.join(_shapes(task))}"
        return [Problem("action", f"is a {type(action).__name__}", expected, kind="objects")]
    shapes = _shapes(task)
    arrays: dict[str, NDArray[Any]] = {}
    found: list[Problem] = []
    for name, (shape, kinds) in shapes.items():
        problem = _read(action, name, shape, kinds, arrays)
        if problem is not None:
            found.append(problem)
    unknown = sorted(str(key) for key in action if key not in shapes)
    if unknown:
        known = ", ".join(shapes)
        found.append(Problem("action", "has keys that nobody reads", known, len(unknown), unknown[0], level="warning"))
    found += _tracks(arrays, task) + _hypotheses(arrays) + _objects(arrays, task)
    return found + _unexplained(action, task, found)


def _shapes(task: Task) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and kinds of dtype of every field of an action, as the judge reads them."""
    n, o, h, k = task.tracks, task.objects, task.hypotheses, task.samples
    return {
        "track_id": ((n,), "iu"),
        "track_box": ((n, 7), "fiu"),
        "track_class": ((n,), "iu"),
        "track_valid": ((n,), "biu"),
        "hypothesis_member": ((h, n), "biu"),
        "hypothesis_log_weight": ((h,), "fiu"),
        "object_box": ((o, 7), "fiu"),
        "object_class": ((o,), "iu"),
        "object_valid": ((o,), "biu"),
        "forecast": ((o, k, task.future, 2), "fiu"),
        "forecast_log_weight": ((o, k), "fiu"),
    }


def _read(
    action: Mapping[Any, Any], name: str, shape: tuple[int, ...], kinds: str, arrays: dict[str, NDArray[Any]]
) -> Problem | None:
    """Put the field into ``arrays``, or say why it cannot be used."""
    kind = KINDS[0] if name.startswith("track") else KINDS[1] if name.startswith("hypothesis") else KINDS[2]
    wanted = f"an array of shape {shape} and {' or '.join(dict.fromkeys(_KIND_NAMES[k] for k in kinds))} dtype"
    if name not in action:
        return None if name == _OPTIONAL else Problem(name, "is missing", wanted, kind=kind)
    try:
        array = np.asarray(action[name])
    except Exception as error:  # ragged lists, tensors of another device
        return Problem(name, f"is no array ({type(error).__name__}: {error})", wanted, kind=kind)
    if array.dtype.kind not in kinds:
        return Problem(name, f"has dtype {array.dtype}", wanted, kind=kind)
    if array.shape != shape:
        return Problem(name, f"has shape {array.shape}", wanted, kind=kind)
    arrays[name] = _float32(array) if kinds == "fiu" else array
    return None


def _tracks(arrays: dict[str, NDArray[Any]], task: Task) -> list[Problem]:
    if not {"track_valid", "track_box", "track_id"} <= set(arrays):
        return []
    claimed = arrays["track_valid"] != 0
    box, track_id = arrays["track_box"], arrays["track_id"]
    finite = np.isfinite(box).all(axis=1)
    class_id = arrays.get("track_class", np.full(len(box), -1))
    reasons = [
        _rows("track_box", "not finite", _BOX, claimed & ~finite, box, "tracks"),
        _rows("track_box", "out of range", _BOX, claimed & finite & ~_sound(box), box, "tracks"),
        _rows(
            "track_id", "out of range", f"0 to {ID_LIMIT}", claimed & ((track_id < 0) | (track_id > ID_LIMIT)),
            track_id, "tracks",
        ),
        _rows(
            "track_class", "unknown", f"-1 (not stated) to {len(task.classes) - 1}",
            claimed & ((class_id < -1) | (class_id >= len(task.classes))), class_id, "tracks",
        ),
    ]  # fmt: skip
    return [reason for reason in reasons if reason is not None] + _membership(arrays, claimed)


def _membership(arrays: dict[str, NDArray[Any]], claimed: Bools) -> list[Problem]:
    """Ids that occur twice in a hypothesis, and tracks that no hypothesis holds."""
    if not {"hypothesis_member", "hypothesis_log_weight"} <= set(arrays):
        return []
    present = arrays["hypothesis_log_weight"] >= ABSENT_BELOW
    member = (arrays["hypothesis_member"] != 0) & claimed & present[:, None]
    track_id, found = arrays["track_id"], []
    twice = np.zeros(len(claimed), dtype=bool)
    for row in member:
        ids, count = np.unique(track_id[row], return_counts=True)
        twice |= row & np.isin(track_id, ids[count > 1])
    found.append(_rows("track_id", "twice in one hypothesis", "an id once per hypothesis", twice, track_id, "tracks"))
    loose = claimed & ~member.any(axis=0)
    expected = "every valid track in a hypothesis whose log-weight is present"
    found.append(_rows("track_valid", "in no hypothesis, so unused", expected, loose, track_id, level="warning"))
    return [problem for problem in found if problem is not None]


def _hypotheses(arrays: dict[str, NDArray[Any]]) -> list[Problem]:
    weight = arrays.get("hypothesis_log_weight")
    if weight is None:
        return []
    broken = np.isnan(weight) | np.isposinf(weight)
    expected = "finite numbers, or -inf for a hypothesis that is not there"
    problem = _rows("hypothesis_log_weight", "NaN or +inf", expected, broken, weight, "hypotheses")
    return [] if problem is None else [problem]


def _objects(arrays: dict[str, NDArray[Any]], task: Task) -> list[Problem]:
    if not {"object_valid", "object_box", "object_class", "forecast", "forecast_log_weight"} <= set(arrays):
        return []
    claimed = arrays["object_valid"] != 0
    box, class_id, weight = arrays["object_box"], arrays["object_class"], arrays["forecast_log_weight"]
    present = weight >= ABSENT_BELOW
    broken = np.isnan(weight) | np.isposinf(weight)
    forecast = arrays["forecast"].astype(np.float64)
    finite = (np.isfinite(forecast).all(axis=(2, 3)) | ~present).all(axis=1)
    whole = np.isfinite(box).all(axis=1)
    with np.errstate(invalid="ignore"):
        far = (np.hypot(forecast[..., 0], forecast[..., 1]).max(axis=-1) > FORECAST_LIMIT) & present
    named = "finite numbers, or -inf for a sample that is not there"
    reach = f"metres from the object's own centre, at most {FORECAST_LIMIT:g}"
    reasons = [
        _rows("object_box", "not finite", _BOX, claimed & ~whole, box, "objects"),
        _rows("object_box", "out of range", _BOX, claimed & whole & ~_sound(box), box, "objects"),
        _rows(
            "object_class", "unknown", f"0 to {len(task.classes) - 1}",
            claimed & ((class_id < 0) | (class_id >= len(task.classes))), class_id, "objects",
        ),
        _rows("forecast_log_weight", "NaN or +inf", named, claimed & broken.any(axis=1), weight, "objects"),
        _rows(
            "forecast_log_weight", "no sample present", "at least one per valid object",
            claimed & ~present.any(axis=1), weight, "objects",
        ),
        _rows("forecast", "not finite", reach, claimed & ~finite, None, "objects"),
        _rows("forecast", "too far", reach, claimed & finite & far.any(axis=1), None, "objects"),
    ]  # fmt: skip
    return [reason for reason in reasons if reason is not None]


def _unexplained(action: Mapping[Any, Any], task: Task, found: list[Problem]) -> list[Problem]:
    """What the judge counts and nothing above explains: the two must not drift apart in silence."""
    counts = decode(action, task).invalid
    return [
        Problem(kind, "refused by the judge", "rows that keep the contract", int(count), kind=kind)
        for kind, count in zip(KINDS, counts, strict=True)
        if count and not any(problem.kind == kind for problem in found)
    ]


def _rows(
    field: str,
    reason: str,
    expected: str,
    bad: Bools,
    values: NDArray[Any] | None,
    kind: str = "",
    level: Level = "error",
) -> Problem | None:
    """The problem of the rows ``bad``, with the first of them as example; None without any."""
    rows = np.flatnonzero(bad)
    if not len(rows):
        return None
    value = "" if values is None else f" = {_shown(np.asarray(values[rows[0]]))}"
    return Problem(field, reason, expected, len(rows), f"{field}[{rows[0]}]{value}", kind, level)


def _shown(value: NDArray[Any]) -> str:
    numbers = [f"{number:.4g}" for number in value.ravel()[:_MOST_NUMBERS]]
    more = ", ..." if value.size > _MOST_NUMBERS else ""
    return f"[{', '.join(numbers)}{more}]" if value.ndim else numbers[0]


def _sound(box: NDArray[Any]) -> Bools:
    with np.errstate(invalid="ignore"):
        near = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
        return np.asarray(near & ((box[:, 4:] > 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1))


def _float32(array: NDArray[Any]) -> NDArray[np.float32]:
    with np.errstate(over="ignore", invalid="ignore"):
        return array.astype(np.float32)
