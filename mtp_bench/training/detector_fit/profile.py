"""Fit of a whole profile to the detections of known objects."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core import DataError, Scene, long_work
from ...detector import ClassNoise, Profile, Sensor
from .false_positives import fit_false_positives
from .objects import fit_objects
from .quality import NEIGHBOUR_LENGTH_M
from .samples import Samples, collect_samples

MIN_HITS = 100  # detected true boxes that a class needs


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
    """Fit a profile of the detector behind the detections.

    Their truth must be complete. ``dt``: s between frames; ``sensor``: its coverage;
    ``floor``: by class, the least score of the detections that count, without one the
    lowest score that occurs; ``alike``: by class, another class that it is fitted
    together with and whose noise it has. Classes with fewer than 100 detected true
    boxes are left out; DataError if none remains.
    """
    scenes = list(scenes)
    alike = alike or {}
    samples = collect_samples(scenes, classes, sensor, floor, alike)
    noise = _fit_all_objects(samples, floor or {})
    profile = Profile(
        name=name,
        summary=summary,
        source=source,
        dt=dt,
        field_of_view=round(float(np.rad2deg(min(sensor.field_of_view, 2 * np.pi))), 4),
        neighbours=NEIGHBOUR_LENGTH_M,
        classes=noise,
        alike={c: stand_in for c, stand_in in alike.items() if stand_in in noise},
    )
    fitted = [c for c in classes if profile.alike.get(c, c) in noise]
    if len(fitted) < len(classes):
        scenes = [_of_classes(scene, classes, fitted) for scene in scenes]
    complete = {}
    with long_work("fitting false positives by class") as work:
        work.started(len(noise))
        for class_name in noise:
            false_positives = samples[class_name][1]
            complete[class_name] = fit_false_positives(
                scenes, fitted, profile, class_name, false_positives, sensor
            )
            work.done(class_name)
    return profile.model_copy(update={"classes": complete})


def _fit_all_objects(
    samples: Mapping[str, Samples], floor: Mapping[str, float]
) -> dict[str, ClassNoise]:
    """Fit the noise of true objects, of the classes with enough hits."""
    hits = {
        class_name: int(objects.hit.sum())
        for class_name, (objects, _) in samples.items()
    }
    if max(hits.values(), default=0) < MIN_HITS:
        numbers = ", ".join(
            f"{class_name} {count}" for class_name, count in hits.items()
        )
        raise DataError(
            f"no detector profile can be fitted: detections of true boxes: {numbers}; "
            f"expected at least {MIN_HITS} of one class. Give more scenes, or a lower "
            "floor of the scores"
        )
    noise = {}
    with long_work("fitting what the detector reports of objects"):
        for class_name, (objects, false_positives) in samples.items():
            if hits[class_name] < MIN_HITS:
                continue
            lowest = min(
                objects.score[objects.hit].min(),
                false_positives.score.min(initial=np.inf),
            )
            # four digits as in a profile, and not above any score
            lowest = math.floor(1e4 * float(lowest)) / 1e4
            noise[class_name] = fit_objects(objects, floor.get(class_name, lowest))
    return noise


def _of_classes(
    scene: Scene, classes: Sequence[str], kept_names: Sequence[str]
) -> Scene:
    """Return the scene with the true boxes of some classes alone.

    ``kept_names``: some of ``classes``, in their order; they are renumbered from 0.
    """
    class_ids = [classes.index(class_name) for class_name in kept_names]
    rows = np.isin(scene.truth.class_id, class_ids)
    truth = scene.truth.select(rows)
    truth = replace(truth, class_id=np.searchsorted(class_ids, truth.class_id))
    visible = scene.visible
    if visible is not None:
        visible = visible[rows]
    return replace(scene, truth=truth, visible=visible)
