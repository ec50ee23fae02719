"""Recordings with real detections, and profiles fitted without the scenes that they are checked on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mtp_bench.cards import load_card, with_detector, with_split
from mtp_bench.detector import Profile, Profile1, load_profile
from mtp_bench.detector.model2.fit import fit_profile
from mtp_bench.detector.profile import profile_text
from mtp_bench.detector.sight import Sensor, Sight, sight, visible_fractions
from mtp_bench.detector.simulate import simulate
from mtp_bench.errors import MtpBenchError
from mtp_bench.sources import open_source
from mtp_bench.types import Scene

NUSCENES: tuple[str, ...] = ("car", "truck", "bus", "trailer", "construction_vehicle", "motorcycle", "bicycle")


@dataclass(frozen=True)
class Recordings:
    """The recordings that a detector was run on."""

    name: str
    env: str
    splits: tuple[str, ...]
    sensor: Sensor
    pooled: dict[str, str]
    first: str  # the profile of model 1
    folds: int
    detector: str | None = None  # another one than the card's

    @property
    def model1(self) -> Profile1:
        """The profile of model 1, whose floors are the operating point of a tracker."""
        profile = load_profile(self.first)
        if not isinstance(profile, Profile1):
            raise MtpBenchError(f"detector profile {self.first!r} is of model {profile.model}, expected one of model 1")
        return profile

    def floors(self, classes: Sequence[str]) -> dict[str, float]:
        """The operating point of a tracker."""
        return {name: self.model1.noise(name).score.floor for name in classes}

    def read(self, data: str | None) -> tuple[tuple[str, ...], list[Scene]]:
        """Classes, and the scenes with what is visible in them."""
        card, scenes = load_card(self.env), []
        if self.detector is not None:
            card = with_detector(card, self.detector)
        for split in self.splits:
            source = open_source(with_split(card, split), data)
            scenes += [source.load(name) for name in source.names]
        known = [replace(one, visible=visible_fractions(one.truth, one.ego)) for one in scenes]
        return card.task.classes, known


_AROUND, _AHEAD = Sensor(60.0, 2 * np.pi), Sensor(80.0, np.pi / 2)
_VEHICLES: dict[str, str] = dict.fromkeys(NUSCENES[1:], "car")
SETS = {
    "nuscenes": Recordings("nuscenes", "MTP-nuScenes-mini-v0", ("all",), _AROUND, _VEHICLES, "v1/nuscenes_megvii", 5),
    "centerpoint": Recordings(
        "centerpoint", "MTP-nuScenes-mini-v0", ("val",), _AROUND, _VEHICLES, "v1/nuscenes_centerpoint", 4, "centerpoint"
    ),
    "kitti": Recordings("kitti", "MTP-KITTI-v0", ("train", "val"), _AHEAD, {}, "v1/kitti_pointrcnn", 3),
}


@dataclass(frozen=True, eq=False)
class Fold:
    """Scenes that are checked, and a profile fitted to all others."""

    scenes: list[Scene]
    sights: list[Sight]
    profile: Profile


def folds(
    recordings: Recordings, classes: Sequence[str], scenes: Sequence[Scene], stored: Path | None
) -> Iterator[Fold]:
    """Each scene is in one fold. Fitted profiles are kept in the folder ``stored`` and taken from there."""
    for number in range(recordings.folds):
        rest = [scene for i, scene in enumerate(scenes) if i % recordings.folds != number]
        held = [scene for i, scene in enumerate(scenes) if i % recordings.folds == number]
        path = None if stored is None else stored / f"{recordings.name}_{number}.toml"
        if path is not None and path.exists():
            profile = load_profile(str(path))
        else:
            profile = fit(recordings, classes, rest)
            if path is not None:
                path.write_text(profile_text(profile), encoding="utf-8")
        assert isinstance(profile, Profile)
        seen = [sight(one.truth, one.ego, recordings.sensor, one.visible) for one in held]
        yield Fold(held, seen, profile)


def fit(recordings: Recordings, classes: Sequence[str], scenes: Sequence[Scene]) -> Profile:
    """The profile of some scenes at all scores."""
    dt = recordings.model1.dt
    return fit_profile(scenes, classes, dt, recordings.sensor, recordings.name, "", "", None, recordings.pooled)


def detected(
    fold: Fold, recordings: Recordings, classes: Sequence[str], profile: Profile | Profile1, seed: int
) -> list[Scene]:
    """The scenes of a fold as the simulated detector sees them."""
    return [
        replace(one, detections=simulate(
            one.truth, one.ego, classes, profile, recordings.sensor, 1000 * seed + i, profile.dt, seen
        ))
        for i, (one, seen) in enumerate(zip(fold.scenes, fold.sights, strict=True))
    ]  # fmt: skip
