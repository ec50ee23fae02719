"""Fit of motion noise to windows of tracks.

The criterion is the continuous ranked probability score of the forecast of each axis,
averaged over the horizon: it is proper, needs no sampling, and a few broken tracks do
not dominate it as in a likelihood (Gneiting, Raftery 2007).
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
    rotation,
    select,
)
from ..prediction import (
    NoiseTable,
    filter_tracks,
    heading_frame,
    noise_table,
    observed_condition,
)
from ..running import DEFAULTS, Fold, RunOptions
from ..tracking import HypothesisTracker, TruthTracker
from .split import observations, open_split

# Start of the fit: measurement, jerkiness (2), speed (2), acceleration (2); of two
# numbers the first is along the heading, the second across.
_START = (0.05, 0.5, 0.2, 5.0, 1.0, 0.5, 0.3)
# Its limits: with no noise a filter ignores its input.
_LIMITS = (
    (0.005, 1.0),
    (0.02, 10),
    (0.02, 10),
    (0.1, 30),
    (0.05, 10),
    (0.02, 10),
    (0.02, 10),
)


def fit_env(
    env_id: str,
    options: RunOptions = DEFAULTS,
    observe: str = "detections",
    without: Fold | None = None,
) -> str:
    """Return TOML of the motion noise fitted on a training split.

    They are tables for the file of the domain of the env. ``options`` may name another
    split. ``observe``: "truth" for ground-truth tracks. ``without``: a fold whose
    scenes are left out, see `open_split`. Raises MtpBenchError if there is nothing to
    fit.
    """
    require_known("value of observe", observe, ("detections", "truth"))
    split = open_split(env_id, options.on_split("train"), without)
    task = split.task(observe)
    class_rows = fit_scenes(list(split.scenes()), task)
    if not class_rows:
        raise MtpBenchError(
            f"{env_id}: no track of the {len(split.names)} training scenes follows an "
            f"object with {task.future} future frames, so there is nothing to fit"
        )
    return as_toml(observed_condition(task), class_rows)


def fit_scenes(scenes: Sequence[Scene], task: Task) -> dict[str, dict[str, Any]]:
    """Fit the noise of every class to scenes, by class name.

    Pasts are tracks of the single-hypothesis tracker, or ground-truth tracks if the
    task observes the truth. A class without windows is left out.
    """
    tracker: Tracker = HypothesisTracker()
    if task.observe == "truth":
        tracker = TruthTracker()
    windows = collect(scenes, task, tracker)
    class_rows = {}
    with long_work("fitting the motion noise by class") as work:
        work.started(len(task.classes))
        for class_id, class_name in enumerate(task.classes):
            of_class = select(windows, windows.class_id == class_id)
            if len(of_class.class_id):
                class_rows[class_name] = fit_motion_noise(
                    of_class.position, of_class.valid, of_class.future, task.dt
                )
            work.done(class_name)
    return class_rows


def as_toml(condition_name: str, class_rows: dict[str, dict[str, Any]]) -> str:
    """Return the TOML tables of the noise of all classes under one condition.

    ``condition_name``: of the observations, see `observed_condition`.
    """
    lines = []
    for class_name, class_row in class_rows.items():
        lines.append(f'["{condition_name}".{class_name}]')
        lines += [f"{field} = {value}" for field, value in class_row.items()]
        lines.append("")
    return "\n".join(lines)


def fit_motion_noise(
    position: Floats, valid: Bools, future: Floats, dt: float
) -> dict[str, Any]:
    """Fit the noise of one class to windows in heading frames.

    ``position`` [n, P, 2] and ``valid`` [n, P]: the past as a predictor sees it;
    ``future`` [n, T, 2]: the truth; ``dt``: frame period, s. Returns the fields of a
    row of the noise table, rounded.
    """
    from scipy.optimize import minimize

    def loss(log_noise: Floats) -> float:
        noise = noise_table([_noise_row(np.exp(log_noise))])
        return forecast_score(position, valid, future, noise, dt)

    # logarithms keep all noise positive; eps is their step for the gradient
    best = minimize(
        loss,
        np.log(_START),
        method="L-BFGS-B",
        bounds=np.log(_LIMITS),
        options={"eps": 1e-3, "maxiter": 60},
    )
    return {
        field_name: np.round(value, 4).tolist()
        for field_name, value in _noise_row(np.exp(best.x)).items()
    }


def _noise_row(values: Floats) -> dict[str, Any]:
    """Return the numbers [7] of a fit, in the order of `_START`, by their field."""
    return {
        "measurement": values[0],
        "jerkiness": values[1:3],
        "speed": values[3:5],
        "acceleration": values[5:7],
    }


def forecast_score(
    position: Floats, valid: Bools, future: Floats, noise: NoiseTable, dt: float
) -> float:
    """Return the mean score (m) of constant-velocity forecasts of one class.

    It is the continuous ranked probability score. ``position`` [n, P, 2] and ``valid``
    [n, P]: pasts, heading frame; ``future`` [n, T, 2]: the truth, m; ``noise``: of that
    class; ``dt``: frame period, s.
    """
    from scipy.special import ndtr

    class_id = np.zeros(len(position), dtype=np.int64)
    state = filter_tracks(position, valid, class_id, noise, dt)
    tau = dt * np.arange(1, future.shape[1] + 1)[:, None]
    # position + tau * velocity, and the way of an acceleration: tau^2 / 2
    mean = state.position[:, None] + tau * state.velocity[:, None]
    cov = state.covariance[:, None]
    variance = cov[..., 0, 0] + 2 * tau * cov[..., 0, 1] + tau**2 * cov[..., 1, 1]
    deviation = np.sqrt(variance + noise.acceleration[0] ** 2 * tau**4 / 4)
    z = (future - mean) / deviation
    density = np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    # of a standard normal forecast
    score = z * (2 * ndtr(z) - 1) + 2 * density - 1 / math.sqrt(math.pi)
    return float(np.mean(score * deviation))


@dataclass(frozen=True, eq=False)
class MotionWindows:
    """Windows of n tracks in the heading frame of their last box.

    The origin is the centre of that box.
    """

    position: Floats  # [n, P, 2]
    valid: Bools  # [n, P]
    future: Floats  # [n, T, 2]
    class_id: Ints  # [n]


def collect(
    scenes: Iterable[Scene], task: Task, tracker: Tracker, gate: float = 1.0
) -> MotionWindows:
    """Return windows of the tracks of the first hypothesis.

    A window needs a true object with all T future frames, without a hole in time. That
    object is the nearest one of the same class (BEV), at most ``gate`` metres
    away. With ``task.observe == "truth"`` the tracker gets true boxes.
    """
    no_windows = MotionWindows(
        position=np.zeros((0, task.past, 2)),
        valid=np.zeros((0, task.past), dtype=bool),
        future=np.zeros((0, task.future, 2)),
        class_id=np.zeros(0, dtype=np.int64),
    )
    parts = [no_windows]
    for scene in scenes:
        tracker.reset(task)
        piece = pieces_of(scene.time, task.dt)
        ids, object_row = np.unique(scene.truth.object_id, return_inverse=True)
        object_place = np.full((len(ids), scene.frames, 2), np.nan)
        object_place[object_row, scene.truth.frame_of_rows] = scene.truth.box[:, :2]
        for t, observation in enumerate(observations(scene, task.observe)):
            tracks = tracker.step(observation)
            end = t + task.future
            if end < scene.frames and piece[t] == piece[end]:
                future = object_place[object_row, t + 1 : end + 1]
                parts.append(_frame_windows(scene, t, tracks, future, gate))
    return joined(parts)


def _frame_windows(
    scene: Scene, t: int, tracks: Tracks, future: Floats, gate: float
) -> MotionWindows:
    """Return the windows of frame ``t``.

    ``future`` [R, T, 2] of the objects of all true rows, NaN where they are not there.
    """
    truth = scene.truth
    rows = truth.rows(t)
    true_row = rows.start + np.flatnonzero(truth.eligible[rows])
    track_row = np.flatnonzero(tracks.member[0])
    offset = tracks.box[track_row, None, :2] - truth.box[None, true_row, :2]
    distance_m = np.linalg.norm(offset, axis=-1)
    same_class = tracks.class_id[track_row, None] == truth.class_id[None, true_row]
    distance_m = np.where(same_class, distance_m, np.inf)
    in_gate = distance_m.min(axis=1, initial=np.inf) <= gate
    track_row = track_row[in_gate]
    nearest = true_row[:0]
    if len(track_row):
        nearest = true_row[distance_m[in_gate].argmin(axis=1)]
    is_complete = ~np.isnan(future[nearest]).any(axis=(1, 2))
    track_row = track_row[is_complete]
    heading = tracks.box[track_row, 3]
    ahead = future[nearest[is_complete]] - tracks.past[track_row, -1:, :2]
    return MotionWindows(
        position=heading_frame(tracks.past[track_row], heading),
        valid=tracks.past_valid[track_row],
        future=np.einsum("nti,nij->ntj", ahead, rotation(heading)),
        class_id=tracks.class_id[track_row],
    )
