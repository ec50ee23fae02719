"""Actions as they are recorded: sound rows only, in the scene's frame; rollouts made of them, and their digest.

A row that is taken out counts as missing, so breaking the contract is never better than an empty action.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..agent import ROWS, Examined, present
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

FAINTEST = -1000.0  # a normalised log-weight; exp of it is 0 already

# of every array of a Rollout, in the order of the digest: dtype, and shape in the letters of core/arrays.py;
# R rows of tracks, S rows of forecast objects, F1 is F + 1, C1 is C + 1
ARRAYS: dict[str, tuple[str, tuple[str | int, ...]]] = {
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
# arrays of a drive in its digest. Records name digests, so the list stays as it is: what else is stored of a drive, as
# the states after the last decision, follows from the actions and changes no digest
_DIGESTED = """
    drive_acceleration drive_at_fault drive_cause drive_collision drive_comfortable drive_goal drive_hit
    drive_near_misses drive_phantom_brakes drive_plan drive_risk drive_seconds drive_way world_box
    world_class_id world_ego world_eligible world_following world_following_start world_lane world_lane_start
    world_neutral world_object_id world_start world_time world_velocity world_visible
"""


@dataclass(frozen=True, eq=False)
class RecordedAction:
    """The sound part of one action: R tracks and S forecast objects.

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
    forecast: Ints  # [S, K, T, 2] centimetres from the object's centre, 0 where absent
    forecast_log_weight: Floats  # [S, K] normalised, -inf: absent
    invalid: Ints  # [3] rows taken out: tracks, hypotheses, objects
    malformed: Ints  # [C + 1] objects taken out by class, see `_malformed`


def record_action(
    examined: Examined,
    task: Task,
    frame: LocalFrame | None = None,
    detected: Ints | None = None,
) -> RecordedAction:
    """The sound part of an action in the scene's frame of reference, with the number of rows that were taken out.

    ``frame`` is that of the observations; without one, coordinates stay as they are. ``detected`` [C]: detections of
    each class in the frame of the action. Never raises. All arrays are copies: an agent may go on writing into its own.
    """
    arrays, sound = examined.arrays, examined.sound
    tracks, objects = np.flatnonzero(sound["tracks"]), sound["objects"]
    member = (arrays["hypothesis_member"][:, tracks] != 0) & sound["hypotheses"][
        :, None
    ]
    held = member.any(axis=0)
    used, sample_weight = tracks[held], arrays["forecast_log_weight"][objects]
    box = np.concatenate([arrays["track_box"][used], arrays["object_box"][objects]])
    sampled, samples = present(sample_weight), arrays["forecast"][objects]
    offset, forecast = samples[sampled], np.zeros(samples.shape, dtype=np.int16)
    if frame is not None:
        box, offset = frame.to_scene(box), rotate(offset, -frame.yaw)
    forecast[sampled] = to_centimetres(offset)
    return RecordedAction(
        track_id=arrays["track_id"][used].astype(np.int64),
        track_box=box[: len(used)].astype(np.float32),
        track_class=arrays["track_class"][used].astype(np.int64),
        member=member.T[held],
        hypothesis_log_weight=log_softmax(
            arrays["hypothesis_log_weight"], sound["hypotheses"]
        ).astype(np.float32),
        hypothesis_parent=np.where(
            sound["hypotheses"], arrays["hypothesis_parent"], -1
        ).astype(np.int64),
        object_box=box[len(used) :].astype(np.float32),
        object_class=arrays["object_class"][objects].astype(np.int64),
        object_confidence=arrays["object_confidence"][objects].astype(np.float32),
        forecast=forecast,
        forecast_log_weight=log_softmax(sample_weight, sampled).astype(np.float32),
        invalid=np.array(
            [np.count_nonzero(examined.claimed[rows] & ~sound[rows]) for rows in ROWS],
            dtype=np.int64,
        ),
        malformed=_malformed(examined, task, detected),
    )


def assemble(scene: str, actions: Sequence[RecordedAction], dropped: Ints) -> Rollout:
    """Rollout of the actions [F] of a scene; ``dropped`` [F] detections did not fit. Times are still zero."""
    arrays: dict[str, NDArray[Any]] = {
        "track_start": starts_of([len(action.track_id) for action in actions]),
        "object_start": starts_of([len(action.object_class) for action in actions]),
        "dropped": np.asarray(dropped),
        "seconds": np.zeros(len(actions)),
    }
    for name, (_, shape) in ARRAYS.items():
        if name not in arrays:
            join = np.stack if shape[0] == "F" else np.concatenate
            arrays[name] = join([getattr(action, name) for action in actions])
    typed: dict[str, Any] = {
        name: array.astype(ARRAYS[name][0], copy=False)
        for name, array in arrays.items()
    }
    return Rollout(scene, **typed)


def actions_of(rollout: Rollout) -> Iterator[RecordedAction]:
    """The actions [F] that `assemble` made a rollout of."""
    names = {
        name: shape[0]
        for name, (_, shape) in ARRAYS.items()
        if name in RecordedAction.__dataclass_fields__
    }
    starts = {"R": rollout.track_start, "S": rollout.object_start}
    for t in range(rollout.frames):
        rows: dict[Any, Any] = {
            "F": t,
            **{
                letter: slice(start[t], start[t + 1])
                for letter, start in starts.items()
            },
        }
        yield RecordedAction(
            **{
                name: getattr(rollout, name)[rows[letter]]
                for name, letter in names.items()
            }
        )


def empty_rollout(scene: str, frames: int = 1, **sizes: int) -> Rollout:
    """Rollout without tracks, hypotheses and forecasts; ``sizes``: others than 0, by the letters of `ARRAYS`."""
    size: dict[str | int, int] = {"F": frames, "F1": frames + 1, 2: 2, 3: 3, 7: 7}
    shapes = {
        name: [sizes.get(str(n), size.get(n, 0)) for n in shape]
        for name, (_, shape) in ARRAYS.items()
    }
    arrays: dict[str, Any] = {
        name: np.zeros(shape, ARRAYS[name][0]) for name, shape in shapes.items()
    }
    return Rollout(scene, **arrays)


def drive_arrays(drive: Drive | None) -> dict[str, NDArray[Any]]:
    """A drive as arrays, by names that no array of a rollout has; none without a drive."""
    if drive is None:
        return {}
    own = {
        f"drive_{name}": np.asarray(value)
        for name, value in vars(drive).items()
        if name != "world"
    }
    return own | {
        f"world_{name}": np.asarray(value) for name, value in drive.world.items()
    }


def drive_of(arrays: Mapping[str, NDArray[Any]]) -> Drive | None:
    """The drive of `drive_arrays`; None without one. Raises KeyError for a missing array."""
    if not any(name.startswith("drive_") for name in arrays):
        return None
    world = {
        name.removeprefix("world_"): array
        for name, array in arrays.items()
        if name.startswith("world_")
    }
    names = [field.name for field in fields(Drive) if field.name != "world"]
    stored = {name: arrays[f"drive_{name}"] for name in names}
    values: dict[str, Any] = {
        name: value if value.ndim else value.item() for name, value in stored.items()
    }
    return Drive(**values, world=world)


def digest(rollout: Rollout) -> str:
    """Return the hex sha256 over the scene's name, all arrays but ``seconds``, and `_DIGESTED` ones of a drive."""
    sha = hashlib.sha256(rollout.scene.encode())
    for name, (dtype, _) in ARRAYS.items():
        if name != "seconds":
            array = np.ascontiguousarray(getattr(rollout, name), dtype=dtype)
            if array.dtype.kind == "f":
                array = array + np.zeros((), dtype)  # -0.0 becomes 0.0
            sha.update(f"|{name}{list(array.shape)}".encode())
            sha.update(array.tobytes())
    for name, array in sorted(drive_arrays(rollout.drive).items()):
        if name in _DIGESTED.split():
            sha.update(f"|{name}{array.dtype.str}{list(array.shape)}".encode())
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def log_softmax(log_weight: Floats, there: Bools) -> Floats:
    """Log-weights [..., n] normalised over the last axis; -inf outside of the mask ``there``.

    Weights inside stay finite and not below FAINTEST: faint is not absent.
    """
    masked = np.where(there, log_weight.astype(np.float64), -np.inf)
    top = masked.max(axis=-1, keepdims=True, initial=-np.inf)
    top = np.where(np.isfinite(top), top, 0.0)
    total = np.exp(masked - top).sum(axis=-1, keepdims=True)
    normalised = masked - top - np.log(np.where(total > 0, total, 1.0))
    return np.where(there, np.maximum(normalised, FAINTEST), -np.inf)


def _malformed(examined: Examined, task: Task, detected: Ints | None) -> Ints:
    """False forecasts [C + 1] that invalid rows count as; the last entry is of objects whose class is unreadable.

    An object that is stated and taken out is one of its class. An action without readable objects is one per detection:
    so no invalid action is better than an empty one (`fixed_error`).
    """
    classes = len(task.classes)
    if not examined.readable and detected is not None:
        return np.append(detected, 0).astype(np.int64)
    class_id = examined.arrays["object_class"][
        examined.claimed["objects"] & ~examined.sound["objects"]
    ]
    class_id = np.where((class_id >= 0) & (class_id < classes), class_id, classes)
    return np.bincount(class_id, minlength=classes + 1).astype(np.int64)
