"""A Kalman filter over the short past of many tracks at once, in the heading frame of each track, and its stored noise.

Along and across the heading the motion is taken as independent: a nearly constant velocity disturbed by white
acceleration (Bar-Shalom, Li, Kirubarajan 2001, ch. 6). Its noise is fitted on training splits: TOML files in
``motion_noise/``, one per domain where objects move alike.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..core import (
    Bools,
    Floats,
    Ints,
    ShapeError,
    Task,
    UnknownNameError,
    of_kind,
    require_finite,
    require_shape,
    similar_class,
)
from ..tracking import family_of, kernel

FOLDER = Path(__file__).with_name("motion_noise")
Noise = Mapping[str, Any]  # field of `NoiseTable` -> value(s) of one class


@dataclass(frozen=True, eq=False)
class NoiseTable:
    """Noise of the motion model per class; the last axis is along and across the heading."""

    measurement: Floats  # [C] m, standard deviation of a detected position
    jerkiness: Floats  # [C, 2] m/s^1.5, white acceleration while the past is filtered
    speed: Floats  # [C, 2] m/s, prior standard deviation of a velocity never seen
    acceleration: (
        Floats  # [C, 2] m/s^2, standard deviation of the acceleration over the future
    )


def require_noise(noise: NoiseTable) -> None:
    """Raise ShapeError unless the covariances of all states can be positive definite."""
    classes = len(noise.measurement)
    for name, shape in (
        ("measurement", ()),
        ("jerkiness", (2,)),
        ("speed", (2,)),
        ("acceleration", (2,)),
    ):
        values = getattr(noise, name)
        require_shape(f"noise.{name}", values, (classes, *shape))
        require_finite(f"noise.{name}", values)
        positive = name in ("measurement", "speed")  # others may be 0
        if not (values > 0 if positive else values >= 0).all():
            expected = "above 0" if positive else "of at least 0"
            raise ShapeError(
                f"noise.{name} contains {values.min()}, expected numbers {expected}"
            )


@dataclass(frozen=True, eq=False)
class Posterior:
    """Position and velocity of N tracks now; axis 1 is along and across the heading."""

    position: Floats  # [N, 2] m from the track's last box centre
    velocity: Floats  # [N, 2] m/s
    covariance: Floats  # [N, 2, 2, 2] of (position, velocity) for each of the two axes


def heading_frame(past: Floats, heading: Floats) -> Floats:
    """Positions [N, P, 2] of past boxes relative to the last one, turned so that axis 0 points along the heading."""
    x, y = (past[..., axis] - past[:, -1:, axis] for axis in range(2))
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return np.stack([x * c + y * s, y * c - x * s], axis=-1)


def rotation(heading: Floats) -> Floats:
    """Matrices [N, 2, 2] whose columns are the axes along and across the heading [N]."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def filtered(
    position: Floats, valid: Bools, class_id: Ints, noise: NoiseTable, dt: float
) -> Posterior:
    """Position, velocity and covariance of tracks now, from their pasts.

    ``position`` [N, P, 2] m, heading frame, oldest first; ``valid`` [N, P]: where a detection was taken; ``class_id``
    [N] chooses the row of ``noise``; ``dt``: frame period, s.
    """
    n = len(position)
    state = np.empty((n, 2, _STATE))
    # Copies: compiled code takes arrays that may be written, in one order.
    place, seen = (
        np.array(position, dtype=np.float64, order="C"),
        np.array(valid, dtype=bool, order="C"),
    )
    filter_pasts(
        place,
        seen,
        noise.measurement[class_id],
        noise.jerkiness[class_id],
        noise.speed[class_id],
        dt,
        state,
    )
    covariance = np.stack([state[..., 2:4], state[..., 3:5]], axis=-2)
    return Posterior(state[..., 0].copy(), state[..., 1].copy(), covariance)


_STATE = 5  # of an axis: position, velocity, and variance of position, covariance, variance of velocity


@kernel(
    "void(f8[:, :, ::1], b1[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, f8[:, :, ::1])"
)
def filter_pasts(
    position: Floats,
    valid: Bools,
    measurement: Floats,
    jerkiness: Floats,
    speed: Floats,
    dt: float,
    state: Floats,
) -> None:
    """The states [N, 2, 5] after positions [N, P, 2], with the noise of each track: [N], [N, 2], [N, 2]."""
    for i in range(len(state)):
        for axis in range(2):
            r2, q, prior = (
                measurement[i] ** 2,
                jerkiness[i, axis] ** 2,
                speed[i, axis] ** 2,
            )
            p, v, pp, pv, vv, started = 0.0, 0.0, 0.0, 0.0, prior, False
            for step in range(position.shape[1]):
                p += v * dt
                pp += 2 * dt * pv + dt * dt * vv + q * dt**3 / 3
                pv += dt * vv + q * dt * dt / 2
                vv += q * dt
                if not valid[i, step]:
                    continue
                if (
                    not started
                ):  # the state begins at the first detection, with the prior
                    p, pp, pv, vv, started = (
                        position[i, step, axis],
                        r2,
                        0.0,
                        prior,
                        True,
                    )
                    continue
                residual, gain_p, gain_v = (
                    position[i, step, axis] - p,
                    pp / (pp + r2),
                    pv / (pp + r2),
                )
                p += gain_p * residual
                v += gain_v * residual
                vv -= gain_v * pv
                pp, pv = (1 - gain_p) * pp, (1 - gain_p) * pv
            if not started and q == 0:
                pp += r2  # else the variance is singular
            row = state[i, axis]
            row[0], row[1], row[2], row[3], row[4] = p, v, pp, pv, vv


def stored_noise(task: Task) -> NoiseTable:
    """The noise table for the task's condition: its own fit, else the most similar one of those that know most classes.

    A class of the same kind (vehicles, two wheels, people) counts as known. A condition is a domain, as the task's card
    names it, what is observed and in which frame. Most similar: the same domain and another variant of the detector;
    the same domain and another detector; another domain. Among equals, and if a card names no domain, the detector
    decides. True boxes and detections, moving and still frames never stand in for each other. Raises UnknownNameError
    if no stored condition is left.
    """
    stored = _read_folder(FOLDER)
    similar = [name for name in stored if _similarity(name, task) > 0]
    if not similar:
        raise UnknownNameError(
            "motion noise", condition(task), stored, "fit it with `mtp-bench train`"
        )
    known = {
        name: sum(
            kind in stored[name] or of_kind(kind, stored[name]) is not None
            for kind in task.classes
        )
        for name in similar
    }
    best = max(similar, key=lambda name: (known[name], _similarity(name, task)))
    rows = []
    for class_name in task.classes:
        like = similar_class(class_name, stored[best])
        if like is None:
            raise UnknownNameError(
                f"class of motion noise {best!r}", class_name, stored[best]
            )
        rows.append(stored[best][like])
    return noise_table(rows)


def noise_table(rows: Sequence[Noise]) -> NoiseTable:
    """A noise table from the noise of each class."""
    names = [field.name for field in fields(NoiseTable)]
    return NoiseTable(
        **{
            name: np.array([row[name] for row in rows], dtype=np.float64)
            for name in names
        }
    )


def observed(task: Task) -> str:
    """Name of the task's fit in the file of its domain: source of the pasts, and frame."""
    pasts = "truth" if task.observe == "truth" else family_of(task.detector)
    return f"{pasts}-{'world' if task.ego_motion else 'ego'}"


def condition(task: Task) -> str:
    """Name of the fit for a task: the domain that its card names, else the env itself, and what is observed."""
    return f"{task.motion_noise or task.env_id}-{observed(task)}"


def _similarity(name: str, task: Task) -> int:
    """Similarity of the stored condition ``name`` to the task's; 0: it cannot stand in."""
    stored_domain, pasts, frame = name.rsplit("-", 2)
    wanted, wanted_frame = observed(task).rsplit("-", 1)
    if frame != wanted_frame or (pasts == "truth") != (wanted == "truth"):
        return 0
    same_family = pasts.split("_")[-1] == wanted.split("_")[-1]
    mine = task.motion_noise
    # A name before "_" is a domain of its own: nuScenes_mini is like nuScenes.
    near = 4 * (stored_domain.split("_")[0] == mine.split("_")[0]) + 2 * (
        stored_domain == mine
    )
    return 1 + same_family + 2 * (pasts == wanted) + near


@cache
def _read_folder(folder: Path) -> dict[str, dict[str, Noise]]:
    """The noise of each class under each condition, in the order that the files state."""
    files = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted(folder.glob("*.toml"))
    }
    order = {name: content.pop("order", math.inf) for name, content in files.items()}
    return {
        f"{name}-{fit}": rows
        for name, content in sorted(files.items(), key=lambda file: order[file[0]])
        for fit, rows in content.items()
    }
