"""Decoding of an action: what breaks the contract is taken out and counted, never an exception.

A row that is taken out counts as missing, so breaking the contract is never better than saying nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..types import Bools, Floats, Ints, Task
from .spaces import ABSENT_BELOW, COORDINATE_LIMIT, FORECAST_LIMIT, ID_LIMIT, SIZE_LIMIT

FAINTEST = -1000.0  # a normalised log-weight; exp of it is 0 already
_NUMBER, _INTEGER, _MASK = "fiu", "iu", "biu"  # kinds of dtype that a field may have


@dataclass(frozen=True, eq=False)
class Answer:
    """The sound part of one action; R tracks and S forecast objects are left."""

    track_id: Ints  # [R]
    track_box: Floats  # [R, 7]
    track_class: Ints  # [R]
    member: Bools  # [R, H]
    hypothesis_log_weight: Floats  # [H] normalised, -inf: absent
    object_box: Floats  # [S, 7]
    object_class: Ints  # [S]
    forecast: Floats  # [S, K, T, 2] m from the object's centre, 0 where absent
    forecast_log_weight: Floats  # [S, K] normalised, -inf: absent
    invalid: Ints  # [3] rows taken out: tracks, hypotheses, objects


def decode(action: object, task: Task) -> Answer:
    """The sound part of ``action``, with the number of tracks, hypotheses and objects that were not.

    Never raises. All arrays are copies: an agent may go on writing into its own.
    """
    fields: Mapping[Any, Any] = action if isinstance(action, Mapping) else {}
    track_box, track_id, track_class, track_ok, track_claims = _tracks(fields, task)
    member, hypothesis_weight, hypothesis_bad = _hypotheses(fields, task)
    member &= track_ok[:, None]
    repeated = _repeated(track_id, member)
    member[repeated] = False
    track_bad = track_claims - int(track_ok.sum()) + int(repeated.sum())
    used = member.any(axis=1)
    objects = _objects(fields, task)
    return Answer(
        track_id=track_id[used],
        track_box=track_box[used],
        track_class=track_class[used],
        member=member[used],
        hypothesis_log_weight=hypothesis_weight,
        object_box=objects.box,
        object_class=objects.class_id,
        forecast=objects.forecast,
        forecast_log_weight=objects.log_weight,
        invalid=np.array([track_bad, hypothesis_bad, objects.invalid], dtype=np.int64),
    )


def log_softmax(log_weight: Floats, present: Bools) -> Floats:
    """Log-weights [..., n] normalised over the last axis; -inf where not ``present``, all -inf where none is.

    A present one stays finite and not below FAINTEST: faint is not absent.
    """
    masked = np.where(present, log_weight.astype(np.float64), -np.inf)
    top = masked.max(axis=-1, keepdims=True, initial=-np.inf)
    top = np.where(np.isfinite(top), top, 0.0)
    total = np.exp(masked - top).sum(axis=-1, keepdims=True)
    normalised = masked - top - np.log(np.where(total > 0, total, 1.0))
    return np.where(present, np.maximum(normalised, FAINTEST), -np.inf)


def _tracks(fields: Mapping[Any, Any], task: Task) -> tuple[Floats, Ints, Ints, Bools, int]:
    """Boxes [N, 7], ids [N], classes [N], which rows are sound [N], and how many rows were claimed."""
    n = task.tracks
    valid = _read(fields, "track_valid", (n,), _MASK)
    box = _read(fields, "track_box", (n, 7), _NUMBER)
    track_id = _read(fields, "track_id", (n,), _INTEGER)
    stated = "track_class" in fields
    class_id = _read(fields, "track_class", (n,), _INTEGER) if stated else np.full(n, -1)
    claimed = np.ones(n, dtype=bool) if valid is None else valid != 0
    if valid is None or box is None or track_id is None or class_id is None:
        nothing = np.zeros(n, dtype=np.int64)
        return np.zeros((n, 7)), nothing, nothing, np.zeros(n, dtype=bool), int(claimed.sum())
    box = _to_float32(box)
    ok = claimed & _sound_boxes(box) & (track_id >= 0) & (track_id <= ID_LIMIT)
    ok &= (class_id >= -1) & (class_id < len(task.classes))
    return box, _to_int64(track_id), _to_int64(class_id), ok, int(claimed.sum())


def _hypotheses(fields: Mapping[Any, Any], task: Task) -> tuple[Bools, Floats, int]:
    """Membership [N, H] of present hypotheses, their normalised log-weights [H], how many were unusable."""
    h, n = task.hypotheses, task.tracks
    weight = _read(fields, "hypothesis_log_weight", (h,), _NUMBER)
    member = _read(fields, "hypothesis_member", (h, n), _MASK)
    none = np.zeros((n, h), dtype=bool), np.full(h, -np.inf)
    if weight is None:
        return *none, h
    weight = _to_float32(weight)
    present, broken = _presence(weight)
    if member is None:
        return *none, int((present | broken).sum())
    return (member != 0).T & present, log_softmax(weight, present), int(broken.sum())


@dataclass(frozen=True, eq=False)
class _Objects:
    box: Floats
    class_id: Ints
    forecast: Floats
    log_weight: Floats
    invalid: int


def _objects(fields: Mapping[Any, Any], task: Task) -> _Objects:
    o, k, future = task.objects, task.samples, task.future
    valid = _read(fields, "object_valid", (o,), _MASK)
    box = _read(fields, "object_box", (o, 7), _NUMBER)
    class_id = _read(fields, "object_class", (o,), _INTEGER)
    forecast = _read(fields, "forecast", (o, k, future, 2), _NUMBER)
    weight = _read(fields, "forecast_log_weight", (o, k), _NUMBER)
    claimed = np.ones(o, dtype=bool) if valid is None else valid != 0
    if valid is None or box is None or class_id is None or forecast is None or weight is None:
        return _no_objects(task, int(claimed.sum()))
    rows = np.flatnonzero(claimed)
    box, forecast, weight = (_to_float32(array[rows]) for array in (box, forecast, weight))
    class_id = class_id[rows]
    present, broken = _presence(weight)
    reach = np.hypot(forecast[..., 0].astype(np.float64), forecast[..., 1]).max(axis=-1)  # [S, K]; NaN stays NaN
    ok = _sound_boxes(box) & (class_id >= 0) & (class_id < len(task.classes))
    ok &= present.any(axis=1) & ~broken.any(axis=1) & (~present | (reach <= FORECAST_LIMIT)).all(axis=1)
    present = present[ok]
    return _Objects(
        box=box[ok],
        class_id=_to_int64(class_id[ok]),
        forecast=np.where(present[:, :, None, None], forecast[ok], np.float32(0)),
        log_weight=log_softmax(weight[ok], present),
        invalid=int((~ok).sum()),
    )


def _no_objects(task: Task, invalid: int) -> _Objects:
    return _Objects(
        box=np.zeros((0, 7)),
        class_id=np.zeros(0, dtype=np.int64),
        forecast=np.zeros((0, task.samples, task.future, 2)),
        log_weight=np.zeros((0, task.samples)),
        invalid=invalid,
    )


def _repeated(track_id: Ints, member: Bools) -> Bools:
    """Which tracks [N] share their id with another track of one hypothesis; ``member`` is [N, H]."""
    repeated = np.zeros(len(track_id), dtype=bool)
    rows = np.flatnonzero(member.any(axis=1))
    ids, group = np.unique(track_id[rows], return_inverse=True)
    if len(ids) < len(rows):
        count = np.zeros((len(ids), member.shape[1]), dtype=np.int64)
        np.add.at(count, group, member[rows])
        repeated[rows] = (member[rows] & (count[group] > 1)).any(axis=1)
    return repeated


def _presence(log_weight: Floats) -> tuple[Bools, Bools]:
    """Which log-weights are present and which are broken (NaN or +inf); the others say absent."""
    broken = np.isnan(log_weight) | np.isposinf(log_weight)
    return ~broken & (log_weight >= ABSENT_BELOW), broken


def _sound_boxes(box: Floats) -> Bools:
    """Which boxes [R, 7] are finite and in range; comparisons with NaN are False."""
    near = (np.abs(box[:, :4]) <= COORDINATE_LIMIT).all(axis=1)
    return np.asarray(near & ((box[:, 4:] > 0) & (box[:, 4:] <= SIZE_LIMIT)).all(axis=1))


def _read(fields: Mapping[Any, Any], key: str, shape: tuple[int, ...], kinds: str) -> NDArray[Any] | None:
    """The field as an array, None unless it is there with this shape and a dtype of these kinds."""
    try:
        array = np.asarray(fields[key])
    except Exception:  # whatever an agent hands over: ragged lists, tensors of another device, ...
        return None
    return array if array.shape == shape and array.dtype.kind in kinds else None


def _to_float32(array: NDArray[Any]) -> Floats:
    with np.errstate(over="ignore", invalid="ignore"):  # too large becomes inf, which is refused afterwards
        return array.astype(np.float32)


def _to_int64(array: NDArray[Any]) -> Ints:
    return array.astype(np.int64)
