"""The noise profile of a real detector, fitted to its detections of known objects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ...errors import DataError
from ...types import Scene
from ..profile import ClassNoise, Profile
from ..sight import Sensor
from .errors import fit_heading, fit_height, fit_position, fit_size, fit_velocity
from .samples import RADIAL, TANGENTIAL, FalsePositiveSamples, ObjectSamples, collect
from .scores import fit_false_positives, fit_score
from .undetected import fit_undetected

LEAST_HITS = 100  # detections of true boxes that a class needs to be fitted


def fit_profile(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    dt: float,
    sensor: Sensor,
    name: str,
    summary: str,
    source: str,
    floor: Mapping[str, float] | None = None,
) -> Profile:
    """The profile of the detector that made the detections of ``scenes``, for the classes with enough data.

    ``dt`` is the frame period in seconds, ``floor`` the operating point per class: detections with a lower score are
    not used; without one the lowest score that occurs becomes it. Classes with fewer than 100 detections of true
    boxes are left out of the profile; DataError if none remains.
    """
    samples = collect(scenes, classes, sensor, floor)
    enough = [one for one in classes if samples[one][0].hit.sum() >= LEAST_HITS]
    if not enough:
        hits = ", ".join(f"{one} {int(samples[one][0].hit.sum())}" for one in classes)
        raise DataError(
            f"no detector profile can be fitted: detections of true boxes: {hits}; expected at least {LEAST_HITS} of "
            "one class. Give more scenes, or a lower floor of the scores"
        )
    noise = {one: _fit_class(*samples[one], None if floor is None else floor.get(one)) for one in enough}
    return Profile(
        name=name,
        summary=summary,
        source=source,
        dt=dt,
        field_of_view=round(float(np.rad2deg(min(sensor.field_of_view, 2 * np.pi))), 4),
        classes=noise,
    )


def _fit_class(objects: ObjectSamples, false: FalsePositiveSamples, floor: float | None) -> ClassNoise:
    hits = int(objects.hit.sum())
    lowest = min(objects.score[objects.hit].min(), false.score.min(initial=float("inf")))
    score = fit_score(objects, math.floor(1e4 * float(lowest)) / 1e4 if floor is None else floor)
    return ClassNoise(
        miss=fit_undetected(objects),
        radial=fit_position(objects, RADIAL),
        tangential=fit_position(objects, TANGENTIAL),
        heading=fit_heading(objects),
        size=fit_size(objects),
        score=score,
        false_positives=fit_false_positives(false, score),
        velocity=fit_velocity(objects),
        z=fit_height(objects),
        duplicates=round(min(float(false.duplicate.sum()) / hits, 1.0), 4),
    )
