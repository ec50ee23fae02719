"""Gains of matching tracks with detections: affinity above the gate, -inf beyond it or across classes."""

from __future__ import annotations

import numpy as np

from mtp_bench.geometry import iou_3d
from mtp_bench.tracking.parameters import ClassParameters
from mtp_bench.types import Floats, Ints
from tests.support.plain_geometry import giou_3d, pairwise


def gains(
    tracks: Floats,
    track_class: Ints,
    detections: Floats,
    detection_class: Ints,
    parameters: tuple[ClassParameters, ...],
) -> Floats:
    """Gain [N, D] of each track box [N, 7] with each detected box [D, 7]; at least 0 where a match is allowed."""
    result = np.full((len(tracks), len(detections)), -np.inf)
    for class_id, rule in enumerate(parameters):
        row, column = np.flatnonzero(track_class == class_id), np.flatnonzero(detection_class == class_id)
        if len(row) and len(column):
            gain = _above_gate(tracks[row], detections[column], rule)
            result[np.ix_(row, column)] = np.where(gain >= 0, gain, -np.inf)
    return result


def _above_gate(tracks: Floats, detections: Floats, rule: ClassParameters) -> Floats:
    """How far each pair [n, m] is inside the gate; negative outside."""
    if rule.affinity == "center_distance":
        distance = np.linalg.norm(tracks[:, None, :3] - detections[None, :, :3], axis=-1)
        return np.asarray(rule.gate - distance)
    if rule.affinity == "iou_3d":
        return pairwise(iou_3d, tracks, detections) - rule.gate
    return pairwise(giou_3d, tracks, detections) - rule.gate
