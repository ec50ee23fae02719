"""Decoding of an action: what breaks the contract is taken out and counted, never an exception.

A row that is taken out counts as missing, so breaking the contract is never better than saying nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry import rotate
from ..types import Bools, Floats, Ints, Task, to_centimetres
from .action import ROWS
from .checks import Examined, present
from .observation import LocalFrame

FAINTEST = -1000.0  # a normalised log-weight; exp of it is 0 already


@dataclass(frozen=True, eq=False)
class Answer:
    """The sound part of one action as it is recorded and scored; R tracks and S forecast objects are left.

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


def answer_of(examined: Examined, task: Task, frame: LocalFrame | None = None, detected: Ints | None = None) -> Answer:
    """The sound part of an action in the scene's frame of reference, with the number of rows that were taken out.

    ``frame`` is that of the observations; without one, coordinates stay as they are. ``detected`` [C]: detections of
    each class in the frame that is answered. Never raises. All arrays are copies: an agent may go on writing into its
    own.
    """
    arrays, sound = examined.arrays, examined.sound
    member = (arrays["hypothesis_member"] != 0) & sound["hypotheses"][:, None] & sound["tracks"]
    used, there = member.any(axis=0), sound["objects"]
    track_box, object_box = arrays["track_box"][used], arrays["object_box"][there]
    sample_weight = arrays["forecast_log_weight"][there]
    sampled = present(sample_weight)
    offset = np.where(sampled[:, :, None, None], arrays["forecast"][there], np.float32(0))
    if frame is not None:
        track_box, object_box = frame.to_scene(track_box), frame.to_scene(object_box)
        offset = rotate(offset, -frame.yaw)
    return Answer(
        track_id=arrays["track_id"][used].astype(np.int64),
        track_box=track_box.astype(np.float32),
        track_class=arrays["track_class"][used].astype(np.int64),
        member=member.T[used],
        hypothesis_log_weight=log_softmax(arrays["hypothesis_log_weight"], sound["hypotheses"]).astype(np.float32),
        hypothesis_parent=np.where(sound["hypotheses"], arrays["hypothesis_parent"], -1).astype(np.int64),
        object_box=object_box.astype(np.float32),
        object_class=arrays["object_class"][there].astype(np.int64),
        object_confidence=arrays["object_confidence"][there].astype(np.float32),
        forecast=to_centimetres(offset),
        forecast_log_weight=log_softmax(sample_weight, sampled).astype(np.float32),
        invalid=np.array([(examined.claimed[rows] & ~sound[rows]).sum() for rows in ROWS], dtype=np.int64),
        malformed=_malformed(examined, task, detected),
    )


def _malformed(examined: Examined, task: Task, detected: Ints | None) -> Ints:
    """False forecasts [C + 1] that a broken answer counts as; the last entry is of objects whose class is unreadable.

    An object that is stated and taken out is one of its class. An answer without readable objects is one per detection:
    so no broken answer is better than silence (protocol, "fixed_error").
    """
    classes = len(task.classes)
    if not examined.readable and detected is not None:
        return np.append(detected, 0).astype(np.int64)
    broken = examined.claimed["objects"] & ~examined.sound["objects"]
    class_id = examined.arrays["object_class"][broken]
    class_id = np.where((class_id >= 0) & (class_id < classes), class_id, classes)
    return np.bincount(class_id, minlength=classes + 1).astype(np.int64)


def log_softmax(log_weight: Floats, there: Bools) -> Floats:
    """Log-weights [..., n] normalised over the last axis; -inf where nothing is ``there``.

    What is there stays finite and not below FAINTEST: faint is not absent.
    """
    masked = np.where(there, log_weight.astype(np.float64), -np.inf)
    top = masked.max(axis=-1, keepdims=True, initial=-np.inf)
    top = np.where(np.isfinite(top), top, 0.0)
    total = np.exp(masked - top).sum(axis=-1, keepdims=True)
    normalised = masked - top - np.log(np.where(total > 0, total, 1.0))
    return np.where(there, np.maximum(normalised, FAINTEST), -np.inf)
