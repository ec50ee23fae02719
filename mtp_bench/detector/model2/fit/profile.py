"""The profile of model 2 of a real detector, fitted to its detections of known objects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ....errors import DataError
from ....types import Scene
from ...fit.samples import Samples, collect
from ...sight import Sensor
from ..profile import ClassNoise, Profile
from .ghosts import fit_ghosts
from .objects import fit_objects
from .quality import LENGTH

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
    alike: Mapping[str, str] | None = None,
) -> Profile:
    """The profile of the detector that made the detections of ``scenes``, for the classes with enough data.

    ``sensor`` is what the detector can see, ``name``, ``summary`` and ``source`` are texts of the profile.
    ``dt`` is the frame period in seconds. ``floor``: least score per class that is used; without one the lowest that
    occurs. ``alike``: classes, and the class that they are fitted together with, whose noise they have. Classes with
    fewer than 100 detections of true boxes are left out; DataError if none remains.
    """
    scenes, alike = list(scenes), dict(alike or {})
    samples = collect(scenes, classes, sensor, floor, pooled=alike)
    enough = [one for one in samples if samples[one][0].hit.sum() >= LEAST_HITS]
    if not enough:
        hits = ", ".join(f"{one} {int(samples[one][0].hit.sum())}" for one in samples)
        raise DataError(
            f"no detector profile can be fitted: detections of true boxes: {hits}; expected at least {LEAST_HITS} of "
            "one class. Give more scenes, or a lower floor of the scores"
        )
    noise = {one: fit_objects(samples[one][0], _least(samples[one], one, floor)) for one in enough}
    profile = Profile(
        model=2,
        name=name,
        summary=summary,
        source=source,
        dt=dt,
        field_of_view=round(float(np.rad2deg(min(sensor.field_of_view, 2 * np.pi))), 4),
        neighbours=LENGTH,
        classes=noise,
        alike={one: own for one, own in alike.items() if own in noise},
    )
    return profile.model_copy(update={"classes": _with_ghosts(scenes, classes, profile, samples, sensor)})


def _least(samples: Samples, name: str, floor: Mapping[str, float] | None) -> float:
    """The operating point of a class."""
    if floor is not None and name in floor:
        return floor[name]
    objects, false = samples
    return math.floor(1e4 * float(min(objects.score[objects.hit].min(), false.score.min(initial=np.inf)))) / 1e4


def _with_ghosts(
    scenes: Sequence[Scene], classes: Sequence[str], profile: Profile, samples: Mapping[str, Samples], sensor: Sensor
) -> dict[str, ClassNoise]:
    """The noise of all classes with their false positives."""
    known = [name for name in classes if profile.alike.get(name, name) in profile.classes]
    if len(known) < len(classes):  # what has no noise takes no part
        ids = [classes.index(name) for name in known]
        scenes = [_of_classes(scene, ids) for scene in scenes]
    return {name: fit_ghosts(scenes, known, profile, name, samples[name][1], sensor) for name in profile.classes}


def _of_classes(scene: Scene, ids: Sequence[int]) -> Scene:
    """The scene with the true boxes of some classes ``ids``, ascending, numbered anew."""
    kept = np.isin(scene.truth.class_id, ids)
    truth = scene.truth.those(kept)
    truth = replace(truth, class_id=np.searchsorted(ids, truth.class_id))
    return replace(scene, truth=truth, visible=None if scene.visible is None else scene.visible[kept])
