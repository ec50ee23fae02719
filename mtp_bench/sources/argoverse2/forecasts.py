"""Forecasts in the form of Argoverse 2's end-to-end forecasting task, a pickle."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...cards import Card
from ...core import DataError, Scene
from ..base import DataRoot, ForecastForm, ReadForecasts, StoredForecasts, section_of
from ..restricted_pickle import array_of, read_pickle
from ..stored_forecasts import missing_scene, padded_samples
from .files import CATEGORIES, NEUTRAL, Argoverse2Source, Sweeps, log_folder

_KEYS = "prediction_m score detection_score current_translation_m size yaw name"
RATE_HZ = 2.0
MAX_OBJECTS = 10_000  # in a frame


def _open(card: Card, data: DataRoot, path: Path) -> ReadForecasts:
    logs = read_pickle(path)
    if not isinstance(logs, dict):
        raise DataError(f"{path}: {type(logs).__name__}, expected a dict of logs")
    return partial(_log_forecasts, card, data, path, logs)


def _log_forecasts(
    card: Card, data: DataRoot, path: Path, logs: dict[Any, Any], scene: Scene
) -> StoredForecasts:
    """Return the forecasts of a log; sweeps between frames are left out."""
    if not isinstance(logs.get(scene.name), dict):
        raise missing_scene(path, scene.name, f"it has {len(logs)} other logs")
    by_time = logs[scene.name]
    stride = section_of(card, Argoverse2Source).stride
    sweeps = Sweeps.read(log_folder(card, data, scene.name), stride)
    frame: list[int] = []
    items: list[dict[str, Any]] = []
    places: list[str] = []
    for t, stamp in enumerate(sweeps.stamp[::stride].tolist()):
        where = f"{path}, log {scene.name!r}, time {stamp}"
        found = by_time.get(stamp)
        if not isinstance(found, list) or len(found) > MAX_OBJECTS:
            raise DataError(
                f"{where}: no list of up to {MAX_OBJECTS} objects, expected one for "
                "each frame, empty where nothing is forecast"
            )
        for number, item in enumerate(found):
            keys = item if isinstance(item, dict) else {}
            missing = [key for key in _KEYS.split() if key not in keys]
            if missing:
                raise DataError(f"{where}, object {number}: no {missing[0]!r}")
            frame.append(t)
            items.append(item)
            places.append(f"{where}, object {number}")
    box = np.zeros((len(items), 7))
    confidence = np.zeros(len(items))
    paths = []
    weights = []
    for row, (item, where) in enumerate(zip(items, places, strict=True)):
        centre = array_of(item["current_translation_m"], (-1,), where)[:3]
        box[row, : len(centre)] = centre
        box[row, 3] = array_of(item["yaw"], (), where)
        box[row, 4:] = array_of(item["size"], (3,), where)
        confidence[row] = array_of(item["detection_score"], (), where)
        paths.append(array_of(item["prediction_m"], (-1, -1, 2), where))
        weights.append(array_of(item["score"], (len(paths[-1]),), where))
    box[:, :3] -= sweeps.origin
    path_array = padded_samples(paths, places.__getitem__) - sweeps.origin[:2]
    log_weight = np.full(path_array.shape[:2], -np.inf)
    for row, weight in enumerate(weights):
        # any scale: the order is what counts
        log_weight[row, : len(weight)] = weight
    return StoredForecasts(
        frame=np.array(frame, dtype=np.int64),
        class_name=np.array([_class_of(item["name"]) for item in items], dtype=np.str_),
        box=box,
        confidence=confidence,
        path=path_array,
        log_weight=log_weight,
        identity=np.array([str(item.get("instance_id", "")) for item in items], str),
    )


def _class_of(name: Any) -> str:
    """Return the class of an official category, which is that of the task."""
    category = CATEGORIES.get(str(name), str(name))
    return category.removeprefix(NEUTRAL)


FORMS = {"av2": ForecastForm(RATE_HZ, _open)}
