"""False positives, fitted by simulation: the parameters whose figures are those of the real ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....types import Floats, Scene, joined
from ...fit.samples import FalsePositiveSamples, nearest_true
from ...rows import Rows
from ...sight import Sensor, Sight, covered, sight
from ...surroundings import Surroundings, labels_of
from ..draws import Draws, grid_of, neighbours_in
from ..free import free_ghosts
from ..near import BESIDE, classes_alike, near_ghosts
from ..profile import ClassNoise, Profile
from ..quality import Qualities, qualities
from .ghost_figures import NEAR, Seen, figures
from .ghost_start import first_free, first_near, memory_of
from .search import nearest, odds

_HIGH = 0.9  # rank of the scores that count as high
_FEW = 100  # false positives of a kind from which more than its rate is fitted
_SEEDS = 2  # runs that one set of parameters is judged by
_ROUNDS = 5
_LEAST = 0.1  # chance to be seen: lower ones fit as well, but many that are never seen take long to draw


@dataclass(frozen=True, eq=False)
class _Stage:
    """A scene in which false positives are simulated."""

    around: Surroundings
    sight: Sight


def fit_ghosts(
    scenes: Sequence[Scene], classes: Sequence[str], profile: Profile, own: str, real: FalsePositiveSamples,
    sensor: Sensor,
) -> ClassNoise:  # fmt: skip
    """The noise of class ``own`` of the profile with its false positives ``real``."""
    noise = profile.classes[own]
    of_own = np.array([profile.noise_name(name) == own for name in classes])
    boxes = sum(int((covered(scene.truth, scene.ego, sensor) & of_own[scene.truth.class_id]).sum()) for scene in scenes)
    frames = sum(scene.frames for scene in scenes)
    near = np.asarray(real.beside < NEAR)
    start = noise.model_copy(
        update={
            "near": first_near(real, near, boxes, profile.dt),
            "free": first_free(real, ~near, frames, profile.dt),
        }
    )
    if len(real.score) < _FEW or start.near is None or start.free is None:
        return start
    return _Fit(scenes, classes, profile, own, real, sensor, start).best()


class _Fit:
    """The search: unknowns as log-odds, the figures of simulated false positives, those of the real ones."""

    names = (
        "chance", "survive", "lasting", "constant", "near_lasting", "near_constant", "siblings", "family", "parent",
        "rate", "dispersion", "near_rate",
    )  # fmt: skip

    def __init__(
        self, scenes: Sequence[Scene], classes: Sequence[str], profile: Profile, own: str,
        real: FalsePositiveSamples, sensor: Sensor, start: ClassNoise,
    ) -> None:  # fmt: skip
        self.classes, self.profile, self.own, self.start = classes, profile, own, start
        self.frames = sum(scene.frames for scene in scenes)
        self.stages = [_stage(scene, sensor) for scene in scenes]
        self.high = float(np.quantile(real.score, _HIGH))
        self.names_of_noise = [profile.noise_name(name) for name in classes]
        near = np.asarray(real.beside < NEAR)
        alone = ~(real.parent >= self.high)
        seen = Seen(real.scene, real.frame, real.place, real.score, near, alone & (real.beside < BESIDE[1]))
        self.real = np.append(figures(seen, self.frames, self.high), near.sum() / self.frames)
        self.qualities = [self._qualities(stage, seed) for seed in range(_SEEDS) for stage in self.stages]

    def best(self) -> ClassNoise:
        """The noise whose figures are nearest to the real ones."""
        start = np.array([-1.7, 2.0, 1.0, 0.0, 1.0, 0.0, -0.9, 0.0, 0.0, 0.0, 0.0, 0.0])
        scale = 0.08 * np.abs(self.real) + 0.01
        return self.noise(nearest(lambda x: self.simulated(self.noise(x)), self.real, scale, start, _ROUNDS))

    def noise(self, unknown: Floats) -> ClassNoise:
        """Parameters of unknowns."""
        value = dict(zip(self.names, (float(one) for one in unknown), strict=True))
        free, near = self.start.free, self.start.near
        assert free is not None
        assert near is not None
        free = free.model_copy(
            update={
                "chance": round(_LEAST + (1.0 - _LEAST) * odds(value["chance"]), 4),
                "survive": round(odds(value["survive"]), 4),
                "siblings": round(float(np.exp(value["siblings"])), 4),
                "family": round(odds(value["family"]), 4),
                "rate": round(free.rate * float(np.exp(value["rate"])), 4),
                "dispersion": round(1.0 + max(free.dispersion - 1.0, 0.05) * float(np.exp(value["dispersion"])), 4),
                **memory_of(value["lasting"], value["constant"], self.profile.dt),
            }
        )
        near = near.model_copy(
            update={
                "chance": round(min(near.chance * float(np.exp(value["near_rate"])), 1.0), 5),
                "parent": round(float(np.tanh(value["parent"])), 4),
                **memory_of(value["near_lasting"], value["near_constant"], self.profile.dt),
            }
        )
        return self.start.model_copy(update={"free": free, "near": near})

    def simulated(self, noise: ClassNoise) -> Floats:
        """Figures of simulated false positives."""
        classes = {name: one.model_copy(update={"near": None}) for name, one in self.profile.classes.items()}
        profile = self.profile.model_copy(update={"classes": {**classes, self.own: noise}})
        made = []
        for seed in range(_SEEDS):
            seen = joined([self._scene(profile, stage, i, seed) for i, stage in enumerate(self.stages)])
            made.append(np.append(figures(seen, self.frames, self.high), seen.near.sum() / self.frames))
        return np.asarray(np.mean(made, axis=0))

    def _qualities(self, stage: _Stage, seed: int) -> Qualities:
        """Qualities of the true objects."""
        truth = stage.around.truth
        grid = grid_of(truth, [self.profile.noise(name) for name in self.classes], 1.0)
        near = neighbours_in(grid, truth.box[:, :2], self.profile.neighbours)
        return qualities(grid, stage.sight, near, Draws(seed))

    def _scene(self, profile: Profile, stage: _Stage, number: int, seed: int) -> Seen:
        known = self.qualities[seed * len(self.stages) + number]
        truth = stage.around.truth
        alike = classes_alike(truth, self.names_of_noise)
        grid = grid_of(truth, [profile.noise(name) for name in self.classes], 1.0)
        rows = [near_ghosts(grid, stage.around, known, alike, 1000 * seed + number)]
        noise = profile.classes[self.own]
        assert noise.free is not None
        labels = labels_of(truth, self.classes, self.names_of_noise, self.own, noise.free.size)
        if labels is not None:
            rows.append(free_ghosts(noise, labels, stage.around, 0, 1000 * seed + number))
        score = np.where(known.reported, known.score, -np.inf)
        return self._seen(joined(rows), stage, score, number)

    def _seen(self, found: Rows, stage: _Stage, score: Floats, number: int) -> Seen:
        truth = stage.around.truth
        of_own = np.array(self.names_of_noise)[truth.class_id] == self.own
        nearest, beside = nearest_true(truth, of_own, found.frame, found.box)
        parent = np.append(score, -np.inf)[nearest]
        alone = (beside < BESIDE[1]) & ~(parent >= self.high)
        scene = np.full(len(found.frame), number)
        return Seen(scene, found.frame, found.box[:, :2], found.score, np.asarray(beside < NEAR), alone)


def _stage(scene: Scene, sensor: Sensor) -> _Stage:
    around = Surroundings(scene.truth, scene.ego, sensor, 1.0, 1.0)
    return _Stage(around, sight(scene.truth, scene.ego, sensor, scene.visible))
