"""Mending the pasts of tracks: gaps bridged, positions smoothed (Yu, Zhou 2021)."""

from __future__ import annotations

import numpy as np

from ..types import Bools, Floats

SMOOTHING = 0.5  # weight of the newest displacement in the level, and of the newest change in the trend


def bridged(past: Floats, valid: Bools) -> tuple[Floats, Bools]:
    """Pasts [N, P, 7] whose gaps between two detections lie on the straight line, and where they are known [N, P].

    ``past`` [N, P, 7], oldest first; ``valid`` [N, P]: where a detection was taken. Only x and y are changed; what
    comes before the first detection or after the last one stays unknown.
    """
    length = valid.shape[1]
    frame = np.arange(length)
    before = np.maximum.accumulate(np.where(valid, frame, -1), axis=1)
    after = np.minimum.accumulate(np.where(valid, frame, length)[:, ::-1], axis=1)[:, ::-1]
    known = (before >= 0) & (after < length)
    row, gap = np.nonzero(known & ~valid)
    low, high = before[row, gap], after[row, gap]
    share = ((gap - low) / (high - low))[:, None]
    whole = past.copy()
    whole[row, gap, :2] = (1 - share) * past[row, low, :2] + share * past[row, high, :2]
    return whole, known


def smoothed(past: Floats, known: Bools) -> Floats:
    """Pasts [N, P, 7] of smoothed displacements, rebuilt backwards from the last known place, which does not move.

    ``past`` [N, P, 7], oldest first; ``known`` [N, P]: one run of frames per track. The displacements are smoothed by
    Holt's double exponential smoothing (Holt 1957), which begins with the first displacement and no trend. Only x and y
    are changed.
    """
    move = np.diff(past[:, :, :2], axis=1)
    moved = known[:, 1:] & known[:, :-1]
    level, trend = np.zeros((len(past), 2)), np.zeros((len(past), 2))
    begun = np.zeros(len(past), dtype=bool)
    result = np.zeros_like(move)
    for step in range(move.shape[1]):
        now = moved[:, step]
        forecast = np.where(begun[:, None], level + trend, move[:, step])
        new = SMOOTHING * move[:, step] + (1 - SMOOTHING) * forecast
        trend = np.where((now & begun)[:, None], SMOOTHING * (new - level) + (1 - SMOOTHING) * trend, trend)
        level = np.where(now[:, None], new, level)
        begun |= now
        result[:, step] = np.where(now[:, None], new, 0.0)
    back = np.cumsum(result[:, ::-1], axis=1)[:, ::-1]  # from each frame to the last known one
    last = known.shape[1] - 1 - known[:, ::-1].argmax(axis=1)
    whole = past.copy()
    whole[:, :-1, :2] = past[np.arange(len(past)), last][:, None, :2] - back
    return np.where(known[:, :, None], whole, past)
