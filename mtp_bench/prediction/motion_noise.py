"""Motion noise fitted on training splits, and the fit.

The criterion is the continuous ranked probability score of the forecast of each axis, averaged over the horizon: it is
proper, needs no sampling, and a few broken tracks do not rule it as they would a likelihood (Gneiting, Raftery 2007).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UnknownNameError
from ..tracking import HypothesisTracker, TruthTracker
from ..types import Bools, Floats, Scene, Task
from .kalman import NoiseTable, filtered
from .windows import collect

_STORE = Path(__file__).with_suffix(".toml")
_FIELDS = ("measurement", "jerkiness", "speed", "acceleration", "turn_rate")


def condition(task: Task) -> str:
    """Name of the fit for a task: its domain ("KITTI" of MTP-KITTI-5Hz-v0), what is observed, and in which frame."""
    return f"{_domain(task.env_id)}-{_observed(task)}-{_frame(task)}"


def stored_noise(task: Task) -> NoiseTable:
    """The noise table for the task's condition: its own fit, else the most similar one that knows its classes.

    Most similar: the same domain and another variant of the detector; the same domain and another detector; another
    domain. True boxes and detections, moving and still frames never stand in for each other. Raises UnknownNameError
    if nothing is left.
    """
    store = _read_store()
    similar = [name for name in store if _likeness(name, task) > 0]
    if not similar:
        raise UnknownNameError("motion noise", condition(task), store, "fit it with `mtp-bench train motion-noise`")
    knowing = [name for name in similar if all(class_name in store[name] for class_name in task.classes)]
    if not knowing:
        best = max(similar, key=lambda name: _likeness(name, task))
        strange = next(class_name for class_name in task.classes if class_name not in store[best])
        raise UnknownNameError(f"class of motion noise {best!r}", strange, store[best])
    best = max(knowing, key=lambda name: _likeness(name, task))
    return table([store[best][c] for c in task.classes])


def _likeness(name: str, task: Task) -> int:
    """How well the stored condition suits the task; 0: not at all."""
    domain, observed, frame = name.split("-")
    wanted = _observed(task)
    if frame != _frame(task) or (observed == "truth") != (wanted == "truth"):
        return 0
    same_family = observed.split("_")[-1] == wanted.split("_")[-1]
    mine = _domain(task.env_id)
    near = 4 * (domain.split("_")[0] == mine.split("_")[0]) + 2 * (domain == mine)
    return 1 + same_family + 2 * (observed == wanted) + near


_CONDITIONS = ("noego", "5Hz", "k10")  # parts of an id that stand for another task, not for other objects


def _domain(env_id: str) -> str:
    """Domain of an env: "KITTI" of MTP-KITTI-5Hz-v0, "nuScenes_mini" of MTP-nuScenes-mini-v0 (there, cars park)."""
    parts = env_id.split("-")
    if parts[0] != "MTP" or len(parts) < 3:
        return parts[0]
    return "_".join(part for part in parts[1:-1] if part not in _CONDITIONS)


def _observed(task: Task) -> str:
    """What pasts are made of; variants of a detector ("kitti_pointrcnn-hard") share a fit."""
    return "truth" if task.observe == "truth" else task.detector.split("-")[0]


def _frame(task: Task) -> str:
    return "world" if task.ego_motion else "ego"


def table(rows: list[dict[str, Any]]) -> NoiseTable:
    """A noise table from one mapping of field to value(s) per class."""
    return NoiseTable(**{field: np.array([row[field] for row in rows], dtype=np.float64) for field in _FIELDS})


@cache
def _read_store() -> dict[str, dict[str, dict[str, Any]]]:
    return tomllib.loads(_STORE.read_text(encoding="utf-8"))


def fit_scenes(scenes: Sequence[Scene], task: Task) -> dict[str, dict[str, Any]]:
    """Noise of every class of ``task`` from scenes of a training split, as stored under ``condition(task)``.

    The past is what the single-hypothesis tracker makes of the detections, or the true past if the task observes it.
    A class without windows is left out.
    """
    tracker = TruthTracker() if task.observe == "truth" else HypothesisTracker()
    windows = collect(scenes, task, tracker)
    rows = {}
    for class_id, name in enumerate(task.classes):
        mine = windows.class_id == class_id
        if mine.any():
            row = fit_motion_noise(windows.position[mine], windows.valid[mine], windows.future[mine], task.dt)
            rows[name] = {**row, "turn_rate": TURN_RATE}
    return rows


TURN_RATE = 0.1  # rad/s, prior of the turn-rate model; not fitted


def as_toml(name: str, rows: dict[str, dict[str, Any]]) -> str:
    """The text of a stored condition."""
    lines = []
    for class_name, row in rows.items():
        lines += [f'["{name}".{class_name}]', *(f"{field} = {value}" for field, value in row.items()), ""]
    return "\n".join(lines)


def fit_motion_noise(position: Floats, valid: Bools, future: Floats, dt: float) -> dict[str, Any]:
    """Noise of one class from windows in the heading frame of their last box.

    ``position`` [n, P, 2] and ``valid`` [n, P]: the past as a predictor sees it; ``future`` [n, T, 2]: the truth. The
    turn rate is not among the fitted values.
    """
    from scipy.optimize import minimize

    start = np.log([0.05, 0.5, 0.2, 5.0, 1.0, 0.5, 0.3])
    bounds = [tuple(np.log(limit)) for limit in _LIMITS]

    def loss(x: Floats) -> float:
        noise = table([{**_row(np.exp(x)), "turn_rate": 0.1}])
        return forecast_score(position, valid, future, noise, dt)

    best = minimize(loss, start, method="L-BFGS-B", bounds=bounds, options={"eps": 1e-3, "maxiter": 60})
    return {field: np.round(value, 4).tolist() for field, value in _row(np.exp(best.x)).items()}


# Limits of the fit: measurement, jerkiness (2), speed (2), acceleration (2); a noise of 0 would make a filter deaf.
_LIMITS = [(0.005, 1.0), (0.02, 10), (0.02, 10), (0.1, 30), (0.05, 10), (0.02, 10), (0.02, 10)]


def _row(x: Floats) -> dict[str, Any]:
    return {"measurement": x[0], "jerkiness": x[1:3], "speed": x[3:5], "acceleration": x[5:7]}


def forecast_score(position: Floats, valid: Bools, future: Floats, noise: NoiseTable, dt: float) -> float:
    """Mean continuous ranked probability score (m) of the constant-velocity forecast of windows of one class."""
    state = filtered(position, valid, np.zeros(len(position), dtype=np.int64), noise, dt)
    tau = dt * np.arange(1, future.shape[1] + 1)[:, None]
    mean = state.position[:, None] + tau * state.velocity[:, None]
    cov = state.covariance[:, None]
    variance = cov[..., 0, 0] + 2 * tau * cov[..., 0, 1] + tau**2 * cov[..., 1, 1]
    deviation = np.sqrt(variance + noise.acceleration[0] ** 2 * tau**4 / 4)
    return float(np.mean(_crps((future - mean) / deviation) * deviation))


def _crps(z: Floats) -> Floats:
    """Score of a standard normal forecast where ``z`` came true."""
    from scipy.special import ndtr

    density = np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi)
    score: Floats = z * (2 * ndtr(z) - 1) + 2 * density - 1 / math.sqrt(math.pi)
    return score
