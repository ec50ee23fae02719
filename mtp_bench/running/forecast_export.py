"""Export of the forecasts of a stored run: MFEval's and UniAD's forms, and tables."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core import CardError, Ints, Rollout, long_work, new_folder, to_metres
from ..scoring import columns_to_rows, match, near_truth
from ..sources import (
    BOX_COLUMNS,
    NuScenes,
    lidar_pose,
    submission_box,
    table_path,
    to_lidar,
    write_table,
)
from .official import require_nuscenes
from .stored import OpenedRun
from .track_export import Sample, stated_tracks, write_results

ForecastForm = Literal["mfeval", "uniad", "table"]
_CLASSES = {
    "mfeval": ("car", "truck", "bus"),
    "uniad": ("car", "truck", "bus", "trailer", "pedestrian", "motorcycle", "bicycle"),
}
_MOST_SAMPLES = {"uniad": 6}
_DECIMALS = 4  # of places, m


def export_forecasts(
    opened: OpenedRun, path: Path, form: ForecastForm | None = None
) -> tuple[int, int]:
    """Write the forecasts of a run, and return the objects written and left out.

    ``form``: "mfeval" or "uniad", a .json file of nuScenes, or "table", a folder with a
    .parquet for each scene. None: as the name fits. A form
    leaves out objects of other classes than its own. Raises CardError if the card or
    the name does not fit the form, and MtpBenchError for a folder that is not empty.
    """
    card = opened.card
    rollouts = opened.run.rollouts
    form = form or ("mfeval" if path.suffix == ".json" else "table")
    if (form == "table") == (path.suffix == ".json"):
        raise CardError(
            f"{path}: the form is {form}; expected a .json file for mfeval or uniad, "
            "a folder for table"
        )
    objects = sum(len(rollout.object_box) for rollout in rollouts)
    with long_work("exporting forecasts"):
        if form != "table":
            require_nuscenes(card)
            written = write_results(path.absolute(), _samples(opened, form))
            return written, objects - written
        with new_folder(path.absolute()) as folder:
            for rollout in rollouts:
                file = table_path(folder, rollout.scene).with_suffix(".parquet")
                write_table(file, _table(rollout, opened))
    return objects, 0


def _samples(opened: OpenedRun, form: str) -> Iterator[Sample]:
    """Yield token and objects of each sample."""
    tables = NuScenes(opened.card, opened.data).tables
    for rollout in opened.run.rollouts:
        class_name = np.array(opened.card.task.classes)[rollout.object_class].tolist()
        identity = _identities(rollout, opened).tolist()
        score = rollout.object_confidence.tolist()
        for t, token in enumerate(tables.sample_tokens(rollout.scene)):
            pose = lidar_pose(tables, token)
            rows = rollout.objects.rows(t)
            objects: list[dict[str, Any]] = []
            for row in range(rows.start, rows.stop):
                name = class_name[row]
                if name not in _CLASSES[form]:
                    continue
                box = rollout.object_box[row].astype(np.float64)
                weight = np.exp(rollout.forecast_log_weight[row])
                # the heaviest first, without absent ones
                modes = np.argsort(-weight, kind="stable")[: np.count_nonzero(weight)]
                modes = modes[: _MOST_SAMPLES.get(form)]
                weight = weight[modes] / weight[modes].sum()
                place = box[:2] + to_metres(rollout.forecast[row, modes])
                if form == "mfeval":
                    forecast = {
                        "sample_token": token,
                        "class_name": name,
                        "translation": box[:2].tolist(),
                        "traj": place.round(_DECIMALS).tolist(),
                        "traj_prob": weight.tolist(),
                    }
                else:
                    # at the height of the box
                    lidar_place = to_lidar(np.insert(place, 2, box[2], axis=-1), pose)
                    track = str(identity[row])
                    forecast = submission_box(
                        token, box, np.zeros(2), name, track, score[row]
                    )
                    forecast |= {
                        "detection_name": name,
                        "attribute_name": "",
                        "predict_traj": lidar_place[..., :2].round(_DECIMALS).tolist(),
                        "predict_traj_score": np.log(weight).tolist(),
                    }
                forecast["detection_score"] = score[row]
                objects.append(forecast)
            yield token, objects


def _table(rollout: Rollout, opened: OpenedRun) -> dict[str, NDArray[Any]]:
    """Return the columns of the table of a scene, a row per object and sample."""
    weight = np.exp(rollout.forecast_log_weight)
    row, sample = np.nonzero(weight)
    frame = rollout.objects.frame_of_rows[row]
    box = rollout.object_box[row].astype(np.float64)
    columns = {
        "frame": frame,
        "class": np.array(opened.card.task.classes)[rollout.object_class[row]],
        **dict(zip(BOX_COLUMNS, box.T, strict=True)),
        "object": row - rollout.object_start[frame],
        "id": _identities(rollout, opened)[row],
        "confidence": rollout.object_confidence[row],
        "mode": sample,
        "weight": weight[row, sample],
    }
    if not len(rollout.track_id):
        del columns["id"]
    place = box[:, None, :2] + to_metres(rollout.forecast[row, sample])
    for step, (x, y) in enumerate(place.transpose(1, 2, 0), start=1):
        columns[f"x{step}"] = x
        columns[f"y{step}"] = y
    return columns


def _identities(rollout: Rollout, opened: OpenedRun) -> Ints:
    """Return the track [S] of each object, and a new number for one without.

    It is the nearest of the heaviest hypothesis within the forecast gate.
    """
    tracks = stated_tracks(rollout, opened.recorded(rollout.scene), opened.card)
    frame = rollout.objects.frame_of_rows
    pairs = near_truth(
        tracks, frame, rollout.object_box, rollout.object_class, opened.card
    )
    track_row = columns_to_rows(match(pairs, len(tracks.box)), len(frame))
    # an object without a track has the number -1, and takes the last value
    first_new = tracks.object_id.max(initial=-1) + 1
    track_id = np.append(tracks.object_id, first_new)[track_row]
    return np.where(track_row >= 0, track_id, first_new + np.arange(len(frame)))
