"""Fit of a whole profile to the detections of known objects."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core import DataError, Scene, long_work
from ...detector import Profile, Sensor
from .false_positives import fit_false_positives
from .objects import fit_objects
from .quality import NEIGHBOUR_LENGTH
from .samples import collect_samples

LEAST_HITS = 100  # detected true boxes that a class needs


def fit_profile(
    scenes: Iterable[Scene],
    classes: Sequence[str],
    dt: float,
    sensor: Sensor,
    name: str,
    summary: str,
    source: str,
    floor: Mapping[str, float] | None = None,
    alike: Mapping[str, str] | None = None,
) -> Profile:
    """Fit a profile of the detector that made the detections of ``scenes``, whose truth must be complete.

    ``dt``: s between frames; ``sensor``: its coverage; ``floor``: least score per class of the detections that count,
    without one the lowest score that occurs; ``alike``: classes, and the class that they are fitted together with and
    whose noise they have. Classes with fewer than 100 detected true boxes are left out; DataError if none remains.
    """
    scenes = list(scenes)
    alike = dict(alike or {})
    samples = collect_samples(scenes, classes, sensor, floor, alike)
    fitted = [one for one in samples if samples[one][0].hit.sum() >= LEAST_HITS]
    if not fitted:
        hits = ", ".join(f"{one} {int(samples[one][0].hit.sum())}" for one in samples)
        raise DataError(
            f"no detector profile can be fitted: detections of true boxes: {hits}; expected at least {LEAST_HITS} of "
            "one class. Give more scenes, or a lower floor of the scores"
        )
    noise = {}
    with long_work("fitting what the detector reports of objects"):
        for one in fitted:
            objects, false = samples[one]
            lowest = min(
                objects.score[objects.hit].min(), false.score.min(initial=np.inf)
            )
            noise[one] = fit_objects(
                objects, (floor or {}).get(one, math.floor(1e4 * float(lowest)) / 1e4)
            )
    profile = Profile(
        name=name,
        summary=summary,
        source=source,
        dt=dt,
        field_of_view=round(float(np.rad2deg(min(sensor.field_of_view, 2 * np.pi))), 4),
        neighbours=NEIGHBOUR_LENGTH,
        classes=noise,
        alike={one: other for one, other in alike.items() if other in noise},
    )
    known = [one for one in classes if profile.alike.get(one, one) in profile.classes]
    if len(known) < len(classes):
        scenes = [
            _of_classes(scene, [classes.index(one) for one in known])
            for scene in scenes
        ]
    complete = {}
    with long_work("fitting false positives by class") as work:
        work.started(len(profile.classes))
        for one in profile.classes:
            complete[one] = fit_false_positives(
                scenes, known, profile, one, samples[one][1], sensor
            )
            work.done(one)
    return profile.model_copy(update={"classes": complete})


def _of_classes(scene: Scene, ids: Sequence[int]) -> Scene:
    """The scene with the true boxes of the classes ``ids`` alone, ascending, renumbered from 0."""
    kept = np.isin(scene.truth.class_id, ids)
    truth = scene.truth.select(kept)
    truth = replace(truth, class_id=np.searchsorted(ids, truth.class_id))
    return replace(
        scene,
        truth=truth,
        visible=None if scene.visible is None else scene.visible[kept],
    )
