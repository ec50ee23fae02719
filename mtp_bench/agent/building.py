"""`make_action`: an action from plain arrays."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Action, MtpBenchError, ShapeError, Task, Tracks
from .action import FIELD_BY_NAME
from .checks import check_action

_ARGUMENT = {  # of make_action, by the field that it fills
    "object_box": "boxes",
    "object_class": "classes",
    "object_confidence": "confidence",
    "forecast": "forecasts",
    "forecast_log_weight": "log_weights",
    "track_id": "ids or tracks.track_id",
    "track_box": "tracks.box",
    "track_class": "tracks.class_id",
    "hypothesis_log_weight": "tracks.log_weight",
    "hypothesis_parent": "tracks.parent",
}
_NUMBERS = "fiu"  # kinds of dtype
_WHOLE_NUMBERS = "iu"


def make_action(
    task: Task,
    boxes: ArrayLike,
    classes: ArrayLike,
    forecasts: ArrayLike,
    log_weights: ArrayLike | None = None,
    *,
    confidence: ArrayLike | None = None,
    ids: ArrayLike | None = None,
    tracks: Tracks | None = None,
    checked: bool = True,
) -> Action:
    """Make the action with the boxes of O objects and their forecasts.

    ``boxes`` [O, 7]: x y z yaw l w h of each object now, in the observation's frame.
    ``classes`` [O]: index of each object's class in ``task.classes``. ``forecasts`` [O,
    T, 2], or [O, k, T, 2] with up to ``task.samples`` samples: x y in metres from the
    centre of the object's box, in each of the next T = ``task.future`` frames.
    ``log_weights`` [O, k]: logarithms of the samples' weights, -inf for an absent
    sample; without them all samples have equal weight.
    ``confidence`` [O]: probability from 0 to 1 that each object exists; without it 1.
    ``ids`` [O]: identities, the same number in every frame. They make the objects the
    tracks of one hypothesis.
    ``tracks``: tracks and hypotheses, if there are several. Without ``ids`` and
    ``tracks`` there are no tracks: bADE does not change, but every object counts as
    untracked.
    ``checked``: raise for numbers that the env would take out, such as NaN; False
    leaves that to the env.

    Objects beyond ``task.objects`` are left out, the last first, and so are tracks and
    hypotheses that do not fit, the least likely first. Raises ShapeError, a ValueError,
    that names the argument and the expected value, and MtpBenchError unless ``task`` is
    a Task.
    """
    _require_types(task, ids, tracks)
    box = _array("boxes", boxes, _NUMBERS, ("O", 7))
    objects = len(box)
    class_id = _array("classes", classes, _WHOLE_NUMBERS, (objects,))
    future = _forecast_array(forecasts, objects, task)
    fields = {
        "object_box": box,
        "object_class": class_id,
        "object_valid": np.ones(objects),
        "forecast": future,
        "forecast_log_weight": np.zeros(future.shape[:2]),
    }
    if log_weights is not None:
        fields["forecast_log_weight"] = _array(
            "log_weights", log_weights, _NUMBERS, future.shape[:2]
        )
    if confidence is not None:
        fields["object_confidence"] = _array(
            "confidence", confidence, _NUMBERS, (objects,)
        )
    fields = {name: array[: task.objects] for name, array in fields.items()}
    if ids is not None:
        track_id = _array("ids", ids, _WHOLE_NUMBERS, (objects,))
        tracks = Tracks.of_one_hypothesis(track_id, box, class_id)
    if tracks is not None:
        fields |= _track_fields(task, tracks)
    action = {
        name: field.filled(task, fields.get(name))
        for name, field in FIELD_BY_NAME.items()
    }
    if checked:
        _require_sound(action, task)
    return action


def _require_types(task: object, ids: object, tracks: object) -> None:
    if not isinstance(task, Task):
        raise MtpBenchError(
            f"task is of type {type(task).__name__}, "
            "expected a Task: env.unwrapped.task"
        )
    if not isinstance(tracks, (Tracks, type(None))):
        raise ShapeError(f"tracks is of type {type(tracks).__name__}, expected Tracks")
    if ids is not None and tracks is not None:
        raise ShapeError(
            "ids and tracks are both given, expected only one of them: "
            "tracks has ids of its own"
        )


def _forecast_array(forecasts: ArrayLike, objects: int, task: Task) -> NDArray[Any]:
    """Return the forecasts as an array [O, k, T, 2]."""
    one_sample = (objects, task.future, 2)
    several = (objects, "k", task.future, 2)
    future = _array("forecasts", forecasts, _NUMBERS, several, one_sample)
    if future.ndim == 3:
        future = future[:, None]
    if future.shape[1] > task.samples:
        raise ShapeError(
            f"forecasts holds {future.shape[1]} samples per object, "
            f"expected at most {task.samples}"
        )
    return future


def _track_fields(task: Task, tracks: Tracks) -> dict[str, NDArray[Any]]:
    """Return the fields of the tracks that fit, heaviest hypotheses first.

    Tracks without a hypothesis come last.
    """
    rows = np.arange(len(tracks.box))
    if len(rows) > task.tracks:
        # a last hypothesis that holds every track
        all_tracks = np.ones((1, len(rows)), dtype=bool)
        first_hypothesis = np.vstack([tracks.member, all_tracks]).argmax(axis=0)
        order = np.argsort(first_hypothesis, kind="stable")
        rows = np.sort(order[: task.tracks])
    fields = {
        "track_id": tracks.track_id[rows],
        "track_box": tracks.box[rows],
        "track_class": tracks.class_id[rows],
        "track_valid": np.ones(len(rows)),
        "hypothesis_member": tracks.member[: task.hypotheses, rows],
        "hypothesis_log_weight": tracks.log_weight[: task.hypotheses],
    }
    if tracks.parent is not None:
        parent = tracks.parent[: task.hypotheses]
        # -1 for a parent that did not fit into the action before
        fitting = np.where(parent < task.hypotheses, parent, -1)
        fields["hypothesis_parent"] = fitting
    return fields


def _array(
    name: str, value: ArrayLike, kinds: str, *shapes: tuple[int | str, ...]
) -> NDArray[Any]:
    """Return the argument ``name`` as an array of one of the ``shapes``.

    A letter in a shape fits any size. ``kinds``: accepted kinds of dtype. Raises
    ShapeError.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is not an array: {error}") from None
    empty = tuple(0 if isinstance(size, str) else size for size in shapes[-1])
    if array.shape == (0,) and 0 in empty:  # an empty list: no objects
        array = array.reshape(empty)
    if not any(_fits(array.shape, shape) for shape in shapes):
        expected = " or ".join(str(shape).replace("'", "") for shape in shapes)
        raise ShapeError(f"{name} has shape {array.shape}, expected {expected}")
    _require_kind(name, array, kinds)
    return array


def _require_kind(name: str, array: NDArray[Any], kinds: str) -> None:
    if array.dtype.kind not in kinds and array.size:
        expected = "numbers" if kinds == _NUMBERS else "whole numbers"
        raise ShapeError(f"{name} has dtype {array.dtype}, expected {expected}")


def _fits(shape: tuple[int, ...], expected: tuple[int | str, ...]) -> bool:
    if len(shape) != len(expected):
        return False
    pairs = zip(shape, expected, strict=True)
    return all(isinstance(size, str) or size == length for length, size in pairs)


def _require_sound(action: Action, task: Task) -> None:
    """Raise ShapeError for the first problem that takes out rows.

    Problems of objects come before those of tracks.
    """
    checked = check_action(action, task)
    errors = [problem for problem in checked.problems if problem.level == "error"]
    if errors:
        first = min(errors, key=lambda problem: problem.kind != "objects")
        raise ShapeError(first.sentence(name=_ARGUMENT[first.field]))
