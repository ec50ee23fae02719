"""Signs that a file of forecasts is read in another way than it was written."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from ..core import Detections, Floats, Ints
from ..sources import StoredForecasts

PRESENT_M = 0.01  # from the box: a step that is the present place
FAR_M = 5.0  # from the box: an object that moves
LOST_M = 20.0  # from the box after one step: another frame of reference
NEAR_M = 1.0  # from a detection; in the wrong frame of reference few objects are
MOVED_M = 3.0  # in a second, of an object whose forecast and track are compared
_MAX_SHARE = 0.5  # of objects with such a fault
_MIN_NEAR = 0.1  # of the surer half of the objects
_PACE = (0.6, 1.6)  # of moves in forecasts, each divided by that of its track
_MIN_COUNT = 100  # of objects or pairs, below which such a sign says nothing
_FRAME_M = 1e6  # between frames, in a search for neighbours


class ForecastSigns:
    """Signs, collected over scenes, of a wrong frame of reference, first step or rate."""

    def __init__(self, rate: float) -> None:
        self._second = round(rate)  # frames
        self._objects = 0
        self._lost = 0
        self._sure = 0
        self._near = 0
        self._moving = 0
        self._present = 0
        self._paces: list[float] = []

    def add(
        self,
        stored: StoredForecasts,
        offset: Floats,
        log_weight: Floats,
        track_id: Ints,
        detections: Detections,
    ) -> None:
        """Take the objects of a scene.

        ``offset`` [R, k, T, 2] m from the box, ``log_weight`` [R, k], ``track_id`` [R],
        -1 for an object without a track.
        """
        rows = np.arange(len(offset))
        move_m = _length(offset[rows, log_weight.argmax(axis=1)])
        first_m = _length(offset[:, :, 0])
        self._objects += len(rows)
        self._lost += int((~(np.fmin.reduce(first_m, axis=1) <= LOST_M)).sum())
        is_moving = move_m[:, -1] > FAR_M
        # the first step of the file, which may be between those of the task
        first = (stored.path[:, :1, :1] - stored.box[:, None, None, :2])[is_moving]
        self._moving += len(first)
        self._present += int((_length(first) < PRESENT_M).sum())
        self._add_places(stored, detections)
        self._add_paces(stored, move_m, track_id)

    def _add_places(self, stored: StoredForecasts, detections: Detections) -> None:
        """Count the surer half of the objects, and those near a detection."""
        is_sure = np.isfinite(stored.box[:, :2]).all(axis=1)
        if not is_sure.any() or not len(detections.box):
            return
        is_sure &= stored.confidence >= np.median(
            np.nan_to_num(stored.confidence[is_sure])
        )
        found = _places(detections.box, detections.frame_of_rows)
        sure = _places(stored.box[is_sure], stored.frame[is_sure])
        distance_m, _ = cKDTree(found).query(sure)
        self._sure += len(sure)
        self._near += int((distance_m < NEAR_M).sum())

    def _add_paces(
        self, stored: StoredForecasts, move_m: Floats, track_id: Ints
    ) -> None:
        """Compare moves [R, T] m in forecasts with those of the tracks in a second."""
        names = zip(track_id.tolist(), stored.frame.tolist(), strict=True)
        row_of = {name: row for row, name in enumerate(names) if name[0] >= 0}
        for (track, frame), row in row_of.items():
            later = row_of.get((track, frame + self._second))
            if later is not None and move_m.shape[1] >= self._second:
                track_m = _length(stored.box[later] - stored.box[row])
                forecast_m = move_m[row, self._second - 1]
                # forecasts that let everything stand say nothing of their rate
                if track_m > MOVED_M and forecast_m > MOVED_M / 3:
                    self._paces.append(float(forecast_m / track_m))

    def problems(self) -> Iterator[str]:
        """Yield what is wrong, the first sign first."""
        if self._lost > _MAX_SHARE * self._objects:
            yield (
                f"{self._lost} of {self._objects} objects are forecast more than "
                f"{LOST_M:g} m away after one step: the places are likely in another "
                "frame of reference than this --form has, or of another --form"
            )
        if self._sure >= _MIN_COUNT and self._near < _MIN_NEAR * self._sure:
            yield (
                f"{self._near} of the {self._sure} surer objects lie within {NEAR_M:g} m "
                "of a detection of the environment: the places are likely in another "
                "frame of reference than that of the scene"
            )
        if self._present > _MAX_SHARE * self._moving:
            yield (
                "the file seems to begin at the present, since the first step of most "
                "moving objects is their present place; expected the place after one "
                "period"
            )
        pace = float(np.median(self._paces or [1]))
        if len(self._paces) >= _MIN_COUNT and not _PACE[0] <= pace <= _PACE[1]:
            yield (
                f"moving objects go {pace:.2f} times as far in their forecasts of a "
                "second as their tracks: the steps are likely at another --rate"
            )


def _length(vector: Floats) -> Floats:
    """Return the lengths of vectors [..., x y ..], of large ones too."""
    return np.asarray(np.hypot(vector[..., 0], vector[..., 1]))


def _places(box: Floats, frame: Ints) -> Floats:
    """Return points [R, 3] m, those of different frames far apart."""
    return np.column_stack([box[:, :2], frame * _FRAME_M])
