"""Actions as they are recorded, rollouts made of them, and their digest.

Only sound rows are recorded, in the scene's frame of reference. A row that is taken out
counts as missing, so breaking the contract is never better than an empty action.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..agent import ROW_KINDS, CheckedAction, is_present
from ..core import (
    Bools,
    Drive,
    Floats,
    Ints,
    Rollout,
    Task,
    rotate,
    starts_of,
    to_centimetres,
)
from .observation import LocalFrame

_MIN_LOG_WEIGHT = -1000.0  # normalised; exp of it is 0 already

# Dtype and shape of every array of a Rollout, in the order of the digest. The letters
# are those of core/arrays.py; R rows of tracks, S rows of forecast objects, F1 is F +
# 1, C1 is C + 1.
ROLLOUT_ARRAYS: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "track_start": ("<i8", ("F1",)),
    "track_id": ("<i8", ("R",)),
    "track_box": ("<f4", ("R", 7)),
    "track_class": ("<i8", ("R",)),
    "member": ("|b1", ("R", "H")),
    "hypothesis_log_weight": ("<f4", ("F", "H")),
    "hypothesis_parent": ("<i8", ("F", "H")),
    "object_start": ("<i8", ("F1",)),
    "object_box": ("<f4", ("S", 7)),
    "object_class": ("<i8", ("S",)),
    "object_confidence": ("<f4", ("S",)),
    "forecast": ("<i2", ("S", "K", "T", 2)),
    "forecast_log_weight": ("<f4", ("S", "K")),
    "invalid": ("<i8", ("F", 3)),
    "malformed": ("<i8", ("F", "C1")),
    "dropped": ("<i8", ("F",)),
    "seconds": ("<f8", ("F",)),
}
# Arrays of a drive in its digest. Records name digests, so the list stays as it is:
# what else is stored of a drive, as the states after the last decision, follows from
# the actions and changes no digest.
_DIGESTED_DRIVE = """
    drive_acceleration drive_at_fault drive_cause drive_collision drive_comfortable drive_goal drive_hit
    drive_near_misses drive_phantom_brakes drive_plan drive_risk drive_seconds drive_way world_box
    world_class_id world_ego world_eligible world_following world_following_start world_lane world_lane_start
    world_neutral world_object_id world_start world_time world_velocity world_visible
"""


@dataclass(frozen=True, eq=False)
class RecordedAction:
    """Sound part of one action: R tracks and S forecast objects.

    All arrays have the names, the units and the types of those of a `Rollout`.
    """

    track_id: Ints  # [R]
    track_box: Floats  # [R, 7]
    track_class: Ints  # [R]
    member: Bools  # [R, H]
    hypothesis_log_weight: Floats  # [H] normalised, -inf: absent
    hypothesis_parent: Ints  # [H] hypothesis of the frame before, -1: not stated
    object_box: Floats  # [S, 7]
    object_class: Ints  # [S]
    object_confidence: Floats  # [S] 0 to 1
    # [S, K, T, 2] centimetres from the object's centre, 0 where absent
    forecast: Ints
    forecast_log_weight: Floats  # [S, K] normalised, -inf: absent
    invalid: Ints  # [3] rows taken out: tracks, hypotheses, objects
    malformed: Ints  # [C + 1] objects taken out by class, see `_malformed`


def record_action(
    checked: CheckedAction,
    task: Task,
    frame: LocalFrame | None = None,
    detections: Ints | None = None,
) -> RecordedAction:
    """Return the sound part of an action, in the scene's frame.

    It counts the rows that were taken out. ``frame`` is that of the observations;
    without one, coordinates stay as they are. ``detections`` [C]: number of detections
    of each class in the frame of the action. Never raises. All arrays are copies: an
    agent may go on writing into its own.
    """
    arrays = checked.arrays
    sound = checked.sound
    hypotheses = sound["hypotheses"]
    objects = sound["objects"]
    tracks = np.flatnonzero(sound["tracks"])
    member = (arrays["hypothesis_member"][:, tracks] != 0) & hypotheses[:, None]
    in_hypothesis = member.any(axis=0)
    tracks = tracks[in_hypothesis]
    track_box = arrays["track_box"][tracks]
    object_box = arrays["object_box"][objects]
    log_weight = arrays["forecast_log_weight"][objects]
    sampled = is_present(log_weight)
    offset = arrays["forecast"][objects][sampled]
    if frame is not None:
        track_box = frame.to_scene(track_box)
        object_box = frame.to_scene(object_box)
        offset = rotate(offset, -frame.yaw)
    forecast = np.zeros((*sampled.shape, task.future, 2), dtype=np.int16)
    forecast[sampled] = to_centimetres(offset)
    parent = np.where(hypotheses, arrays["hypothesis_parent"], -1)
    hypothesis_weight = log_softmax(arrays["hypothesis_log_weight"], hypotheses)
    invalid = [np.count_nonzero(checked.claimed[k] & ~sound[k]) for k in ROW_KINDS]
    return RecordedAction(
        track_id=arrays["track_id"][tracks].astype(np.int64),
        track_box=track_box.astype(np.float32),
        track_class=arrays["track_class"][tracks].astype(np.int64),
        member=member.T[in_hypothesis],
        hypothesis_log_weight=hypothesis_weight.astype(np.float32),
        hypothesis_parent=parent.astype(np.int64),
        object_box=object_box.astype(np.float32),
        object_class=arrays["object_class"][objects].astype(np.int64),
        object_confidence=arrays["object_confidence"][objects].astype(np.float32),
        forecast=forecast,
        forecast_log_weight=log_softmax(log_weight, sampled).astype(np.float32),
        invalid=np.array(invalid, dtype=np.int64),
        malformed=_malformed(checked, task, detections),
    )


def assemble(scene: str, actions: Sequence[RecordedAction], dropped: Ints) -> Rollout:
    """Make the rollout of the actions [F] of a scene.

    ``dropped`` [F]: detections that did not fit. The ``seconds`` are still zero.
    """
    arrays: dict[str, NDArray[Any]] = {
        "track_start": starts_of([len(action.track_id) for action in actions]),
        "object_start": starts_of([len(action.object_class) for action in actions]),
        "dropped": np.asarray(dropped),
        "seconds": np.zeros(len(actions)),
    }
    for name, (_, shape) in ROLLOUT_ARRAYS.items():
        if name not in arrays:
            # one entry per action, or rows of all actions
            join = np.stack if shape[0] == "F" else np.concatenate
            arrays[name] = join([getattr(action, name) for action in actions])
    typed: dict[str, Any] = {
        name: array.astype(ROLLOUT_ARRAYS[name][0], copy=False)
        for name, array in arrays.items()
    }
    return Rollout(scene, **typed)


def actions_of(rollout: Rollout) -> Iterator[RecordedAction]:
    """Yield the actions [F] that `assemble` made a rollout of."""
    names = [field.name for field in fields(RecordedAction)]
    for t in range(rollout.frames):
        rows: dict[Any, Any] = {
            "F": t,
            "R": rollout.tracks.rows(t),
            "S": rollout.objects.rows(t),
        }
        arrays = {}
        for name in names:
            _, shape = ROLLOUT_ARRAYS[name]
            arrays[name] = getattr(rollout, name)[rows[shape[0]]]
        yield RecordedAction(**arrays)


def empty_rollout(scene: str, frames: int = 1, **sizes: int) -> Rollout:
    """Make a rollout without tracks, hypotheses and forecasts.

    ``sizes``: sizes other than 0, by the letters of `ROLLOUT_ARRAYS`.
    """
    # fixed lengths stand for themselves
    size: dict[Any, int] = {"F": frames, "F1": frames + 1, 2: 2, 3: 3, 7: 7}
    size |= sizes
    arrays: dict[str, Any] = {
        name: np.zeros([size.get(n, 0) for n in shape], dtype)
        for name, (dtype, shape) in ROLLOUT_ARRAYS.items()
    }
    return Rollout(scene, **arrays)


def drive_arrays(drive: Drive | None) -> dict[str, NDArray[Any]]:
    """Return a drive as arrays, by names beside those of rollouts.

    Empty without a drive.
    """
    if drive is None:
        return {}
    values = {f"drive_{name}": value for name, value in vars(drive).items()}
    world = values.pop("drive_world")
    values |= {f"world_{name}": value for name, value in world.items()}
    return {name: np.asarray(value) for name, value in values.items()}


def drive_of(arrays: Mapping[str, NDArray[Any]]) -> Drive | None:
    """Return the drive that `drive_arrays` made arrays of, None without one.

    Raises KeyError for a missing array.
    """
    if not any(name.startswith("drive_") for name in arrays):
        return None
    world = {
        name.removeprefix("world_"): array
        for name, array in arrays.items()
        if name.startswith("world_")
    }
    values: dict[str, Any] = {}
    for field in fields(Drive):
        if field.name != "world":
            array = arrays[f"drive_{field.name}"]
            values[field.name] = array if array.ndim else array.item()
    return Drive(**values, world=world)


def digest(rollout: Rollout) -> str:
    """Return the hex sha256 over a rollout.

    It covers all arrays but ``seconds``, and of a drive those of `_DIGESTED_DRIVE`.
    """
    sha = hashlib.sha256(rollout.scene.encode())
    for name, (dtype, _) in ROLLOUT_ARRAYS.items():
        if name != "seconds":
            array = np.ascontiguousarray(getattr(rollout, name), dtype=dtype)
            if array.dtype.kind == "f":
                array = array + np.zeros((), dtype)  # -0.0 becomes 0.0
            sha.update(f"|{name}{list(array.shape)}".encode())
            sha.update(array.tobytes())
    for name, array in sorted(drive_arrays(rollout.drive).items()):
        if name in _DIGESTED_DRIVE.split():
            sha.update(f"|{name}{array.dtype.str}{list(array.shape)}".encode())
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def log_softmax(log_weight: Floats, mask: Bools) -> Floats:
    """Normalise log-weights [..., n] in ``mask`` over the last axis.

    They are -inf outside of the mask. Inside they stay finite, however small: faint is
    not absent.
    """
    masked = np.where(mask, log_weight.astype(np.float64), -np.inf)
    top = masked.max(axis=-1, keepdims=True, initial=-np.inf)
    top = np.where(np.isfinite(top), top, 0.0)
    total = np.exp(masked - top).sum(axis=-1, keepdims=True)
    normalised = masked - top - np.log(np.where(total > 0, total, 1.0))
    return np.where(mask, np.maximum(normalised, _MIN_LOG_WEIGHT), -np.inf)


def _malformed(checked: CheckedAction, task: Task, detections: Ints | None) -> Ints:
    """Count the false forecasts [C + 1] that invalid rows count as.

    The last entry is of objects whose class is unreadable. An object that is stated and
    taken out is one of its class. An action without readable objects is one per
    detection: so no invalid action is better than an empty one (`fixed_parts`).
    """
    if not checked.readable and detections is not None:
        return np.append(detections, 0).astype(np.int64)
    classes = len(task.classes)
    rejected = checked.claimed["objects"] & ~checked.sound["objects"]
    class_id = checked.arrays["object_class"][rejected]
    readable = (class_id >= 0) & (class_id < classes)
    class_id = np.where(readable, class_id, classes)
    return np.bincount(class_id, minlength=classes + 1).astype(np.int64)
