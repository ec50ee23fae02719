"""Dishonest answers: what an honest agent answered on a scene, changed afterwards.

An attack that needs more than the answers of one agent joins them with those of another (`joined`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.cards import Card
from mtp_bench.core import Rollout, Scene, starts_of_sorted
from mtp_bench.scoring import live_frames
from mtp_bench.scoring.definitions import SAMPLE_FLOOR

Rows = NDArray[np.intp]
Change = Callable[[Scene, Rollout, Card], Rollout]


def choose(rollout: Rollout, row: Rows, frame: Rows, **changed: Any) -> Rollout:
    """The rollout with the objects ``row`` [n] in frames ``frame`` [n]; ``changed`` arrays are of these rows."""
    order = np.argsort(frame, kind="stable")
    names = (
        "object_box",
        "object_class",
        "object_confidence",
        "forecast",
        "forecast_log_weight",
    )
    arrays = {
        name: (changed[name] if name in changed else getattr(rollout, name)[row])[order]
        for name in names
    }
    return replace(
        rollout, object_start=starts_of_sorted(frame[order], rollout.frames), **arrays
    )


def frames_of(rollout: Rollout) -> Rows:
    return np.asarray(rollout.objects.frame_of_rows, dtype=np.intp)


def silence(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    return choose(rollout, np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))


def silence_where_nobody_looks(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    row = np.flatnonzero(live_frames(scene, card)[frames_of(rollout)])
    return choose(rollout, row, frames_of(rollout)[row])


def repeated(frames: int, confidence: Callable[[NDArray[Any]], NDArray[Any]]) -> Change:
    """State every forecast again in the next ``frames`` frames.

    ``confidence``: of the repeats from that of the forecast.
    """

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        frame = frames_of(rollout)
        row = np.arange(len(frame))
        late = [row[frame + i < rollout.frames] for i in range(1, frames + 1)]
        rows = np.concatenate([row, *late])
        at = np.concatenate(
            [frame, *(frame[r] + i for i, r in enumerate(late, start=1))]
        )
        sure = rollout.object_confidence[rows].copy()
        sure[len(row) :] = confidence(sure[len(row) :])
        return choose(rollout, rows, at, object_confidence=sure)

    return change


def every_class(confidence: float) -> Change:
    """Every object is also said to be of each other class, with a share of its confidence."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        count, classes = len(rollout.object_class), len(card.task.classes)
        rows = np.tile(np.arange(count), classes)
        class_id = (
            rollout.object_class[rows] + np.repeat(np.arange(classes), count)
        ) % classes
        sure = rollout.object_confidence[rows].copy()
        sure[count:] *= confidence
        return choose(
            rollout,
            rows,
            frames_of(rollout)[rows],
            object_class=class_id,
            object_confidence=sure,
        )

    return change


def widened(factor: float) -> Change:
    """Samples spread further about their mean."""
    return lambda scene, rollout, card: replace(
        rollout, forecast=spread(rollout.forecast, factor)
    )


def spread(forecast: NDArray[Any], factor: float) -> NDArray[np.int16]:
    path = forecast.astype(np.float64)
    mean = path.mean(axis=1, keepdims=True)
    return centimetres(mean + factor * (path - mean))


def centimetres(path: NDArray[np.float64]) -> NDArray[np.int16]:
    return np.rint(np.clip(path, -32000, 32000)).astype(np.int16)


def two_widths(faint: float) -> Change:
    """Every second sample is three times as far out, at a share of the uniform weight."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        k = rollout.forecast.shape[1]
        path, weight = rollout.forecast.copy(), np.full(k, 1.0 / k)
        path[:, 1::2] = spread(rollout.forecast, 3.0)[:, 1::2]
        weight[1::2] *= faint
        weight[::2] += (1.0 - weight.sum()) / len(weight[::2])
        logs = np.broadcast_to(np.log(weight), rollout.forecast_log_weight.shape)
        return replace(
            rollout, forecast=path, forecast_log_weight=logs.astype(np.float32)
        )

    return change


def far_pair(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    """Two samples of weight 1/2 at 200 m on both sides; the others weigh next to nothing."""
    path, weight = (
        rollout.forecast.copy(),
        np.full_like(rollout.forecast_log_weight, -20.0),
    )
    path[:, 0], path[:, 1] = 20_000, -20_000
    weight[:, :2] = np.log(0.5)
    return replace(rollout, forecast=path, forecast_log_weight=weight)


def doubled(
    offsets: NDArray[np.float64], confidence: Callable[[NDArray[Any]], NDArray[Any]]
) -> Change:
    """Copies of every object, moved by ``offsets`` [n, 2] m; ``confidence`` of copies from that of the object."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        count = len(rollout.object_box)
        rows = np.tile(np.arange(count), 1 + len(offsets))
        box, sure = (
            rollout.object_box[rows].copy(),
            rollout.object_confidence[rows].copy(),
        )
        box[count:, :2] += np.repeat(offsets, count, axis=0)
        sure[count:] = confidence(sure[count:])
        return choose(
            rollout,
            rows,
            frames_of(rollout)[rows],
            object_box=box,
            object_confidence=sure,
        )

    return change


def ring(copies: int, confidence: float) -> Change:
    """Copies of every object on a ring just inside the gate, with a share of its confidence."""

    def change(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        count = len(rollout.object_box)
        rows = np.tile(np.arange(count), 1 + copies)
        angle = 2.0 * np.pi * np.repeat(np.arange(copies), count) / copies
        radius = (
            0.95
            * np.asarray(card.per_class(card.task.forecast_gate))[
                rollout.object_class[rows[count:]]
            ]
        )
        box, sure = (
            rollout.object_box[rows].copy(),
            rollout.object_confidence[rows].copy(),
        )
        box[count:, :2] += radius[:, None] * np.column_stack(
            [np.cos(angle), np.sin(angle)]
        )
        sure[count:] *= confidence
        return choose(
            rollout,
            rows,
            frames_of(rollout)[rows],
            object_box=box,
            object_confidence=sure,
        )

    return change


def joined(
    rollout: Rollout, other: Rollout, confidence: Callable[[NDArray[Any]], NDArray[Any]]
) -> Rollout:
    """The objects of ``rollout``, and those of ``other`` beside, whose samples stay where they are.

    ``confidence``: of the objects of ``other`` from their own.
    """
    count, rng = len(other.object_box), np.random.default_rng(RNG_SEED)
    moved = rng.normal(0.0, BESIDE, (count, 2))
    box = other.object_box.copy()
    box[:, :2] += moved
    path = centimetres(other.forecast.astype(np.float64) - 100.0 * moved[:, None, None])
    beside = replace(
        other,
        object_box=box,
        forecast=path,
        object_confidence=confidence(other.object_confidence).astype(np.float32),
    )
    names = (
        "object_box",
        "object_class",
        "object_confidence",
        "forecast",
        "forecast_log_weight",
    )
    both = {
        name: np.concatenate([getattr(rollout, name), getattr(beside, name)])
        for name in names
    }
    frame = np.concatenate([frames_of(rollout), frames_of(other)])
    return choose(rollout, np.arange(len(frame)), frame, **both)


def in_crowds(scene: Scene, rollout: Rollout) -> Rollout:
    """The objects that have another one within 5 m."""
    row = np.flatnonzero(crowded(scene, rollout))
    return choose(rollout, row, frames_of(rollout)[row])


def by_value(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
    """Confidence by the gain that a forecast is expected to bring per false one: p (c - e) / (1 - p).

    e: half the spread of the samples, m. The odds become a number from 0 to 1.
    """
    path = rollout.forecast.astype(np.float64) / 100.0
    away = np.linalg.norm(path - path.mean(axis=1, keepdims=True), axis=-1).mean(
        axis=(1, 2)
    )
    most = np.asarray(card.per_class(card.task.miss_error))[rollout.object_class]
    gain = sure(rollout) * (most - np.minimum(0.5 * away, 0.9 * most))
    order = gain / (gain + 1.0 - np.minimum(sure(rollout), 1.0 - 1e-6))
    return replace(rollout, object_confidence=order.astype(np.float32))


def confidences(change: Callable[[Scene, Rollout], NDArray[Any]]) -> Change:
    def changed(scene: Scene, rollout: Rollout, card: Card) -> Rollout:
        return replace(
            rollout,
            object_confidence=np.clip(change(scene, rollout), 0, 1).astype(np.float32),
        )

    return changed


def crowded(scene: Scene, rollout: Rollout) -> NDArray[np.float64]:
    """Neighbours within 5 m of each object, as a share of 4."""
    from scipy.spatial import KDTree

    if not len(rollout.object_box):
        return np.zeros(0)
    place = np.column_stack([rollout.object_box[:, :2], 1e4 * frames_of(rollout)])
    near = KDTree(place).query_ball_point(place, 5.0, return_length=True) - 1
    return np.asarray(np.minimum(near / 4.0, 1.0))


def moving(scene: Scene, rollout: Rollout) -> NDArray[np.float64]:
    """The length of each forecast, as a share of 10 m."""
    end = rollout.forecast[:, :, -1].astype(np.float64).mean(axis=1) / 100.0
    return np.asarray(np.minimum(np.hypot(end[:, 0], end[:, 1]) / 10.0, 1.0))


def sure(rollout: Rollout) -> NDArray[np.float64]:
    return rollout.object_confidence.astype(np.float64)


BESIDE = (
    0.05  # m, sigma of the place of a twin: now it is the nearer one, now the other
)
CROSS = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
RNG_SEED = 7
FLOODS: dict[str, Change] = {
    "repeats 3 frames, as sure": repeated(3, lambda c: c),
    "repeats 3 frames, half as sure": repeated(3, lambda c: 0.5 * c),
    "repeats 3 frames, 10 % as sure": repeated(3, lambda c: 0.1 * c),
}
CHANGES: dict[str, Change] = {
    "silence": silence,
    "silence where nobody looks": silence_where_nobody_looks,
    "repeats 1 frame, confidence 1": repeated(1, np.ones_like),
    "repeats 1 frame, confidence 0": repeated(1, np.zeros_like),
    "repeats 3 frames, confidence 1": repeated(3, np.ones_like),
    "repeats 3 frames, confidence 0": repeated(3, np.zeros_like),
    "every class": every_class(1.0),
    "every class, others half as sure": every_class(0.5),
    "samples x1.5": widened(1.5),
    "samples x3": widened(3.0),
    "honest: two widths": two_widths(1.0),
    "two widths, one faint": two_widths(1.05 * SAMPLE_FLOOR),
    "far pair": far_pair,
    "duplicates": doubled(np.zeros((1, 2)), lambda c: c),
    "duplicates, half as sure": doubled(np.zeros((1, 2)), lambda c: 0.5 * c),
    "copies 1 m around": doubled(CROSS, lambda c: 0.5 * c),
    "ring of 8 copies, 1 % as sure": ring(8, 0.01),
    "ring of 8 copies, 20 % as sure": ring(8, 0.2),
    "value order": by_value,
    "random confidence": confidences(
        lambda s, r: np.random.default_rng(RNG_SEED).random(len(r.object_box))
    ),
    "inverted confidence": confidences(lambda s, r: 1.0 - sure(r)),
    "confidence 1": confidences(lambda s, r: np.ones(len(r.object_box))),
    "surer in a crowd": confidences(lambda s, r: 0.5 * sure(r) + 0.5 * crowded(s, r)),
    "surer of what moves": confidences(lambda s, r: 0.5 * sure(r) + 0.5 * moving(s, r)),
    **FLOODS,
}
