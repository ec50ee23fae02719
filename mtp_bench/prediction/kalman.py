"""A Kalman filter over the short past of many tracks at once, and its stored noise.

It works in the heading frame of each track. Along and across the heading the motion is
taken as independent: a nearly constant velocity disturbed by white acceleration
(Bar-Shalom, Li, Kirubarajan 2001, ch. 6). Its noise is fitted on training splits: TOML
files in ``motion_noise/``, one per domain where objects move alike.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import itemgetter
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
    """Noise of the motion model per class.

    The last axis is along and across the heading.
    """

    measurement: Floats  # [C] m, standard deviation of a detected position
    jerkiness: Floats  # [C, 2] m/s^1.5, white acceleration while the past is filtered
    speed: Floats  # [C, 2] m/s, prior standard deviation of a velocity never seen
    # [C, 2] m/s^2, standard deviation of the acceleration over the future
    acceleration: Floats


# shape of each class's noise, and whether it must be above 0
_NOISE_FORM: dict[str, tuple[tuple[int, ...], bool]] = {
    "measurement": ((), True),
    "jerkiness": ((2,), False),
    "speed": ((2,), True),
    "acceleration": ((2,), False),
}


def require_noise(noise: NoiseTable) -> None:
    """Raise ShapeError unless covariances of states can be positive definite."""
    classes = len(noise.measurement)
    for name, (shape, must_be_positive) in _NOISE_FORM.items():
        values = getattr(noise, name)
        require_shape(f"noise.{name}", values, (classes, *shape))
        require_finite(f"noise.{name}", values)
        least = values.min(initial=np.inf)
        if least < 0 or (must_be_positive and least == 0):
            expected = "above 0" if must_be_positive else "of at least 0"
            raise ShapeError(
                f"noise.{name} contains {least}, expected numbers {expected}"
            )


@dataclass(frozen=True, eq=False)
class Posterior:
    """Position and velocity of N tracks now.

    Axis 1 is along and across the heading.
    """

    position: Floats  # [N, 2] m from the track's last box centre
    velocity: Floats  # [N, 2] m/s
    covariance: Floats  # [N, 2, 2, 2] of (position, velocity) for each of the two axes


def heading_frame(past: Floats, heading: Floats) -> Floats:
    """Return positions [N, P, 2] of past boxes relative to the last one.

    They are turned so that axis 0 points along the ``heading`` [N].
    """
    x = past[..., 0] - past[:, -1:, 0]
    y = past[..., 1] - past[:, -1:, 1]
    cos = np.cos(heading)[:, None]
    sin = np.sin(heading)[:, None]
    return np.stack([x * cos + y * sin, y * cos - x * sin], axis=-1)


def filter_tracks(
    position: Floats, valid: Bools, class_id: Ints, noise: NoiseTable, dt: float
) -> Posterior:
    """Return position, velocity and covariance of tracks now, from their pasts.

    ``position`` [N, P, 2] m, heading frame, oldest first; ``valid`` [N, P]: where a
    detection was taken; ``class_id`` [N] chooses the row of ``noise``; ``dt``: frame
    period, s.
    """
    state = np.empty((len(position), 2, _STATE))
    filter_pasts(
        # Copies: compiled code takes arrays that may be written, in one order.
        np.array(position, dtype=np.float64, order="C"),
        np.array(valid, dtype=bool, order="C"),
        noise.measurement[class_id],
        noise.jerkiness[class_id],
        noise.speed[class_id],
        dt,
        state,
    )
    covariance = np.stack([state[..., 2:4], state[..., 3:5]], axis=-2)
    return Posterior(state[..., 0].copy(), state[..., 1].copy(), covariance)


# Numbers of an axis: position, velocity, variance of position, covariance, variance of
# velocity.
_STATE = 5


@kernel(
    "void(f8[:, :, ::1], b1[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], f8, "
    "f8[:, :, ::1])"
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
    """Write the states [N, 2, 5] after positions [N, P, 2].

    The noise of each track is ``measurement`` [N], ``jerkiness`` and ``speed`` [N, 2].
    """
    for i in range(len(state)):
        for axis in range(2):
            r2 = measurement[i] ** 2
            q = jerkiness[i, axis] ** 2
            prior = speed[i, axis] ** 2
            # position and velocity, then their variances and covariance
            p = 0.0
            v = 0.0
            pp = 0.0
            pv = 0.0
            vv = prior
            started = False
            for step in range(position.shape[1]):
                p += v * dt
                pp += 2 * dt * pv + dt * dt * vv + q * dt**3 / 3
                pv += dt * vv + q * dt * dt / 2
                vv += q * dt
                if not valid[i, step]:
                    continue
                if not started:
                    # the state begins at the first detection, with the prior
                    p = position[i, step, axis]
                    pp = r2
                    pv = 0.0
                    vv = prior
                    started = True
                    continue
                residual = position[i, step, axis] - p
                gain_p = pp / (pp + r2)
                gain_v = pv / (pp + r2)
                p += gain_p * residual
                v += gain_v * residual
                vv -= gain_v * pv
                pp = (1 - gain_p) * pp
                pv = (1 - gain_p) * pv
            if not started and q == 0:
                pp += r2  # else the variance is singular
            row = state[i, axis]
            row[0] = p
            row[1] = v
            row[2] = pp
            row[3] = pv
            row[4] = vv


def stored_noise(task: Task) -> NoiseTable:
    """Return the noise table for the task's condition, or a similar one.

    A condition is a domain, as the task's card names it, what is observed and in which
    frame. True boxes and detections, moving and still frames never stand in for each
    other. The condition with noise for most classes is chosen; a class of the same kind
    (vehicles, two wheels, people) counts. Of equals the most similar one is chosen: the
    same domain, then the same detector, see `_similarity`. Raises UnknownNameError if
    no stored condition can stand in.
    """
    stored = _read_folder(FOLDER)
    similar = [name for name in stored if _similarity(name, task) > 0]
    if not similar:
        cure = "fit it with `mtp-bench train`"
        raise UnknownNameError("motion noise", condition(task), stored, cure)

    def preference(name: str) -> tuple[int, int]:
        classes = stored[name]
        is_known = [
            c in classes or of_kind(c, classes) is not None for c in task.classes
        ]
        return sum(is_known), _similarity(name, task)

    best = max(similar, key=preference)
    rows = []
    for class_name in task.classes:
        like = similar_class(class_name, stored[best])
        if like is None:
            kind = f"class of motion noise {best!r}"
            raise UnknownNameError(kind, class_name, stored[best])
        rows.append(stored[best][like])
    return noise_table(rows)


def noise_table(rows: Sequence[Noise]) -> NoiseTable:
    """Return a noise table from the noise of each class."""
    columns = {
        name: np.array([row[name] for row in rows], dtype=np.float64)
        for name in _NOISE_FORM
    }
    return NoiseTable(**columns)


def observed_condition(task: Task) -> str:
    """Return the name of the task's fit in its domain's file.

    The name states the source of the pasts, and the frame.
    """
    pasts = "truth" if task.observe == "truth" else family_of(task.detector)
    return f"{pasts}-{'world' if task.ego_motion else 'ego'}"


def condition(task: Task) -> str:
    """Return the name of the fit for a task.

    It states the domain and what is observed. The domain is the one that its card
    names, else the env itself.
    """
    return f"{task.motion_noise or task.env_id}-{observed_condition(task)}"


def _similarity(name: str, task: Task) -> int:
    """Return the similarity of the stored condition ``name`` to the task's.

    0: it cannot stand in.
    """
    stored_domain, stored_pasts, stored_frame = name.rsplit("-", 2)
    pasts, frame = observed_condition(task).rsplit("-", 1)
    if stored_frame != frame or (stored_pasts == "truth") != (pasts == "truth"):
        return 0
    domain = task.motion_noise
    # behind the last "_" is the detector: "pointrcnn" of "kitti_pointrcnn"
    same_detector = stored_pasts.split("_")[-1] == pasts.split("_")[-1]
    # A name before "_" is a domain of its own: nuScenes_mini is like nuScenes.
    similar_domain = stored_domain.split("_")[0] == domain.split("_")[0]
    # A similar domain outweighs the same pasts, and these the very same domain.
    score = 1 + same_detector + 2 * (stored_pasts == pasts)
    return score + 4 * similar_domain + 2 * (stored_domain == domain)


@cache
def _read_folder(folder: Path) -> dict[str, dict[str, Noise]]:
    """Read the noise of each class under each condition.

    Conditions stand by the ``order`` that their files state.
    """
    files = []
    for path in sorted(folder.glob("*.toml")):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        files.append((content.pop("order", math.inf), path.stem, content))
    files.sort(key=itemgetter(0))
    return {
        f"{domain}-{fit}": rows
        for _, domain, content in files
        for fit, rows in content.items()
    }
