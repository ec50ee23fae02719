"""Errors of detections, and how long they last: what a level of robustness perturbs."""

from collections.abc import Iterable
from typing import Annotated

import numpy as np

from ..cards import Card
from ..core import Column, Floats, Ints, Scene, Section
from ..scoring import Metres, Share
from ..sources import covered_truth, detection_matches

_Correlation = Annotated[float | None, Column(format=".2f")]


class DetectorRow(Section):
    """The detections at a level, before any agent."""

    level: Annotated[float, Column(format="g", help="Of the knob.")]
    missed: Annotated[Share, Column(better="lower", help="Of the boxes in coverage.")]
    false: Annotated[float, Column(help="False detections per frame.")]
    error: Annotated[Metres, Column(help="Mean error of places.")]
    error_memory: Annotated[
        _Correlation, Column(help="Correlation of errors from frame to frame.")
    ]
    miss_memory: Annotated[
        _Correlation, Column(help="Correlation of misses from frame to frame.")
    ]


def detector_row(scenes: Iterable[Scene], card: Card, level: float) -> DetectorRow:
    """Return the errors of the detections of scenes, and how long they last."""
    false = 0
    frames = 0
    parts = []
    for scene in scenes:
        true_row = detection_matches(scene, card)
        parts.append(_errors(scene, card, true_row))
        false += int((true_row < 0).sum())
        frames += scene.frames
    error, missed, following = map(np.concatenate, zip(*parts, strict=True))
    before = np.flatnonzero(following[:-1])
    found = ~np.isnan(error[:, 0])
    pairs = before[found[before] & found[before + 1]]
    return DetectorRow(
        level=level,
        missed=float(missed.mean()) if len(missed) else None,
        false=false / max(frames, 1),
        error=float(np.hypot(*error[found].T).mean()) if found.any() else None,
        error_memory=_correlation(error[pairs].ravel(), error[pairs + 1].ravel()),
        miss_memory=_correlation(missed[before], missed[before + 1]),
    )


def _errors(scene: Scene, card: Card, true_row: Ints) -> tuple[Floats, Floats, Floats]:
    """Return the errors x y [n, 2] m of true boxes in coverage, NaN where missed.

    They are sorted by object and frame. Also 1 where a box is missed [n], and where the
    next box is of the same object in the next frame [n].
    """
    truth = scene.truth
    error = np.full((len(truth.box), 2), np.nan)
    is_found = true_row >= 0
    places = scene.detections.box[is_found, :2]
    error[true_row[is_found]] = places - truth.box[true_row[is_found], :2]
    rows = np.flatnonzero(covered_truth(scene, card, true_row))
    frame = truth.frame_of_rows[rows]
    order = np.lexsort([frame, truth.object_id[rows]])
    rows = rows[order]
    is_same = np.diff(truth.object_id[rows], append=-1) == 0
    is_next = np.diff(frame[order], append=-1) == 1
    missed = np.isnan(error[rows, 0]).astype(float)
    return error[rows], missed, (is_same & is_next).astype(float)


def _correlation(first: Floats, second: Floats) -> float | None:
    if len(first) < 2 or np.ptp(first) == 0 or np.ptp(second) == 0:
        return None
    return float(np.corrcoef(first, second)[0, 1])
