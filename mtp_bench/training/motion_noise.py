"""Fit of motion noise to windows of tracks.

The criterion is the continuous ranked probability score of the forecast of each axis, averaged over the horizon: it is
proper, needs no sampling, and a few broken tracks do not dominate it as in a likelihood (Gneiting, Raftery 2007).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..agent import Tracker
from ..core import (
    Bools,
    Floats,
    Ints,
    MtpBenchError,
    Scene,
    Task,
    Tracks,
    joined,
    long_work,
    pieces_of,
    require_known,
    select,
)
from ..env import MTPEnv
from ..prediction import (
    NoiseTable,
    filtered,
    heading_frame,
    noise_table,
    observed,
    rotation,
)
from ..running import DEFAULTS, Fold, RunOptions
from ..tracking import HypothesisTracker, TruthTracker
from .split import observations, open_split


def fit_env(
    env_id: str,
    options: RunOptions = DEFAULTS,
    observe: str = "detections",
    without: Fold | None = None,
) -> str:
    """TOML of the motion noise fitted on the training split of an env: tables for the file of its domain.

    ``options`` may name another split. ``observe``: "truth" for ground-truth tracks. ``without``: a fold whose scenes
    are left out, see `open_split`. Raises MtpBenchError if there is nothing to fit.
    """
    require_known("value of observe", observe, ("detections", "truth"))
    split = open_split(env_id, options.on_split("train"), without)
    task = MTPEnv(split.card, data=options.data, observe=observe).task
    rows = fit_scenes(list(split.scenes()), task)
    if not rows:
        raise MtpBenchError(
            f"{env_id}: no track of the {len(split.names)} training scenes follows an object with {task.future} "
            "future frames, so there is nothing to fit"
        )
    return as_toml(observed(task), rows)


def fit_scenes(scenes: Sequence[Scene], task: Task) -> dict[str, dict[str, Any]]:
    """Noise of every class of ``task`` from scenes of a training split, by class name.

    Pasts are tracks of the single-hypothesis tracker, or ground-truth tracks if the task observes the truth. A class
    without windows is left out.
    """
    windows = collect(
        scenes, task, TruthTracker() if task.observe == "truth" else HypothesisTracker()
    )
    rows = {}
    with long_work("fitting the motion noise by class") as work:
        work.started(len(task.classes))
        for class_id, name in enumerate(task.classes):
            own = select(windows, windows.class_id == class_id)
            if len(own.class_id):
                rows[name] = fit_motion_noise(
                    own.position, own.valid, own.future, task.dt
                )
            work.done(name)
    return rows


def as_toml(name: str, rows: dict[str, dict[str, Any]]) -> str:
    """The text of a stored condition."""
    lines = []
    for class_name, row in rows.items():
        lines += [
            f'["{name}".{class_name}]',
            *(f"{field} = {value}" for field, value in row.items()),
            "",
        ]
    return "\n".join(lines)


def fit_motion_noise(
    position: Floats, valid: Bools, future: Floats, dt: float
) -> dict[str, Any]:
    """Noise of one class from windows in the heading frame of their last box.

    ``position`` [n, P, 2] and ``valid`` [n, P]: the past as a predictor sees it; ``future`` [n, T, 2]: the truth.
    """
    from scipy.optimize import minimize

    start = np.log([0.05, 0.5, 0.2, 5.0, 1.0, 0.5, 0.3])
    bounds = [tuple(np.log(limit)) for limit in _LIMITS]

    def loss(x: Floats) -> float:
        return forecast_score(
            position, valid, future, noise_table([_row(np.exp(x))]), dt
        )

    best = minimize(
        loss,
        start,
        method="L-BFGS-B",
        bounds=bounds,
        options={"eps": 1e-3, "maxiter": 60},
    )
    return {
        field: np.round(value, 4).tolist()
        for field, value in _row(np.exp(best.x)).items()
    }


# Limits of the fit: measurement, jerkiness (2), speed (2), acceleration (2). With no noise a filter ignores its input.
_LIMITS = [
    (0.005, 1.0),
    (0.02, 10),
    (0.02, 10),
    (0.1, 30),
    (0.05, 10),
    (0.02, 10),
    (0.02, 10),
]


def _row(x: Floats) -> dict[str, Any]:
    return {
        "measurement": x[0],
        "jerkiness": x[1:3],
        "speed": x[3:5],
        "acceleration": x[5:7],
    }


def forecast_score(
    position: Floats, valid: Bools, future: Floats, noise: NoiseTable, dt: float
) -> float:
    """Mean continuous ranked probability score (m) of the constant-velocity forecast of windows of one class.

    ``position`` [n, P, 2] and ``valid`` [n, P]: pasts, heading frame; ``future`` [n, T, 2]: the truth, m; ``noise``: of
    that class; ``dt``: frame period, s.
    """
    from scipy.special import ndtr

    state = filtered(
        position, valid, np.zeros(len(position), dtype=np.int64), noise, dt
    )
    tau = dt * np.arange(1, future.shape[1] + 1)[:, None]
    mean = state.position[:, None] + tau * state.velocity[:, None]
    cov = state.covariance[:, None]
    variance = cov[..., 0, 0] + 2 * tau * cov[..., 0, 1] + tau**2 * cov[..., 1, 1]
    deviation = np.sqrt(variance + noise.acceleration[0] ** 2 * tau**4 / 4)
    z = (future - mean) / deviation
    density = np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    score = (
        z * (2 * ndtr(z) - 1) + 2 * density - 1 / math.sqrt(math.pi)
    )  # of a standard normal forecast
    return float(np.mean(score * deviation))


@dataclass(frozen=True, eq=False)
class MotionWindows:
    """Windows of n tracks in the heading frame of their last box; the origin is its centre."""

    position: Floats  # [n, P, 2]
    valid: Bools  # [n, P]
    future: Floats  # [n, T, 2]
    class_id: Ints  # [n]


def collect(
    scenes: Iterable[Scene], task: Task, tracker: Tracker, gate: float = 1.0
) -> MotionWindows:
    """Windows of the tracks of the first hypothesis whose true object has all T future frames, without a hole in time.

    The true object is the nearest one of the same class (BEV), at most ``gate`` metres away.
    With ``task.observe == "truth"`` the tracker gets true boxes.
    """
    no_past = np.zeros((0, task.past, 2))
    no_future = np.zeros((0, task.future, 2))
    parts = [
        MotionWindows(
            no_past, no_past[..., 0] > 0, no_future, np.zeros(0, dtype=np.int64)
        )
    ]
    for scene in scenes:
        tracker.reset(task)
        piece = pieces_of(scene.time, task.dt)
        ids, known = np.unique(scene.truth.object_id, return_inverse=True)
        place = np.full((len(ids), scene.frames, 2), np.nan)
        place[known, scene.truth.frame_of_rows] = scene.truth.box[:, :2]
        for t, observation in enumerate(observations(scene, task.observe)):
            tracks = tracker.step(observation)
            future = place[:, t + 1 : t + 1 + task.future]
            if future.shape[1] == task.future and piece[t] == piece[t + task.future]:
                parts.append(_frame_windows(scene, t, tracks, future[known], gate))
    return joined(parts)


def _frame_windows(
    scene: Scene, t: int, tracks: Tracks, future: Floats, gate: float
) -> MotionWindows:
    """Windows of frame ``t``; ``future`` [R, T, 2] of the objects of all true rows, NaN where they are not there."""
    truth = scene.truth
    rows = truth.rows(t)
    now = np.arange(rows.start, rows.stop)[truth.eligible[rows]]
    leaf = np.flatnonzero(tracks.member[0])
    distance = np.linalg.norm(
        tracks.box[leaf, None, :2] - truth.box[None, now, :2], axis=-1
    )
    distance = np.where(
        tracks.class_id[leaf, None] == truth.class_id[None, now], distance, np.inf
    )
    near = distance.min(axis=1, initial=np.inf) <= gate
    leaf = leaf[near]
    nearest = now[distance[near].argmin(axis=1)] if near.any() else now[:0]
    complete = ~np.isnan(future[nearest]).any(axis=(1, 2))
    leaf, ahead, heading = (
        leaf[complete],
        future[nearest[complete]],
        tracks.box[leaf[complete], 3],
    )
    local = np.einsum(
        "nti,nij->ntj", ahead - tracks.past[leaf, -1:, :2], rotation(heading)
    )
    position = heading_frame(tracks.past[leaf], heading)
    return MotionWindows(
        position, tracks.past_valid[leaf], local, tracks.class_id[leaf]
    )
