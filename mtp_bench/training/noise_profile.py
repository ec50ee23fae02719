"""Fit of a noise profile to the detections of an env, as a section of a card."""

import math
import re
from collections.abc import Sequence

import numpy as np

from ..cards import Card, DetectorSection
from ..core import MtpBenchError, Scene, require_known
from ..running import DEFAULTS, RunOptions
from ..sources import in_world
from .split import open_split


def fit_noise(
    env_id: str,
    options: RunOptions = DEFAULTS,
    min_score: Sequence[str] = (),
    alike: Sequence[str] = (),
    name: str | None = None,
    reach: float | None = None,
    field_of_view: float | None = None,
) -> str:
    """Return TOML of a ``[detector]`` section with fitted noise.

    It is the noise of the detections of an env, by id or path of its card. ``options``:
    data, scenes, changes of the card and progress. ``min_score``: operating points,
    "2.5" for all classes or "car=2.5". ``alike``: texts "bus=car", a class, and the
    class that it is fitted together with and whose noise it has. ``name``: of the
    profile; agents choose their settings by the part before its first hyphen.
    ``reach``: of the detector, m; ``field_of_view``: around its heading, degrees; None:
    as in the card.

    Raises MtpBenchError for wrong options, incomplete truth and too few detections.
    """
    from ..detector import Sensor, profile_text
    from .detector_fit import fit_profile

    split = open_split(env_id, options)
    card = split.card
    classes = card.task.classes
    floor = _floor(min_score, card)
    section = card.detector or DetectorSection(field_of_view=card.source.traits.view)
    reach = reach or section.reach
    field_of_view = field_of_view or section.field_of_view
    detector = card.detector_name
    profile = fit_profile(
        map(_complete_scene, split.scenes()),
        classes,
        dt=1.0 / card.task.rate,
        sensor=Sensor(reach, float(np.deg2rad(field_of_view))),
        name=name or f"{detector.split('-')[0]}-refit",
        summary=f"{detector or 'detector'} as fitted on {len(split.names)} scenes of "
        f"{card.id}",
        source=f"{card.id}, split {card.source.split}, {card.task.rate:g} Hz",
        floor=floor,
        alike=_stand_ins(alike, card),
    )
    lines = []
    missing = [c for c in classes if c not in (*profile.classes, *profile.alike)]
    if missing:
        lines.append(
            f"# too few detections to fit: {', '.join(missing)}; "
            "--alike names a class whose noise they have"
        )
    text = profile_text(profile)
    # headings of the profile's tables start a line
    nested = re.sub(r"^\[", "[detector.noise.", text, flags=re.MULTILINE)
    lines += ["[detector]", f"reach = {reach}", f"field_of_view = {field_of_view}", ""]
    return "\n".join([*lines, "[detector.noise]", nested])


def _complete_scene(scene: Scene) -> Scene:
    """Return the scene in the world's frame, if it has world poses.

    Raises MtpBenchError if its truth is not complete.
    """
    if scene.truth_complete and len(scene.annotated_frames) == scene.frames:
        return in_world(scene)  # objects at rest move in the frames of a moving sensor
    raise MtpBenchError(
        f"scene {scene.name!r} has the truth of prediction targets or of some frames "
        "only, so other detections would be fitted as false positives; fit on an "
        "environment with complete truth"
    )


def _stand_ins(texts: Sequence[str], card: Card) -> dict[str, str]:
    """Return the fitted class by class, as the ``--alike`` options state them."""
    stand_ins = {}
    for text in texts:
        class_name, _, fitted_name = text.partition("=")
        require_known("class of --alike", class_name, card.task.classes)
        require_known("fitted class of --alike", fitted_name, card.task.classes)
        stand_ins[class_name] = fitted_name
    return stand_ins


def _floor(texts: Sequence[str], card: Card) -> dict[str, float]:
    """Return the operating point by class, as the ``--min-score`` options state it."""
    floor: dict[str, float] = {}
    for text in texts:
        class_name, _, value = text.rpartition("=")
        if class_name:  # else the number is for all classes
            require_known("class of --min-score", class_name, card.task.classes)
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise MtpBenchError(
                f"--min-score is {text!r}, expected a number or class=number"
            )
        names = (class_name,) if class_name else card.task.classes
        floor |= dict.fromkeys(names, number)
    return floor
