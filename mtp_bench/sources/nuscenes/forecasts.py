"""Forecasts of nuScenes in the result files of other systems (docs/data).

A file is a JSON object with a list of objects for each sample, which may stand under
``results``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ...cards import Card
from ...core import DataError, Floats, Scene
from ..base import (
    DataRoot,
    ForecastForm,
    ReadForecasts,
    StoredForecasts,
    class_ids,
    usual_sizes,
)
from ..mapped import read_keys
from ..rotation import yaw_of
from ..stored_forecasts import missing_scene, padded_samples
from ..text import decode
from .lidar import LidarPose, lidar_pose, to_global
from .source import RATE_HZ, NuScenes
from .store import TableStore

# a number; null, as NaN is read, is one that the file lacks
_Cell = float | None
_Samples = list[list[tuple[_Cell, _Cell]]]


class ForecastObject(msgspec.Struct, gc=False):
    """An object of any of the forms; keys that are not declared are skipped."""

    translation: Annotated[list[_Cell], msgspec.Meta(min_length=2, max_length=3)]
    size: tuple[_Cell, _Cell, _Cell] | None = None  # width, length, height
    rotation: tuple[_Cell, _Cell, _Cell, _Cell] | None = None  # w x y z
    class_name: str | None = None
    detection_name: str | None = None
    tracking_name: str | None = None
    detection_score: float | None = None
    tracking_score: float | None = None
    tracking_id: str | int | None = None
    traj: _Samples | None = None
    traj_prob: list[_Cell] | None = None
    predict_traj: _Samples | None = None
    predict_traj_score: list[_Cell] | None = None
    pred_outputs: _Samples | None = None
    pred_future_trajs: _Samples | None = None
    pred_probs: list[_Cell] | None = None
    fut_traj: list[_Cell] | None = None


@dataclass(frozen=True)
class _Form:
    """Where a form has what; of several keys the first that an object has counts."""

    names: Sequence[str]
    scores: Sequence[str]
    paths: Sequence[str]
    weights: str = ""
    weight_kind: Literal["probability", "logarithm", "none"] = "none"
    identity: str = ""
    # "lidar": places in the frame of LIDAR_TOP; "steps": from one place to the next
    frame: Literal["global", "lidar", "steps"] = "global"


_TRACK_KEYS = ("tracking_name", "detection_name"), ("tracking_score", "detection_score")
_FORMS = {
    "mfeval": _Form(
        ("class_name",), ("detection_score",), ("traj",), "traj_prob", "probability"
    ),
    "uniad": _Form(
        *_TRACK_KEYS,
        ("predict_traj",),
        "predict_traj_score",
        "logarithm",
        "tracking_id",
        "lidar",
    ),
    "vip3d": _Form(
        *_TRACK_KEYS,
        ("pred_outputs", "pred_future_trajs"),
        "pred_probs",
        "logarithm",
        "tracking_id",
    ),
    "vad": _Form(
        ("detection_name",), ("detection_score",), ("fut_traj",), frame="steps"
    ),
}
_VAD_MODES = 6  # of a flat list, with as many steps in each


def _first(item: ForecastObject, keys: Sequence[str]) -> Any:
    """Return the value of the first key that the object has, else None."""
    values = (getattr(item, key) for key in keys)
    return next((value for value in values if value is not None), None)


def _open(form: _Form, card: Card, data: DataRoot, path: Path) -> ReadForecasts:
    tables = NuScenes(card, data).tables
    samples = read_keys(path)
    if "results" in samples:
        samples = decode(samples["results"], dict[str, msgspec.Raw], path)
    known_tokens = tables.row_of_token
    if not any(token in known_tokens for token in samples):
        raise DataError(
            f"{path}: none of its {len(samples)} samples is in sample.json of "
            f"{tables.version}; expected forecasts of these scenes"
        )
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
    missing = [token for token in tokens if token not in samples]
    if len(missing) == len(tokens):
        raise missing_scene(path, scene.name, f"it has {len(samples)} other samples")
    if missing:
        raise DataError(
            f"{path}: no entry for sample {missing[0]!r} of {scene.name}, expected one "
            f"for each of its {len(tokens)} samples, empty where nothing is forecast"
        )
    frame: list[int] = []
    items: list[ForecastObject] = []
    for t, token in enumerate(tokens):
        where = f"{path}, sample {token!r}"
        found = decode(samples.pop(token), list[ForecastObject], where)
        frame += [t] * len(found)
        items += found

    def name_of(row: int) -> str:
        return f"{path}, sample {tokens[frame[row]]!r}, an object"

    class_name = [_first(item, form.names) or "" for item in items]
    frame_of_object = np.array(frame, dtype=np.int64)
    box = _boxes(items, class_name, card)
    paths = [_samples_of(item, form, name_of, row) for row, item in enumerate(items)]
    places = padded_samples(paths, name_of)
    for t in np.unique(frame_of_object).tolist():
        of_frame = frame_of_object == t
        pose = lidar_pose(tables, tokens[t])
        places[of_frame] = _in_scene(places[of_frame], box[of_frame], pose, form)
    is_standing = np.array([len(path) == 0 for path in paths], dtype=bool)
    if places.shape[1]:
        places[is_standing, 0] = box[is_standing, None, :2]
    identity = [
        getattr(item, form.identity) if form.identity else None for item in items
    ]
    return StoredForecasts(
        others=len(samples),
        frame=frame_of_object,
        class_name=np.array(class_name, dtype=np.str_),
        box=box,
        confidence=_numbers([_first(item, form.scores) for item in items]),
        path=places,
        log_weight=_log_weights(items, form, places, name_of),
        identity=np.array(
            ["" if name is None else str(name) for name in identity], dtype=np.str_
        ),
        notes={"objects without a forecast, taken to stand": int(is_standing.sum())},
    )


def _numbers(values: Sequence[_Cell]) -> Floats:
    """Return numbers, NaN for None."""
    return np.array(values, dtype=np.float64)


def _boxes(
    items: Sequence[ForecastObject], class_name: Sequence[str], card: Card
) -> Floats:
    """Return boxes [R, 7] in the global frame; without a size it is the usual one."""
    box = np.zeros((len(items), 7))
    classes = card.task.classes
    box[:, 4:] = usual_sizes(classes)[class_ids(class_name, classes)]
    for row, item in enumerate(items):
        box[row, : len(item.translation)] = item.translation
        if item.size is not None:
            width, length, height = item.size
            box[row, 4:] = _numbers([length, width, height])
    rotation = [item.rotation or (1.0, 0.0, 0.0, 0.0) for item in items]
    box[:, 3] = yaw_of(np.array(rotation, dtype=np.float64).reshape(-1, 4))
    return box


def _samples_of(
    item: ForecastObject, form: _Form, name_of: Callable[[int], str], row: int
) -> Any:
    """Return the samples of an object, [k][S][2], empty without a forecast."""
    path = _first(item, form.paths) or []
    if form.frame != "steps" or not path:
        return path
    try:
        return _numbers(path).reshape(_VAD_MODES, -1, 2).cumsum(axis=1)
    except ValueError:
        raise DataError(
            f"{name_of(row)}: {len(path)} numbers in fut_traj, expected x y of as many "
            f"steps in each of {_VAD_MODES} samples"
        ) from None


def _in_scene(places: Floats, box: Floats, pose: LidarPose, form: _Form) -> Floats:
    """Return places [R, K, S, 2] of the objects of a sample in the global frame."""
    if form.frame == "global":
        return places
    if form.frame == "steps":  # offsets from the centre, along the axes of the lidar
        turned = places @ pose[0][:2, :2].T
        return np.asarray(turned + box[:, None, None, :2])
    height = np.broadcast_to(box[:, None, None, 2:3], (*places.shape[:3], 1))
    return to_global(np.concatenate([places, height], axis=-1), pose)[..., :2]


def _log_weights(
    items: Sequence[ForecastObject],
    form: _Form,
    places: Floats,
    name_of: Callable[[int], str],
) -> Floats:
    """Return logarithms of weights [R, K], -inf for a sample that is not there."""
    log_weight = np.full(places.shape[:2], -np.inf)
    for row, item in enumerate(items):
        path = _first(item, form.paths)
        weights = getattr(item, form.weights) if form.weights and path else None
        count = len(path or [0])
        if form.frame == "steps" and path:
            count = _VAD_MODES
        if weights is None:
            log_weight[row, :count] = 0.0
            continue
        if len(weights) != count:
            raise DataError(
                f"{name_of(row)}: {len(weights)} weights in {form.weights}, expected "
                f"one for each of its {count} samples"
            )
        values = _numbers(weights)
        if form.weight_kind == "probability":
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.log(values)
        log_weight[row, :count] = values
    return log_weight


FORMS = {
    name: ForecastForm(RATE_HZ, partial(_open, form)) for name, form in _FORMS.items()
}
