"""The shipped profile of PointRCNN against PointRCNN itself, on recordings they were fitted to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import load_card
from mtp_bench.detector import Profile, load_profile
from mtp_bench.detector.simulate import simulate
from mtp_bench.detector.variants import with_variant
from mtp_bench.detector.visibility import Sensor, Visibility, visibility_of
from mtp_bench.sources import open_source
from mtp_bench.types import Scene
from tests.support.detector_statistics import ClassStatistics, detector_statistics

pytestmark = pytest.mark.data

CLASSES = ("car", "pedestrian", "cyclist")
AHEAD = Sensor(reach=80.0, field_of_view=np.pi / 2)
SEEDS = range(8)

Table = dict[str, ClassStatistics]
Recorded = list[tuple[Scene, Visibility]]


@pytest.fixture(scope="module")
def shipped() -> Profile:
    return load_profile("kitti_pointrcnn")


@pytest.fixture(scope="module")
def recorded(data_root: Path) -> Recorded:
    source = open_source(load_card("MTP-KITTI-v0"), data_root)
    scenes = [source.load(name) for name in source.names]
    return [(scene, visibility_of(scene.truth, scene.ego, AHEAD)) for scene in scenes]


@pytest.fixture(scope="module")
def real(recorded: Recorded, shipped: Profile) -> Table:
    return detector_statistics((scene for scene, _ in recorded), CLASSES, AHEAD, floor_of(shipped))


@pytest.fixture(scope="module")
def simulated(recorded: Recorded, shipped: Profile) -> Table:
    return pooled(recorded, shipped)


def floor_of(profile: Profile) -> dict[str, float]:
    return {name: noise.quality.floor for name, noise in profile.classes.items()}


def detected(recorded: Recorded, profile: Profile, seed: int) -> list[Scene]:
    return [
        replace(one, detections=simulate(one.truth, one.ego, CLASSES, profile, AHEAD, 1000 * seed + i, profile.dt, see))
        for i, (one, see) in enumerate(recorded)
    ]


def pooled(recorded: Recorded, profile: Profile) -> Table:
    """Statistics over all seeds together."""
    runs = (scene for seed in SEEDS for scene in detected(recorded, profile, seed))
    return detector_statistics(runs, CLASSES, AHEAD)


# What is not met is written down: misses of pedestrians last less than they should; the recordings have only 28
# cyclists, and the profile is fitted to further ones of other recordings.
@pytest.mark.parametrize(
    ("name", "recall", "odds", "gap"),
    [("car", 0.02, 0.15, 0.2), ("pedestrian", 0.03, 0.35, 0.4), ("cyclist", 0.06, 0.35, 0.25)],
)
def test_the_shipped_profile_behaves_as_the_detector(
    name: str, recall: float, odds: float, gap: float, real: Table, simulated: Table
) -> None:
    true, made = real[name], simulated[name]
    assert made.recall == pytest.approx(true.recall, abs=recall)
    assert made.undetected_odds_ratio == pytest.approx(true.undetected_odds_ratio, rel=odds)
    assert made.gap_length == pytest.approx(true.gap_length, rel=gap)
    assert made.radial_autocorrelation == pytest.approx(true.radial_autocorrelation, rel=0.15)
    assert made.tangential_autocorrelation == pytest.approx(true.tangential_autocorrelation, rel=0.15)
    assert made.radial_scale == pytest.approx(true.radial_scale, rel=0.1)
    assert made.tangential_scale == pytest.approx(true.tangential_scale, rel=0.12)
    assert made.score_true == pytest.approx(true.score_true, rel=0.05)


def test_without_memory_the_recall_stays_and_gaps_scatter(
    recorded: Recorded, shipped: Profile, real: Table, simulated: Table
) -> None:
    scattered = detector_statistics(detected(recorded, with_variant(shipped, "iid"), 0), CLASSES, AHEAD)
    for name in CLASSES:
        true, made = real[name], scattered[name]
        assert made.recall == pytest.approx(simulated[name].recall, abs=0.03)
        assert made.gaps > 2 * true.gaps
        assert made.gap_length < 0.65 * true.gap_length
        assert abs(made.radial_autocorrelation) < 0.1
