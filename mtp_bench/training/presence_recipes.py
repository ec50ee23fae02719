"""From which scenes and features the presence model of each detector is fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..prediction.presence import FEATURES
from ..running.options import RunOptions


@dataclass(frozen=True)
class Scenes:
    """Where rows come from."""

    env: str
    split: str = "train"
    detector: str | None = None  # another one than the card's
    first: int | None = None  # so many scenes; None: all
    without: tuple[str, ...] = ()

    def options(self, options: RunOptions) -> RunOptions:
        """``options`` on these scenes."""
        return replace(options, split=self.split, detector=self.detector, scenes=self.first)


@dataclass(frozen=True)
class Recipe:
    """How the presence of a detector is fitted."""

    scenes: tuple[Scenes, ...]
    features: tuple[str, ...] = tuple(FEATURES)
    products: bool = True
    calibrated: bool = True
    terms: str = ""


_NO_SCORE = ("log_hits", "one_by_hits", "unseen", "coasting", "miss_share", "log_misses")
_SIMULATED = 60  # scenes of each env


def _simulated(*names: str, detector: str | None = None, first: int = _SIMULATED) -> tuple[Scenes, ...]:
    return tuple(Scenes(f"MTP-{name}-v0", "train", detector, first) for name in names)


RECIPES: dict[str, Recipe] = {
    "pointrcnn": Recipe(
        (Scenes("MTP-KITTI-v0"), Scenes("MTP-KITTI-noego-v0"), Scenes("MTP-KITTI-5Hz-v0")),
        terms="figures derived from KITTI: CC BY-NC-SA 3.0, non-commercial",
    ),
    # The truth of trainval holds prediction targets only, so it is mini, with four numbers per class. Its split
    # mini_val stays out. Of the official split val mini_train has two scenes; MTP-nuScenes-v0 ranks on others.
    "megvii": Recipe(
        (Scenes("MTP-nuScenes-mini-v0", "all", without=("scene-0103", "scene-0916")),),
        ("mean_score", "log_hits", "coasting"),
        products=False,
        calibrated=False,
        terms="figures derived from nuScenes: CC BY-NC-SA 4.0, non-commercial",
    ),
    "acf": Recipe(
        (Scenes("MTP-PETS-v0"),),  # two: too few to calibrate on
        ("mean_score", "log_hits", "coasting", "miss_share"),
        products=False,
        calibrated=False,
        terms="figures derived from 3DMOT2015: CC BY-NC-SA 3.0, non-commercial",
    ),
    "wildtrack_mvdet": Recipe(
        (Scenes("MTP-WILDTRACK-v0"),),
        _NO_SCORE,
        products=False,
        terms="figures derived from WILDTRACK: research only",
    ),
    "nuscenes_megvii": Recipe(_simulated("Intersection", "Roundabout")),
    "nuscenes_megvii_raw": Recipe(_simulated("Intersection", "Roundabout", detector="nuscenes_megvii_raw")),
    "nuscenes_centerpoint": Recipe(_simulated("Intersection", "Roundabout", detector="nuscenes_centerpoint")),
    "kitti_pointrcnn": Recipe(_simulated("Merge", "Highway")),
    # On fast roads whatever stands is false, and nobody walks: what is learnt there is wrong in a town.
    "kitti_pointrcnn_raw": Recipe(_simulated("Intersection", detector="kitti_pointrcnn_raw")),
    "clean": Recipe(_simulated("Intersection", "Roundabout", "Merge", "Highway", detector="clean", first=20)),
    "default": Recipe(
        _simulated("Intersection", "Roundabout", "Merge", "Highway", first=20),
        _NO_SCORE,
    ),
}


@dataclass(frozen=True)
class Like:
    """A detector that takes another one's model, with its scores put in place of those of equal rank."""

    detector: str
    scenes: Scenes  # that both detectors saw
    terms: str = ""


LIKE = {
    "centerpoint": Like("megvii", Scenes("MTP-nuScenes-mini-v0", "val"), RECIPES["megvii"].terms),
}
DETECTORS = (*RECIPES, *LIKE)


def scenes_of(detector: str) -> tuple[Scenes, ...]:
    """The scenes that the model of a detector of DETECTORS is made of."""
    if detector in LIKE:
        like = LIKE[detector]
        return tuple(replace(like.scenes, detector=name) for name in (detector, like.detector))
    return RECIPES[detector].scenes
