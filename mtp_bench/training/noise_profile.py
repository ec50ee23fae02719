"""Fitting a noise profile to the detections of an env, as a section of a card."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..cards import Card, DetectorSection, changed_card, load_card
from ..detector import Profile
from ..errors import MtpBenchError, UnknownNameError
from ..sources import open_source
from ..types import Scene


def fit_noise(
    env_id: str,
    data: str | None = None,
    scenes: int | None = None,
    changes: dict[str, str] | None = None,
    min_score: Sequence[str] = (),
    alike: Sequence[str] = (),
    name: str | None = None,
    reach: float | None = None,
    field_of_view: float | None = None,
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
) -> str:
    """TOML of a ``[detector]`` section with the noise of the detections of the first ``scenes`` scenes of an env.

    ``changes`` are the env's ``split``, ``detector`` and ``detection_file`` where they are not the card's.
    ``min_score``: operating point, "2.5" or "car=2.5" each. ``alike``: "bus=car" each, for classes with too few
    detections to fit. ``name``: of the profile; the part before its first hyphen tells agents which detector's settings
    suit it. ``reach`` (m) and ``field_of_view`` (degrees) say what part of the truth the detector covers.
    Raises MtpBenchError for whatever the user can mend.
    """
    from ..detector.fit import fit_profile
    from ..detector.sight import Sensor
    from ..detector.profile import profile_text

    card = changed_card(load_card(env_id), **(changes or {}))
    floor = _floor(min_score, card)
    source = open_source(card, data)
    names = source.names[:scenes]
    if started is not None:
        started(len(names))
    given = card.detector or DetectorSection()
    section = given.model_copy(
        update={"reach": reach or given.reach, "field_of_view": field_of_view or given.field_of_view}
    )
    profile = fit_profile(
        _loaded(source.load, names, progress),
        card.task.classes,
        1.0 / card.task.rate,
        Sensor(section.reach, float(np.deg2rad(section.field_of_view))),
        name or f"{card.detector_name.split('-')[0]}-refit",
        f"{card.detector_name or 'detector'} as fitted on {len(names)} scenes of {card.id}",
        f"{card.id}, split {card.source.split}, {card.task.rate:g} Hz",
        floor,
    )
    profile = profile.model_copy(update={"alike": _alike(alike, card, profile)})
    missing = [one for one in card.task.classes if one not in (*profile.classes, *profile.alike)]
    lines = [f"# too few detections to fit: {', '.join(missing)}; --alike names a class whose noise they have"]
    return "\n".join([*(lines if missing else []), _section_text(profile_text(profile), section)])


def _section_text(profile: str, section: DetectorSection) -> str:
    """The text of a profile as the noise of a card's section."""
    head = f"[detector]\nreach = {section.reach}\nfield_of_view = {section.field_of_view}\n\n[detector.noise]\n"
    return head + re.sub(r"^\[", "[detector.noise.", profile, flags=re.MULTILINE)  # headings start a line


def _loaded(
    load: Callable[[str], Scene], names: Sequence[str], progress: Callable[[str], object] | None
) -> Iterator[Scene]:
    for name in names:
        scene = load(name)
        if not scene.truth_complete:
            raise MtpBenchError(
                f"scene {name!r}: only prediction targets are known, so detections of anything else would be fitted as "
                "false positives; fit on an environment with complete truth"
            )
        yield scene
        if progress is not None:
            progress(name)


def _number(text: str) -> float | None:
    """The finite number that ``text`` is, if it is one."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _alike(texts: Sequence[str], card: Card, profile: Profile) -> dict[str, str]:
    """Class of the card and fitted class of each ``--alike`` option."""
    alike: dict[str, str] = {}
    for text in texts:
        name, _, like = text.partition("=")
        if name not in card.task.classes:
            raise UnknownNameError("class of --alike", name, card.task.classes)
        if like not in profile.classes:
            raise UnknownNameError("fitted class of --alike", like, profile.classes)
        if name not in profile.classes:
            alike[name] = like
    return alike


def _floor(texts: Sequence[str], card: Card) -> dict[str, float] | None:
    """Operating point per class of ``--min-score`` options."""
    floor: dict[str, float] = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        if name and name not in card.task.classes:
            raise UnknownNameError("class of --min-score", name, card.task.classes)
        number = _number(value)
        if number is None:
            raise MtpBenchError(f"--min-score is {text!r}, expected a number or class=number")
        floor |= {name: number} if name else dict.fromkeys(card.task.classes, number)
    return floor or None
