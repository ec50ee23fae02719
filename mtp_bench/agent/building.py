"""`make_action`: an action from plain arrays."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import Action, MtpBenchError, ShapeError, Task, Tracks
from .action import FIELD
from .checks import examine

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
    """The action with the boxes of O objects and their forecasts.

    ``boxes`` [O, 7]: x y z yaw l w h of each object now, in the frame of the observation.
    ``classes`` [O]: index of each object's class in ``task.classes``.
    ``forecasts`` [O, T, 2], or [O, k, T, 2] with up to ``task.samples`` samples: x y in metres from the centre of the
    object's box, in each of the next T = ``task.future`` frames.
    ``log_weights`` [O, k]: logarithms of the samples' weights, -inf for an absent sample; without them all samples
    have equal weight.
    ``confidence`` [O]: probability from 0 to 1 that each object exists; without it 1.
    ``ids`` [O]: identities, the same number in every frame. They make the objects the tracks of one hypothesis.
    ``tracks``: tracks and hypotheses, if there are several. Without ``ids`` and ``tracks`` there are no tracks: bADE
    does not change, but every object counts as untracked.
    ``checked``: raise for numbers that the env would take out, such as NaN; False leaves that to the env.

    Objects beyond ``task.objects`` are left out, the last first, and so are tracks and hypotheses that do not fit, the
    least likely first. Raises ShapeError, a ValueError, that names the argument and the expected value, and
    MtpBenchError unless ``task`` is a Task.
    """
    if not isinstance(task, Task):
        raise MtpBenchError(
            f"task is of type {type(task).__name__}, expected a Task: env.unwrapped.task"
        )
    if not isinstance(tracks, (Tracks, type(None))):
        raise ShapeError(f"tracks is of type {type(tracks).__name__}, expected Tracks")
    box = _array("boxes", boxes, "fiu", ("O", 7))
    objects = len(box)
    class_id = _array("classes", classes, "iu", (objects,))
    future = _array(
        "forecasts",
        forecasts,
        "fiu",
        (objects, "k", task.future, 2),
        (objects, task.future, 2),
    )
    future = future[:, None] if future.ndim == 3 else future
    if future.shape[1] > task.samples:
        raise ShapeError(
            f"forecasts holds {future.shape[1]} samples per object, expected at most {task.samples}"
        )
    weight = np.zeros(future.shape[:2])
    if log_weights is not None:
        weight = _array("log_weights", log_weights, "fiu", future.shape[:2])
    certainty = np.ones(objects)
    if confidence is not None:
        certainty = _array("confidence", confidence, "fiu", (objects,))
    if ids is not None:
        if tracks is not None:
            raise ShapeError(
                "ids and tracks are both given, expected only one of them: tracks has ids of its own"
            )
        tracks = Tracks.of_one_hypothesis(
            _array("ids", ids, "iu", (objects,)), box, class_id
        )
    stated = {
        "object_box": box,
        "object_class": class_id,
        "object_valid": np.ones(objects),
        "object_confidence": certainty,
        "forecast": future,
        "forecast_log_weight": weight,
    }
    values = {name: array[: task.objects] for name, array in stated.items()}
    if tracks is not None:
        values |= _track_fields(task, tracks)
    action = {
        name: field.filled(task, values.get(name)) for name, field in FIELD.items()
    }
    if checked:
        _check(action, task)
    return action


def _track_fields(task: Task, tracks: Tracks) -> dict[str, NDArray[Any]]:
    """Fields of the tracks that fit, those of the heaviest hypotheses first; tracks without hypothesis come last."""
    kept = np.arange(len(tracks.box))
    if len(kept) > task.tracks:
        best = np.vstack([tracks.member, np.ones((1, len(kept)), dtype=bool)]).argmax(
            axis=0
        )
        kept = np.sort(np.argsort(best, kind="stable")[: task.tracks])
    return {
        "track_id": tracks.track_id[kept],
        "track_box": tracks.box[kept],
        "track_class": tracks.class_id[kept],
        "track_valid": np.ones(len(kept)),
        "hypothesis_member": tracks.member[: task.hypotheses, kept],
        "hypothesis_log_weight": tracks.log_weight[: task.hypotheses],
        **(
            {}
            if tracks.parent is None
            else {"hypothesis_parent": _parents(tracks.parent, task)}
        ),
    }


def _parents(parent: NDArray[Any], task: Task) -> NDArray[Any]:
    """Stated parents [H] of the hypotheses that fit; -1 for a parent that did not fit into the action before."""
    kept = parent[: task.hypotheses]
    return np.where(kept < task.hypotheses, kept, -1)


def _array(
    name: str, value: ArrayLike, kinds: str, *shapes: tuple[int | str, ...]
) -> NDArray[Any]:
    """The argument as an array of one of the shapes; a letter stands for any size."""
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ShapeError(f"{name} is not an array: {error}") from None
    empty = tuple(0 if isinstance(size, str) else size for size in shapes[-1])
    if array.shape == (0,) and 0 in empty:  # an empty list: no objects
        array = array.reshape(empty)
    if not any(_fits(array.shape, shape) for shape in shapes):
        wanted = " or ".join(str(shape).replace("'", "") for shape in shapes)
        raise ShapeError(f"{name} has shape {array.shape}, expected {wanted}")
    if array.dtype.kind not in kinds and array.size:
        raise ShapeError(
            f"{name} has dtype {array.dtype}, expected {'numbers' if 'f' in kinds else 'whole numbers'}"
        )
    return array


def _fits(shape: tuple[int, ...], wanted: tuple[int | str, ...]) -> bool:
    sizes = zip(shape, wanted, strict=False)
    return len(shape) == len(wanted) and all(
        isinstance(size, str) or got == size for got, size in sizes
    )


def _check(action: Action, task: Task) -> None:
    """Raise ShapeError for the first problem that makes the env take out rows; objects come before tracks."""
    problems = [
        problem
        for problem in examine(action, task).problems
        if problem.level == "error"
    ]
    if problems:
        first = min(problems, key=lambda problem: problem.kind != "objects")
        raise ShapeError(first.sentence(name=_ARGUMENT[first.field]))
