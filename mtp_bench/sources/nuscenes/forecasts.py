"""Forecasts of nuScenes in the result files of other systems (docs/data).

A file is a JSON object with a list of objects for each sample, which may stand under
``results``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import (
    DataRoot,
    ForecastForm,
    ReadForecasts,
    StoredForecasts,
    usual_sizes,
)
from ..mapped import read_keys
from ..stored_forecasts import (
    StoredForecast,
    missing_scene,
    stack_forecasts,
)
from ..text import decode
from .lidar import LidarPose, lidar_pose, to_global
from .source import RATE_HZ, NuScenes
from .store import TableStore

# a number; null, as NaN is read, is one that the file lacks
_Cell = float | None
_Samples = list[list[tuple[_Cell, _Cell]]]
_NULL = b"null"


class ForecastObject(msgspec.Struct, gc=False):
    """An object of any of the forms; keys that are not declared are skipped."""

    translation: Annotated[list[_Cell], msgspec.Meta(min_length=2, max_length=3)]
    size: tuple[_Cell, _Cell, _Cell] | None = None  # width, length, height
    rotation: tuple[_Cell, _Cell, _Cell, _Cell] = (1.0, 0.0, 0.0, 0.0)  # w x y z
    class_name: str | None = None
    detection_name: str | None = None
    tracking_name: str | None = None
    detection_score: float | None = None
    tracking_score: float | None = None
    tracking_id: str | int = ""
    traj: msgspec.Raw = msgspec.Raw(_NULL)
    traj_prob: list[_Cell] | None = None
    predict_traj: msgspec.Raw = msgspec.Raw(_NULL)
    predict_traj_score: list[_Cell] | None = None
    pred_outputs: msgspec.Raw = msgspec.Raw(_NULL)
    pred_future_trajs: msgspec.Raw = msgspec.Raw(_NULL)
    pred_probs: list[_Cell] | None = None
    fut_traj: list[_Cell] | None = None


@dataclass(frozen=True)
class _Form:
    """Keys of a form that differ between the forms."""

    paths: Sequence[str]  # the first that an object has counts
    weights: str = ""
    are_logarithms: bool = False  # the weights
    # "lidar": places in the frame of LIDAR_TOP; "steps": from one place to the next
    frame: Literal["global", "lidar", "steps"] = "global"


_FORMS = {
    "mfeval": _Form(("traj",), "traj_prob"),
    "uniad": _Form(("predict_traj",), "predict_traj_score", True, "lidar"),
    "vip3d": _Form(("pred_outputs", "pred_future_trajs"), "pred_probs", True),
    "vad": _Form(("fut_traj",), frame="steps"),
}
_VAD_MODES = 6  # of a flat list


def _open(form: _Form, card: Card, data: DataRoot, path: Path) -> ReadForecasts:
    tables = NuScenes(card, data).tables
    samples = read_keys(path)
    return partial(_scene_forecasts, form, card, tables, path, samples)


def _scene_forecasts(
    form: _Form,
    card: Card,
    tables: TableStore,
    path: Path,
    samples: dict[str, msgspec.Raw],
    scene: Scene,
) -> StoredForecasts:
    tokens = tables.sample_tokens(scene.name)
    for token in tokens:
        if token not in samples:
            problem = (
                f"no entry for sample {token!r}, expected one for each of "
                f"{len(tokens)} samples, empty where nothing is forecast (it has "
                f"{len(samples)} others),"
            )
            raise missing_scene(path, scene.name, problem)
    objects: list[StoredForecast] = []
    classes = card.task.classes
    sizes = dict(zip(classes, usual_sizes(classes).tolist(), strict=True))
    for t, token in enumerate(tokens):
        where = f"{path}, sample {token!r}"
        items = decode(samples.pop(token), list[ForecastObject], where)
        # arrays at once: the lists of a whole scene would keep the collector busy
        objects += [_object_of(item, form, t, where, sizes) for item in items]
    stored = stack_forecasts(objects, {}, len(samples))
    if not form.are_logarithms:
        weight = np.maximum(stored.log_weight, 0)
        with np.errstate(divide="ignore"):
            np.log(weight, out=stored.log_weight)
    if form.frame != "global":
        for t, token in enumerate(tokens):
            rows = stored.frame == t
            places = stored.path[rows]
            pose = lidar_pose(tables, token)
            stored.path[rows] = _in_scene(places, stored.box[rows], pose, form)
    return stored


def _object_of(
    item: ForecastObject,
    form: _Form,
    frame: int,
    where: str,
    sizes: Mapping[str, Sequence[float]],
) -> StoredForecast:
    """Return an object of the file; ``sizes``: usual l w h by class."""
    name = item.class_name or item.tracking_name or item.detection_name or ""
    score = item.tracking_score
    if score is None:
        score = item.detection_score
    place = (*item.translation, 0.0)[:3]
    w, x, y, z = np.array(item.rotation, np.float64)
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # of numbers that are no rotation
        yaw = np.arctan2(2 * (x * y + w * z), w * w + x * x - y * y - z * z)
    size: Sequence[_Cell] = sizes.get(name, (0.0,) * 3)
    if item.size is not None:
        width, length, height = item.size
        size = (length, width, height)
    path = _path_of(item, form, where)
    weights = getattr(item, form.weights, None)
    if weights is None or not len(path):
        weights = [1.0] * len(path)
    return StoredForecast(
        frame=frame,
        where=where,
        class_name=name,
        box=(*place, yaw, *size),
        confidence=score,
        path=path,
        log_weight=np.array(weights, dtype=np.float64),
        identity=str(item.tracking_id),
    )


def _path_of(item: ForecastObject, form: _Form, where: str) -> Floats:
    """Return the samples [k, S, 2] of an object, none without a forecast."""
    if form.frame == "steps":
        path = item.fut_traj or []
        steps = len(path) // (2 * _VAD_MODES)
        if len(path) != steps * 2 * _VAD_MODES:
            raise DataError(
                f"{where}: {len(path)} numbers in fut_traj, expected x y of as many "
                f"steps in each of {_VAD_MODES} samples"
            )
        samples = _VAD_MODES if path else 0
        return np.array(path, np.float64).reshape(samples, steps, 2).cumsum(axis=1)
    paths = (_nested_places(getattr(item, key), where) for key in form.paths)
    return next((path for path in paths if len(path)), np.zeros((0, 0, 2)))


def _nested_places(content: msgspec.Raw, where: str) -> Floats:
    """Return samples [k, S, 2] of lists of lists, none for null."""
    samples = [] if bytes(content) == _NULL else decode(content, _Samples, where)
    lengths = {len(path) for path in samples}
    if len(lengths) > 1:
        raise DataError(
            f"{where}: samples of {sorted(lengths)} places in one object, expected "
            "equally many"
        )
    if lengths <= {0}:
        return np.zeros((0, 0, 2))
    return np.array(samples, np.float64)


def _in_scene(places: Floats, box: Floats, pose: LidarPose, form: _Form) -> Floats:
    """Return places [R, K, S, 2] of the objects of a sample in the global frame."""
    if form.frame == "steps":  # offsets from the centre, along the axes of the lidar
        turned = places @ pose[0][:2, :2].T
        return np.asarray(turned + box[:, None, None, :2])
    height = np.broadcast_to(box[:, None, None, 2:3], (*places.shape[:3], 1))
    return to_global(np.concatenate([places, height], axis=-1), pose)[..., :2]


FORMS = {
    name: ForecastForm(RATE_HZ, partial(_open, form)) for name, form in _FORMS.items()
}
