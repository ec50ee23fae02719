"""Noise profiles of model 1 with one kind of noise at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from mtp_bench.detector import Profile1, load_profile
from mtp_bench.detector.simulate import simulate
from mtp_bench.types import Detections, Floats
from tests.support.detector_scenes import AHEAD, DT, nothing

FALSE_POSITIVES: dict[str, Any] = {
    "rate": 2.0,
    "dispersion": 1.0,
    "survive": 0.4,
    "score": 3.0,
    "score_deviation": 0.5,
    "size": (4.0, 1.8, 1.5),
}


def profile1(name: str) -> Profile1:
    """A shipped profile of model 1."""
    profile = load_profile(f"v1/{name}")
    assert isinstance(profile, Profile1)
    return profile


def noisy(**sections: Any) -> Profile1:
    """The clean profile with other noise for cars: entries of a section by name, or a value instead of one."""
    clean = profile1("clean").model_dump()
    car = clean["classes"]["car"]
    for name, change in sections.items():
        car[name] = {**(car[name] or {}), **change} if isinstance(change, dict) else change
    return Profile1.model_validate({**clean, "name": "noisy", "dt": DT, "classes": {"car": car}})


def missing(base: float, lag: float = 0.0, first: float | None = None) -> dict[str, tuple[float, ...]]:
    """The section `miss` without any influence but that of the frame before."""
    begin = base if first is None else first
    return {"first": (begin, 0.0, 0.0, 0.0, 0.0, 0.0), "later": (base, 0.0, 0.0, 0.0, 0.0, 0.0, lag)}


def perfect_with(**changes: Any) -> Profile1:
    """Perfect detections of cars, and false positives."""
    profile = noisy(
        false_positives={**FALSE_POSITIVES, **changes},
        velocity=0.2,
        score={"quadratic": (5.0, 0.0, 0.0), "ceiling": None},
    )
    return profile.model_copy(update={"field_of_view": 90.0})  # that of AHEAD


def in_empty_scene(
    profile: Profile1, frames: int = 4000, seed: int = 0, ego: Floats | None = None, dt: float = DT
) -> Detections:
    """False positives of an empty scene."""
    pose = np.zeros((frames, 4)) if ego is None else ego
    return simulate(nothing(len(pose)), pose, ("car",), profile, AHEAD, seed, dt)
