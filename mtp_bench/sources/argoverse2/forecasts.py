"""Forecasts in the form of Argoverse 2's end-to-end forecasting task, a pickle."""

from functools import partial
from pathlib import Path
from typing import Any

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import DataRoot, ForecastForm, ReadForecasts, StoredForecasts, section_of
from ..stored_forecasts import StoredForecast, missing_scene, stack_forecasts
from .files import CATEGORIES, NEUTRAL, Argoverse2Source, Sweeps, log_folder

_SHAPES = {  # of the arrays of an object, -1: any length
    "current_translation_m": (-1,),
    "yaw": (),
    "size": (3,),
    "detection_score": (),
    "prediction_m": (-1, -1, 2),
    "score": (-1,),
}
RATE_HZ = 2.0
MAX_OBJECTS = 10_000  # in a frame


def _open(card: Card, data: DataRoot, path: Path) -> ReadForecasts:
    # the judge imports this module, but never a reader of pickles
    from ..restricted_pickle import read_pickle

    logs = read_pickle(path)
    if not isinstance(logs, dict):
        raise DataError(f"{path}: {type(logs).__name__}, expected a dict of logs")
    return partial(_log_forecasts, card, data, path, logs)


def _log_forecasts(
    card: Card, data: DataRoot, path: Path, logs: dict[Any, Any], scene: Scene
) -> StoredForecasts:
    """Return the forecasts of a log; sweeps between frames are left out."""
    by_time = logs.pop(scene.name, None)
    if not isinstance(by_time, dict):
        raise missing_scene(path, scene.name, f"{len(logs)} other logs, but none")
    stride = section_of(card, Argoverse2Source).stride
    sweeps = Sweeps.read(log_folder(card, data, scene.name), stride)
    objects: list[StoredForecast] = []
    for t, stamp in enumerate(sweeps.stamp[::stride].tolist()):
        where = f"{path}, log {scene.name!r}, time {stamp}"
        items = by_time.get(stamp)
        if not isinstance(items, list) or len(items) > MAX_OBJECTS:
            raise DataError(
                f"{where}: no list of up to {MAX_OBJECTS} objects, expected one for "
                "each frame, empty where nothing is forecast"
            )
        for number, item in enumerate(items):
            place = f"{where}, object {number}"
            objects.append(_object_of(item, t, place, sweeps.origin))
    return stack_forecasts(objects, {}, len(logs))


def _object_of(item: Any, frame: int, where: str, origin: Floats) -> StoredForecast:
    """Return an object of the file, in the scene's frame of reference."""
    from ..restricted_pickle import array_of

    if not isinstance(item, dict):
        raise DataError(f"{where}: {type(item).__name__}, expected a dict")
    numbers = {
        key: array_of(item.get(key), shape, f"{where}, {key}")
        for key, shape in _SHAPES.items()
    }
    centre = numbers["current_translation_m"]
    if len(centre) not in (2, 3):
        raise DataError(f"{where}: a place of {len(centre)} numbers, expected x y")
    # the height is that of the ego without one
    place = [*(centre - origin[: len(centre)]), 0.0][:3]
    texts = (item.get("name"), item.get("instance_id"))
    # no other value: the text of a list of lists may never end
    name, identity = (
        str(text) if isinstance(text, str | int) else "" for text in texts
    )
    return StoredForecast(
        frame=frame,
        where=where,
        class_name=CATEGORIES.get(name, name).removeprefix(NEUTRAL),
        box=[*place, float(numbers["yaw"]), *numbers["size"]],
        confidence=float(numbers["detection_score"]),
        path=numbers["prediction_m"] - origin[:2],
        log_weight=numbers["score"],  # of any scale: only the order counts
        identity=identity,
    )


FORMS = {"av2": ForecastForm(RATE_HZ, _open)}
