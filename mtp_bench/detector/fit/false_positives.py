"""Fit of false positives by simulation: the parameters whose figures are nearest to the real ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Floats, Scene, joined
from ..draws import Draws
from ..false_positives import DetectedRows, SensedScene, reported_classes
from ..free import free_false_positives
from ..grid import truth_grid, truth_neighbours
from ..near import BESIDE, classes_of_same_noise, near_false_positives
from ..profile import ClassNoise, FreeFalsePositives, NearFalsePositives, Profile
from ..quality import Qualities, draw_qualities
from ..visibility import Sensor, covered, visibility_of
from .counts import NEAR, VisibleFalsePositives, count_free, count_near, memory_from_log_odds
from .samples import FalsePositiveSamples, nearest_true_boxes
from .search import from_log_odds, nearest_parameters

_HIGH = 0.9  # rank from which scores count as high
_FEW = 100  # least false positives for a fit of more than the counted parameters
_SEEDS = 2  # simulations per set of parameters
_ROUNDS = 5
_LEAST = 0.1  # chance to be visible: lower ones fit as well, but drawing the many invisible ones takes long
_UNKNOWNS = {  # with their start values: log-odds or logarithms
    "chance": -1.7, "survive": 2.0, "lasting": 1.0, "constant": 0.0, "near_lasting": 1.0, "near_constant": 0.0,
    "siblings": -0.9, "family": 0.0, "parent": 0.0, "rate": 0.0, "dispersion": 0.0, "near_rate": 0.0,
}  # fmt: skip


def fit_false_positives(
    scenes: Sequence[Scene], classes: Sequence[str], profile: Profile, name: str, real: FalsePositiveSamples,
    sensor: Sensor,
) -> ClassNoise:  # fmt: skip
    """Fit the false positives of the class ``name`` to the ``real`` ones; returns its whole noise."""
    noise = profile.classes[name]
    of_class = np.array([profile.noise_name(other) == name for other in classes])
    boxes = 0
    for scene in scenes:
        boxes += int((covered(scene.truth, scene.ego, sensor) & of_class[scene.truth.class_id]).sum())
    near_rows = np.asarray(real.beside < NEAR)
    near = count_near(real, near_rows, boxes, profile.dt)
    free = count_free(real, ~near_rows, sum(scene.frames for scene in scenes), profile.dt)
    if len(real.score) >= _FEW and near is not None and free is not None:
        simulation = _FalsePositiveSimulation(scenes, classes, profile, name, real, sensor)
        near, free = simulation.nearest(near, free)
    return noise.model_copy(update={"near": near, "free": free})


class _FalsePositiveSimulation:
    """Simulated false positives of a class in all scenes, and the figures of the real ones."""

    def __init__(
        self, scenes: Sequence[Scene], classes: Sequence[str], profile: Profile, name: str,
        real: FalsePositiveSamples, sensor: Sensor,
    ) -> None:  # fmt: skip
        others = {key: noise.model_copy(update={"near": None}) for key, noise in profile.classes.items()}
        self.profile = profile.model_copy(update={"classes": others})
        self.classes, self.name = classes, name
        self.frames = sum(scene.frames for scene in scenes)
        self.scenes = [SensedScene(scene.truth, scene.ego, sensor, 1.0, 1.0) for scene in scenes]
        self.noise_names = [profile.noise_name(other) for other in classes]
        self.high = float(np.quantile(real.score, _HIGH))
        alone = ~(real.parent >= self.high) & (real.beside < BESIDE[1])
        near = np.asarray(real.beside < NEAR)
        found = VisibleFalsePositives(real.scene, real.frame, real.place, real.score, near, alone)
        self.real = found.figures(self.frames, self.high)
        self.qualities = [
            self._qualities(sensed, scene.visible, seed)
            for seed in range(_SEEDS)
            for sensed, scene in zip(self.scenes, scenes, strict=True)
        ]

    def nearest(
        self, near: NearFalsePositives, free: FreeFalsePositives
    ) -> tuple[NearFalsePositives, FreeFalsePositives]:
        """Parameters with figures nearest to the real ones, from counted ones as a start."""
        scale = 0.08 * np.abs(self.real) + 0.01
        start = np.array(list(_UNKNOWNS.values()))
        dt = self.profile.dt
        unknown = nearest_parameters(
            lambda x: self._figures(*_parameters(near, free, x, dt)), self.real, scale, start, _ROUNDS
        )
        return _parameters(near, free, unknown, dt)

    def _qualities(self, scene: SensedScene, visible: Floats | None, seed: int) -> Qualities:
        truth = scene.truth
        grid = truth_grid(truth, [self.profile.noise(name) for name in self.classes], 1.0)
        neighbours = truth_neighbours(grid, truth.box[:, :2], self.profile.neighbours)
        visibility = visibility_of(truth, scene.ego, scene.sensor, visible)
        return draw_qualities(grid, visibility, neighbours, Draws(seed))

    def _figures(self, near: NearFalsePositives, free: FreeFalsePositives) -> Floats:
        """Mean figures of simulated false positives over seeds."""
        noise = self.profile.classes[self.name].model_copy(update={"near": near, "free": free})
        profile = self.profile.model_copy(update={"classes": {**self.profile.classes, self.name: noise}})
        figures = []
        for seed in range(_SEEDS):
            found = joined([self._simulated(profile, number, seed) for number in range(len(self.scenes))])
            figures.append(found.figures(self.frames, self.high))
        return np.asarray(np.mean(figures, axis=0))

    def _simulated(self, profile: Profile, number: int, seed: int) -> VisibleFalsePositives:
        """Simulated false positives of one scene."""
        scene = self.scenes[number]
        qualities = self.qualities[seed * len(self.scenes) + number]
        similar = classes_of_same_noise(scene.truth, self.noise_names)
        grid = truth_grid(scene.truth, [profile.noise(name) for name in self.classes], 1.0)
        rows = [near_false_positives(grid, scene, qualities, similar, 1000 * seed + number)]
        noise = profile.classes[self.name]
        assert noise.free is not None
        reported = reported_classes(scene.truth, self.classes, self.noise_names, self.name, noise.free.size)
        if reported is not None:
            rows.append(free_false_positives(noise, reported, scene, 0, 1000 * seed + number))
        score = np.where(qualities.reported, qualities.score, -np.inf)
        return self._beside_objects(joined(rows), scene, score, number)

    def _beside_objects(
        self, detected: DetectedRows, scene: SensedScene, score: Floats, number: int
    ) -> VisibleFalsePositives:
        of_class = np.array(self.noise_names)[scene.truth.class_id] == self.name
        nearest, beside = nearest_true_boxes(scene.truth, of_class, detected.frame, detected.box)
        parent = np.append(score, -np.inf)[nearest]
        alone = (beside < BESIDE[1]) & ~(parent >= self.high)
        scenes = np.full(len(detected.frame), number)
        near = np.asarray(beside < NEAR)
        return VisibleFalsePositives(scenes, detected.frame, detected.box[:, :2], detected.score, near, alone)


def _parameters(
    near: NearFalsePositives, free: FreeFalsePositives, unknown: Floats, dt: float
) -> tuple[NearFalsePositives, FreeFalsePositives]:
    """Parameters with the values of `_UNKNOWNS`, in its order."""
    value = dict(zip(_UNKNOWNS, unknown.tolist(), strict=True))
    factor = {name: float(np.exp(value[name])) for name in ("siblings", "rate", "dispersion", "near_rate")}
    free_update = {
        "chance": round(_LEAST + (1.0 - _LEAST) * from_log_odds(value["chance"]), 4),
        "survive": round(from_log_odds(value["survive"]), 4),
        "siblings": round(factor["siblings"], 4),
        "family": round(from_log_odds(value["family"]), 4),
        "rate": round(free.rate * factor["rate"], 4),
        "dispersion": round(1.0 + max(free.dispersion - 1.0, 0.05) * factor["dispersion"], 4),
        **memory_from_log_odds(value["lasting"], value["constant"], dt),
    }
    near_update = {
        "chance": round(min(near.chance * factor["near_rate"], 1.0), 5),
        "parent": round(float(np.tanh(value["parent"])), 4),
        **memory_from_log_odds(value["near_lasting"], value["near_constant"], dt),
    }
    return near.model_copy(update=near_update), free.model_copy(update=free_update)
