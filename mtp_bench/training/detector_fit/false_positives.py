"""Fit of false positives: counted parameters, and those whose simulated figures are nearest to the real ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ...core import Bools, Floats, Ints, Scene, joined
from ...detector import (
    BESIDE,
    EVEN_RANKS,
    RANKS,
    SLOTS,
    ClassNoise,
    Draws,
    FreeFalsePositives,
    NearFalsePositives,
    Neighbours,
    Profile,
    Qualities,
    SensedScene,
    Sensor,
    classes_of_same_noise,
    covered,
    detect_false_positives,
    draw_qualities,
    free_false_positives,
    near_false_positives,
    reported_classes,
    truth_grid,
    truth_neighbours,
    visibility_of,
)
from .quality import from_log_odds, memory_of, nearest_parameters, rounded
from .samples import FalsePositiveSamples, nearest_true_boxes

NEAR = 3.0  # m: a false positive this near to a true box of its classes belongs to it
_SAME_PLACE = 1.0  # m: a false positive this near in a later frame is the same one
_FEW_DUPLICATES = 20  # for quantiles of their scores
_FEW = 100  # least false positives for a fit of more than the counted parameters
_NEAREST = 2.0  # m: the sensor's own vehicle is nearer
_FADES = 1.0  # s in which the autoregression decays to 1 / e
_FRAMES = 100_000  # more than a scene has
_HIGH = 0.9  # rank from which scores count as high
_SEEDS = 2  # simulations per set of parameters
_LEAST = 0.1  # chance to be visible: lower ones fit as well, but drawing the many invisible ones takes long
_UNKNOWNS = {  # with their start values: log-odds or logarithms
    "chance": -1.7,
    "survive": 2.0,
    "lasting": 1.0,
    "constant": 0.0,
    "near_lasting": 1.0,
    "near_constant": 0.0,
    "siblings": -0.9,
    "family": 0.0,
    "parent": 0.0,
    "rate": 0.0,
    "dispersion": 0.0,
    "near_rate": 0.0,
}


def fit_false_positives(
    scenes: Sequence[Scene],
    classes: Sequence[str],
    profile: Profile,
    name: str,
    real: FalsePositiveSamples,
    sensor: Sensor,
) -> ClassNoise:
    """Fit the false positives of the class ``name`` to the ``real`` ones; returns its whole noise."""
    noise = profile.classes[name]
    of_class = np.array([profile.noise_name(other) == name for other in classes])
    boxes = sum(
        int((covered(s.truth, s.ego, sensor) & of_class[s.truth.class_id]).sum())
        for s in scenes
    )
    near_rows = real.beside < NEAR
    near = _count_near(real, near_rows, boxes, profile.dt)
    free = _count_free(
        real, ~near_rows, sum(scene.frames for scene in scenes), profile.dt
    )
    if len(real.score) >= _FEW and near is not None and free is not None:
        near, free = _FalsePositiveSimulation(
            scenes, classes, profile, name, real, sensor
        ).nearest(near, free)
    return noise.model_copy(update={"near": near, "free": free})


def _count_near(
    real: FalsePositiveSamples, near: Bools, boxes: int, dt: float
) -> NearFalsePositives | None:
    """Parameters of the false positives ``near`` true boxes, ``boxes`` in number; None without any.

    ``dt``: s between frames. The memory is a start value.
    """
    if not near.any() or not boxes:
        return None
    zone = np.digitize(real.beside, BESIDE)
    rows = [near & (zone == number) for number in range(3)]
    first, second, third = (
        round(float(real.of_class[row].mean()) if row.any() else 1.0, 4) for row in rows
    )
    duplicates = rows[0] & real.of_class
    return NearFalsePositives(
        chance=round(min(float(near.sum()) / boxes / SLOTS, 1.0), 5),
        score=_quantiles(real.score[near], RANKS),
        offset=_quantiles(real.beside[near]),
        same=(first, second, third),
        duplicates=_quantiles(real.score[duplicates], RANKS)
        if duplicates.sum() >= _FEW_DUPLICATES
        else None,
        **_memory(1.0, 0.0, dt),
    )


def _count_free(
    real: FalsePositiveSamples, free: Bools, frames: int, dt: float
) -> FreeFalsePositives | None:
    """Parameters of the ``free`` false positives over ``frames`` frames of ``dt`` s; None without any.

    Chances, lives, families and memory are start values.
    """
    if not free.any():
        return None
    moment = real.scene[free] * _FRAMES + real.frame[free]
    count = np.unique(moment, return_counts=True)[1]
    rate = float(free.sum()) / frames
    place = real.place[free]
    pairs = Neighbours.within(NEAR, place, moment, np.arange(len(place)))
    distance = np.hypot(*(place[pairs.row] - place[pairs.other]).T)
    length, width, height = (
        round(float(side), 4) for side in real.size[free].mean(axis=0)
    )
    return FreeFalsePositives(
        rate=round(rate, 4),
        dispersion=round(max(float((count**2).sum()) / frames / rate - rate, 1.0), 4),
        chance=0.15,
        survive=0.88,
        siblings=0.4,
        spread=round(float(np.median(distance)) / 1.3 if len(distance) else 1.0, 3),
        family=0.5,
        size=(length, width, height),
        distance=_quantiles(np.maximum(real.distance[free], _NEAREST)),
        score=_quantiles(real.score[free], RANKS),
        **_memory(1.0, 0.0, dt),
    )


def _quantiles(
    value: Floats, share: Sequence[float] | Floats = EVEN_RANKS
) -> tuple[float, ...]:
    return rounded(np.quantile(value, share))


def _memory(lasting: float, constant: float, dt: float) -> dict[str, float]:
    """Shares of the variance from the log-odds of the lasting share, and of the constant share of that."""
    return memory_of(
        from_log_odds(lasting), from_log_odds(constant), float(np.exp(-dt / _FADES))
    )


@dataclass(frozen=True, eq=False)
class VisibleFalsePositives:
    """False positives of a class over scenes, real or simulated."""

    scene: Ints  # [D]
    frame: Ints  # [D]
    place: Floats  # [D, 2] m
    score: Floats  # [D]
    beside: Floats  # [D] m to the nearest true box of its classes
    parent: Floats  # [D] score of that box' own detection; NaN or -inf where it is undetected

    def figures(self, frames: int, high: float) -> Floats:
        """Compared figures over ``frames`` frames; scores from ``high`` on count as high.

        Rate and dispersion of free ones, shares that stay for 1 and 4 frames, stand together, are beside an object
        without a high score; rate of near ones.
        """
        near = self.beside < NEAR
        strong = self.score >= high
        everyone = np.ones(len(self.score), dtype=bool)
        alone = (self.beside < BESIDE[1]) & ~(self.parent >= high)
        first, fourth = (self._any_within(_SAME_PLACE, lag, everyone) for lag in (1, 4))
        again = self._any_within(_SAME_PLACE, 1, strong)
        count = np.unique(
            self.scene[~near] * _FRAMES + self.frame[~near], return_counts=True
        )[1]
        rate = (~near).sum() / frames
        return np.array(
            [
                rate,
                (float((count.astype(np.float64) ** 2).sum()) / frames - rate**2)
                / max(rate, 1e-9),
                *(
                    _share(stays, kind)
                    for kind in (~near, near)
                    for stays in (first, fourth)
                ),
                *(_share(again, kind & strong) for kind in (~near, near)),
                _share(self._any_within(NEAR, 0, everyone), everyone),
                _share(self._any_within(NEAR, 0, strong), strong),
                _share(alone, near & strong),
                near.sum() / frames,
            ]
        )

    def _any_within(self, distance: float, lag: int, by: Bools) -> Bools:
        """Mask of those with another one of ``by`` within ``distance`` m, ``lag`` frames later ``[D]``."""
        if not by.any():
            return np.zeros(len(self.frame), dtype=bool)
        # the third coordinate separates frames, and scenes even more
        moment = 10.0 * (
            self.scene * (int(self.frame.max(initial=0)) + 20.0) + self.frame
        )
        targets = np.column_stack([self.place, moment])[by]
        query = np.column_stack([self.place, moment + 10.0 * lag])
        # two of each, as in its own frame the nearest one is itself
        nearest = np.isfinite(
            KDTree(targets).query(query, k=2, distance_upper_bound=distance)[0]
        )
        return np.asarray(
            np.where(by, nearest[:, 1], nearest[:, 0]) if lag == 0 else nearest[:, 0]
        )


def _share(yes: Bools, among: Bools) -> float:
    return float(yes[among].mean()) if among.any() else 0.0


class _FalsePositiveSimulation:
    """Simulated false positives of a class in all scenes, and the figures of the real ones."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        classes: Sequence[str],
        profile: Profile,
        name: str,
        real: FalsePositiveSamples,
        sensor: Sensor,
    ) -> None:
        others = {
            key: noise.model_copy(update={"near": None})
            for key, noise in profile.classes.items()
        }
        self.profile = profile.model_copy(update={"classes": others})
        self.classes = classes
        self.name = name
        self.frames = sum(scene.frames for scene in scenes)
        self.scenes = [
            SensedScene(scene.truth, scene.ego, sensor, 1.0, 1.0) for scene in scenes
        ]
        self.noise_names = [profile.noise_name(other) for other in classes]
        self.high = float(np.quantile(real.score, _HIGH))
        found = VisibleFalsePositives(
            real.scene, real.frame, real.place, real.score, real.beside, real.parent
        )
        self.real = found.figures(self.frames, self.high)
        visible = [scene.visible for scene in scenes]
        self.qualities = [
            [
                self._qualities(*each, seed)
                for each in zip(self.scenes, visible, strict=True)
            ]
            for seed in range(_SEEDS)
        ]

    def nearest(
        self, near: NearFalsePositives, free: FreeFalsePositives
    ) -> tuple[NearFalsePositives, FreeFalsePositives]:
        """Parameters with figures nearest to the real ones, from counted ones as a start."""
        scale = 0.08 * np.abs(self.real) + 0.01
        start = np.array(list(_UNKNOWNS.values()))
        dt = self.profile.dt
        unknown = nearest_parameters(
            lambda x: self._figures(*_parameters(near, free, x, dt)),
            self.real,
            scale,
            start,
        )
        return _parameters(near, free, unknown, dt)

    def _qualities(
        self, scene: SensedScene, visible: Floats | None, seed: int
    ) -> Qualities:
        grid = truth_grid(
            scene.truth, [self.profile.noise(name) for name in self.classes], 1.0
        )
        neighbours = truth_neighbours(
            grid, scene.truth.box[:, :2], self.profile.neighbours
        )
        seen = visibility_of(scene.truth, scene.ego, scene.sensor, visible)
        return draw_qualities(grid, seen, neighbours, Draws(seed))

    def _figures(self, near: NearFalsePositives, free: FreeFalsePositives) -> Floats:
        """Mean figures of simulated false positives over seeds."""
        noise = self.profile.classes[self.name].model_copy(
            update={"near": near, "free": free}
        )
        profile = self.profile.model_copy(
            update={"classes": {**self.profile.classes, self.name: noise}}
        )
        figures = []
        for seed in range(_SEEDS):
            found = joined(
                [
                    self._simulated(profile, number, seed)
                    for number in range(len(self.scenes))
                ]
            )
            figures.append(found.figures(self.frames, self.high))
        return np.asarray(np.mean(figures, axis=0))

    def _simulated(
        self, profile: Profile, number: int, seed: int
    ) -> VisibleFalsePositives:
        scene = self.scenes[number]
        qualities = self.qualities[seed][number]
        noise = profile.classes[self.name]
        truth = scene.truth
        draw = 1000 * seed + number
        similar = classes_of_same_noise(truth, self.noise_names)
        grid = truth_grid(truth, [profile.noise(name) for name in self.classes], 1.0)
        parts = [near_false_positives(grid, scene, qualities, similar, draw)]
        reported = reported_classes(
            truth, self.classes, self.noise_names, self.name, noise
        )
        if reported is not None:
            parts.append(free_false_positives(noise, reported, scene, 0, draw))
        found = detect_false_positives(parts, scene)
        of_class = np.array(self.noise_names)[truth.class_id] == self.name
        nearest, beside = nearest_true_boxes(truth, of_class, found.frame, found.box)
        parent = np.append(
            np.where(qualities.reported, qualities.score, -np.inf), -np.inf
        )[nearest]
        scenes = np.full(len(found.frame), number)
        return VisibleFalsePositives(
            scenes, found.frame, found.box[:, :2], found.score, beside, parent
        )


def _parameters(
    near: NearFalsePositives, free: FreeFalsePositives, unknown: Floats, dt: float
) -> tuple[NearFalsePositives, FreeFalsePositives]:
    """Parameters with the values of `_UNKNOWNS`, in its order."""
    value = dict(zip(_UNKNOWNS, unknown.tolist(), strict=True))
    factor = {
        name: float(np.exp(value[name]))
        for name in ("siblings", "rate", "dispersion", "near_rate")
    }
    free_update = {
        "chance": round(_LEAST + (1.0 - _LEAST) * from_log_odds(value["chance"]), 4),
        "survive": round(from_log_odds(value["survive"]), 4),
        "siblings": round(factor["siblings"], 4),
        "family": round(from_log_odds(value["family"]), 4),
        "rate": round(free.rate * factor["rate"], 4),
        "dispersion": round(
            1.0 + max(free.dispersion - 1.0, 0.05) * factor["dispersion"], 4
        ),
        **_memory(value["lasting"], value["constant"], dt),
    }
    near_update = {
        "chance": round(min(near.chance * factor["near_rate"], 1.0), 5),
        "parent": round(float(np.tanh(value["parent"])), 4),
        **_memory(value["near_lasting"], value["near_constant"], dt),
    }
    return near.model_copy(update=near_update), free.model_copy(update=free_update)
