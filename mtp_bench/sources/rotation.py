"""Rotations in three dimensions as quaternions w x y z."""

from collections.abc import Callable

import numpy as np

from ..core import Floats
from .tables import refuse

# largest deviation of a quaternion's norm from 1 that counts as rounding and is
# normalised
_NORM_TOLERANCE = 1e-2


def require_rotations(rotation: Floats, where: Callable[[int], str]) -> None:
    """Raise DataError for the first quaternion [R, 4] that has not norm 1.

    ``where``: name of a row.
    """
    expected = "expected a unit quaternion"
    refuse(
        np.abs(np.linalg.norm(rotation, axis=1) - 1.0) > _NORM_TOLERANCE,
        lambda row: f"{where(row)}: rotation is {rotation[row].tolist()}, {expected}",
    )


def yaw_of(rotation: Floats) -> Floats:
    """Return headings [R] rad of the x axes that quaternions [R, 4] turn."""
    w, x, y, z = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    # y and x of the turned axis
    return np.asarray(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))


def multiply(first: Floats, second: Floats) -> Floats:
    """Return quaternions [R, 4] of the rotation ``second`` and then ``first``."""
    w1 = first[:, :1]
    w2 = second[:, :1]
    axis1 = first[:, 1:]
    axis2 = second[:, 1:]
    scalar = w1 * w2 - (axis1 * axis2).sum(axis=1, keepdims=True)
    return np.hstack([scalar, w1 * axis2 + w2 * axis1 + np.cross(axis1, axis2)])


def rotate_vectors(rotation: Floats, vectors: Floats) -> Floats:
    """Rotate vectors [R, 3] by unit quaternions [R, 4]."""
    axis = rotation[:, 1:]
    # v + 2 w (a x v) + 2 a x (a x v) for the quaternion w, a
    axis_cross = np.cross(axis, vectors)
    return vectors + 2 * (rotation[:, :1] * axis_cross + np.cross(axis, axis_cross))
