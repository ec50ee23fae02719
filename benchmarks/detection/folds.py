"""Recordings with real detections, and profiles fitted without the scenes that they are checked on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mtp_bench.cards import load_card, with_detector, with_split
from mtp_bench.core import Scene
from mtp_bench.detector import Profile, load_profile
from mtp_bench.detector.profile_file import profile_text
from mtp_bench.detector.simulation import simulate
from mtp_bench.detector.visibility import (
    Sensor,
    Visibility,
    visibility_of,
    visible_fractions,
)
from mtp_bench.sources import open_source
from mtp_bench.training.detector_fit.profile import fit_profile

NUSCENES: tuple[str, ...] = (
    "car",
    "truck",
    "bus",
    "trailer",
    "construction_vehicle",
    "motorcycle",
    "bicycle",
)


@dataclass(frozen=True)
class Recordings:
    """Scenes with the detections of one detector."""

    name: str
    env: str
    splits: tuple[str, ...]
    sensor: Sensor
    pooled: dict[str, str]
    shipped: str  # profile with the operating point of a tracker
    folds: int
    detector: str | None = None  # another one than the card's

    def floors(self, classes: Sequence[str]) -> dict[str, float]:
        """Least scores per class at the operating point of a tracker."""
        profile = load_profile(self.shipped)
        return {name: profile.noise(name).quality.floor for name in classes}

    def read(self, data: str | None) -> tuple[tuple[str, ...], list[Scene]]:
        """Classes, and the scenes with what is visible in them."""
        card, scenes = load_card(self.env), []
        if self.detector is not None:
            card = with_detector(card, self.detector)
        for split in self.splits:
            source = open_source(with_split(card, split), data)
            scenes += [source.load(name) for name in source.names]
        known = [
            replace(one, visible=visible_fractions(one.truth, one.ego))
            for one in scenes
        ]
        return card.task.classes, known


_AROUND, _AHEAD = Sensor(60.0, 2 * np.pi), Sensor(80.0, np.pi / 2)
_VEHICLES: dict[str, str] = dict.fromkeys(NUSCENES[1:], "car")
SETS = {
    "nuscenes": Recordings(
        "nuscenes",
        "MTP-nuScenes-mini-v0",
        ("all",),
        _AROUND,
        _VEHICLES,
        "nuscenes_megvii",
        5,
    ),
    "centerpoint": Recordings(
        "centerpoint",
        "MTP-nuScenes-mini-v0",
        ("val",),
        _AROUND,
        _VEHICLES,
        "nuscenes_centerpoint",
        4,
        "centerpoint",
    ),
    "kitti": Recordings(
        "kitti", "MTP-KITTI-v0", ("train", "val"), _AHEAD, {}, "kitti_pointrcnn", 3
    ),
}


@dataclass(frozen=True, eq=False)
class Fold:
    """Scenes that are checked, and a profile fitted to all others."""

    scenes: list[Scene]
    visibilities: list[Visibility]
    profile: Profile


def folds(
    recordings: Recordings,
    classes: Sequence[str],
    scenes: Sequence[Scene],
    stored: Path | None,
) -> Iterator[Fold]:
    """Each scene is in one fold. Fitted profiles are kept in the folder ``stored`` and taken from there."""
    for number in range(recordings.folds):
        rest = [
            scene for i, scene in enumerate(scenes) if i % recordings.folds != number
        ]
        held = [
            scene for i, scene in enumerate(scenes) if i % recordings.folds == number
        ]
        path = None if stored is None else stored / f"{recordings.name}_{number}.toml"
        if path is not None and path.exists():
            profile = load_profile(str(path))
        else:
            profile = fit(recordings, classes, rest)
            if path is not None:
                path.write_text(profile_text(profile), encoding="utf-8")
        seen = [
            visibility_of(one.truth, one.ego, recordings.sensor, one.visible)
            for one in held
        ]
        yield Fold(held, seen, profile)


def fit(
    recordings: Recordings, classes: Sequence[str], scenes: Sequence[Scene]
) -> Profile:
    """The profile of some scenes at all scores."""
    dt = load_profile(recordings.shipped).dt
    return fit_profile(
        scenes,
        classes,
        dt,
        recordings.sensor,
        recordings.name,
        "",
        "",
        None,
        recordings.pooled,
    )


def detected(
    fold: Fold, recordings: Recordings, classes: Sequence[str], seed: int
) -> list[Scene]:
    """The scenes of a fold with the detections of its profile."""
    profile, sensor, scenes = fold.profile, recordings.sensor, []
    for i, (scene, visibility) in enumerate(
        zip(fold.scenes, fold.visibilities, strict=True)
    ):
        args = (
            scene.truth,
            scene.ego,
            classes,
            profile,
            sensor,
            1000 * seed + i,
            profile.dt,
            visibility,
        )
        scenes.append(replace(scene, detections=simulate(*args)))
    return scenes
