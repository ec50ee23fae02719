"""Fit of false positives.

Some parameters are counted; the others have simulated figures nearest to the real ones.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from ...core import Bools, Floats, Scene, joined
from ...detector import (
    BESIDE_DISTANCES_M,
    DISTANCE_RANKS,
    SCORE_RANKS,
    SLOTS_PER_BOX,
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
from .samples import FalsePositiveRows, FalsePositiveSamples, nearest_true_boxes

# a false positive this close to a true box of its classes belongs to it
NEAR_DISTANCE_M = 3.0
_FRAME_M = 10.0  # distance that stands for one frame
# a false positive this close in a later frame is the same one
_SAME_PLACE_M = 1.0
_SENSOR_DISTANCE_M = 2.0  # the sensor's own vehicle is nearer
_MIN_DUPLICATES = 20  # for quantiles of their scores
_MIN_SAMPLES = 100  # for a fit of more than the counted parameters
_FADE_S = 1.0  # in which the autoregression decays to 1 / e
_MAX_FRAMES = 100_000  # more than a scene has
_HIGH_RANK = 0.9  # from which scores count as high
# frame period and field of view of the profile, over those of the scenes
_SAME_PERIOD = 1.0
_SAME_VIEW = 1.0
_SEEDS = 2  # simulations per set of parameters
# of a false positive to be visible: lower chances fit as well, but drawing the many
# invisible ones takes long
_MIN_CHANCE = 0.1
_MEDIAN_PAIR_DISTANCE = 1.3  # of two members of a family, over its spread
_SAME_SHARE = 0.08  # of a figure: a difference that counts as 1
_SAME_FIGURE = 0.01  # and in addition
# start values of the unknowns: log-odds or logarithms
_START = {
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
    noise_name: str,
    real: FalsePositiveSamples,
    sensor: Sensor,
) -> ClassNoise:
    """Fit the false positives of a class to the ``real`` ones.

    Returns the whole noise of the class ``noise_name``.
    """
    noise = profile.classes[noise_name]
    of_class = np.array([profile.noise_name(c) == noise_name for c in classes])
    boxes = 0
    for scene in scenes:
        is_covered = covered(scene.truth, scene.ego, sensor)
        boxes += int((is_covered & of_class[scene.truth.class_id]).sum())
    frames = sum(scene.frames for scene in scenes)
    is_near = real.object_distance < NEAR_DISTANCE_M
    near = _count_near(real, is_near, boxes, profile.dt)
    free = _count_free(real, ~is_near, frames, profile.dt)
    noise = noise.model_copy(update={"near": near, "free": free})
    if len(real.score) < _MIN_SAMPLES or near is None or free is None:
        return noise
    return _Simulation(scenes, classes, profile, noise_name, real, sensor).nearest(
        noise
    )


def _count_near(
    real: FalsePositiveSamples, is_near: Bools, boxes: int, dt: float
) -> NearFalsePositives | None:
    """Return parameters of the false positives close to true boxes.

    ``is_near`` [D]: mask of these false positives; ``boxes``: number of true boxes;
    ``dt``: s between frames. None without any. The memory is a start value.
    """
    if not is_near.any() or not boxes:
        return None
    zone = np.digitize(real.object_distance, BESIDE_DISTANCES_M)
    # shares with the class of the true box: on it, beside it, and farther
    first, second, third = (
        round(_share(real.of_class, is_near & (zone == i), default=1.0), 4)
        for i in range(3)
    )
    is_duplicate = is_near & (zone == 0) & real.of_class
    duplicates = None
    if is_duplicate.sum() >= _MIN_DUPLICATES:
        duplicates = _quantiles(real.score[is_duplicate], SCORE_RANKS)
    return NearFalsePositives(
        chance=round(min(float(is_near.sum()) / boxes / SLOTS_PER_BOX, 1.0), 5),
        score=_quantiles(real.score[is_near], SCORE_RANKS),
        offset=_quantiles(real.object_distance[is_near]),
        same=(first, second, third),
        duplicates=duplicates,
        **_memory(lasting=1.0, constant=0.0, dt=dt),
    )


def _count_free(
    real: FalsePositiveSamples, is_free: Bools, frames: int, dt: float
) -> FreeFalsePositives | None:
    """Return parameters of the free false positives.

    ``is_free`` [D]: mask of these false positives; ``frames``: number of frames of all
    scenes, every ``dt`` s. None without any. Chances, lives, families and memory are
    start values.
    """
    if not is_free.any():
        return None
    moment = real.scene[is_free] * _MAX_FRAMES + real.frame[is_free]
    count = np.unique(moment, return_counts=True)[1]
    rate = float(is_free.sum()) / frames
    # variance of the count per frame over its mean
    dispersion = float((count**2).sum()) / frames / rate - rate
    free_place = real.place[is_free]
    pairs = Neighbours.within(
        NEAR_DISTANCE_M, free_place, moment, np.arange(len(free_place))
    )
    distance_m = np.hypot(*(free_place[pairs.row] - free_place[pairs.other]).T)
    spread_m = 1.0
    if len(distance_m):
        spread_m = float(np.median(distance_m)) / _MEDIAN_PAIR_DISTANCE
    length, width, height = rounded(real.size[is_free].mean(axis=0))
    return FreeFalsePositives(
        rate=round(rate, 4),
        dispersion=round(max(dispersion, 1.0), 4),
        chance=0.15,
        survive=0.88,
        siblings=0.4,
        spread=round(spread_m, 3),
        family=0.5,
        size=(length, width, height),
        distance=_quantiles(np.maximum(real.distance[is_free], _SENSOR_DISTANCE_M)),
        score=_quantiles(real.score[is_free], SCORE_RANKS),
        **_memory(lasting=1.0, constant=0.0, dt=dt),
    )


def _quantiles(
    value: Floats, ranks: Sequence[float] | Floats = DISTANCE_RANKS
) -> tuple[float, ...]:
    return rounded(np.quantile(value, ranks))


def _memory(lasting: float, constant: float, dt: float) -> dict[str, float]:
    """Return shares of the variance from log-odds, see `memory_of`."""
    # autoregression between two frames
    phi = float(np.exp(-dt / _FADE_S))
    return memory_of(from_log_odds(lasting), from_log_odds(constant), phi)


def figures_of(rows: FalsePositiveRows, frames: int, high_score: float) -> Floats:
    """Return the compared figures of false positives over ``frames`` frames.

    They are rate and dispersion of free ones; shares that stay for 1 and 4 frames, that
    stand together, and that are close to an object without a high score; and the rate
    of near ones. Scores from ``high_score`` on are strong.
    """
    near = rows.object_distance < NEAR_DISTANCE_M
    free = ~near
    strong = rows.score >= high_score
    every_row = np.ones(len(rows.score), dtype=bool)
    # also where the score of the parent is NaN
    without_parent = ~(rows.parent_score >= high_score)
    lonely = (rows.object_distance < BESIDE_DISTANCES_M[1]) & without_parent
    stays_1 = _has_neighbour(rows, every_row, _SAME_PLACE_M, lag=1)
    stays_4 = _has_neighbour(rows, every_row, _SAME_PLACE_M, lag=4)
    stays_strong = _has_neighbour(rows, strong, _SAME_PLACE_M, lag=1)
    in_company = _has_neighbour(rows, every_row, NEAR_DISTANCE_M)
    in_strong_company = _has_neighbour(rows, strong, NEAR_DISTANCE_M)
    moment = rows.scene * _MAX_FRAMES + rows.frame
    count = np.unique(moment[free], return_counts=True)[1].astype(np.float64)
    rate = free.sum() / frames
    variance = float((count**2).sum()) / frames - rate**2
    return np.array(
        [
            rate,
            variance / max(rate, 1e-9),
            _share(stays_1, free),
            _share(stays_4, free),
            _share(stays_1, near),
            _share(stays_4, near),
            _share(stays_strong, free & strong),
            _share(stays_strong, near & strong),
            _share(in_company, every_row),
            _share(in_strong_company, strong),
            _share(lonely, near & strong),
            near.sum() / frames,
        ]
    )


def _has_neighbour(
    rows: FalsePositiveRows, candidates: Bools, distance_m: float, lag: int = 0
) -> Bools:
    """Return a mask ``[D]`` of rows with a neighbour ``lag`` frames later.

    ``candidates`` ``[D]``: rows that count as neighbours, within ``distance_m``. With
    ``lag`` 0 a row is not its own neighbour.
    """
    if not candidates.any():
        return np.zeros(len(rows.frame), dtype=bool)
    # The third coordinate, in metres, is larger between frames than any distance that
    # counts. Scenes are 20 frames apart, more than any lag.
    scene_length = int(rows.frame.max(initial=0)) + 20.0
    moment = _FRAME_M * (rows.scene * scene_length + rows.frame)
    tree = KDTree(np.column_stack([rows.place, moment])[candidates])
    query = np.column_stack([rows.place, moment + _FRAME_M * lag])
    # two of each, as in its own frame the nearest one is itself
    distances_m, _ = tree.query(query, k=2, distance_upper_bound=distance_m)
    has_one, has_two = np.isfinite(distances_m).T
    if lag == 0:
        has_one = np.where(candidates, has_two, has_one)
    return np.asarray(has_one)


def _share(mask: Bools, among: Bools, default: float = 0.0) -> float:
    if not among.any():
        return default
    return float(mask[among].mean())


class _Simulation:
    """Simulation of the false positives of one class in all scenes."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        classes: Sequence[str],
        profile: Profile,
        name: str,
        real: FalsePositiveSamples,
        sensor: Sensor,
    ) -> None:
        # only the fitted class makes false positives close to objects
        without_near = {
            class_name: noise.model_copy(update={"near": None})
            for class_name, noise in profile.classes.items()
        }
        self.profile = profile.model_copy(update={"classes": without_near})
        self.classes = classes
        self.noise_names = [profile.noise_name(c) for c in classes]
        self.name = name
        self.frames = sum(scene.frames for scene in scenes)
        self.scenes = [
            SensedScene(scene.truth, scene.ego, sensor, _SAME_PERIOD, _SAME_VIEW)
            for scene in scenes
        ]
        self.high_score = float(np.quantile(real.score, _HIGH_RANK))
        self.real_figures = figures_of(real, self.frames, self.high_score)
        # of the objects, by seed and scene
        self.qualities = [
            [self._draw_qualities(scene, sensor, seed) for scene in scenes]
            for seed in range(_SEEDS)
        ]

    def nearest(self, noise: ClassNoise) -> ClassNoise:
        """Return the noise with figures nearest to the real ones.

        The counted parameters are the start.
        """
        dt = self.profile.dt
        best = nearest_parameters(
            lambda unknown: self._simulated_figures(_with_unknown(noise, unknown, dt)),
            self.real_figures,
            _SAME_SHARE * np.abs(self.real_figures) + _SAME_FIGURE,
            np.array(list(_START.values())),
        )
        return _with_unknown(noise, best, dt)

    def _draw_qualities(self, scene: Scene, sensor: Sensor, seed: int) -> Qualities:
        truth = scene.truth
        noise = [self.profile.noise(c) for c in self.classes]
        grid = truth_grid(truth, noise, _SAME_PERIOD)
        place = truth.box[:, :2]
        neighbours = truth_neighbours(grid, place, self.profile.neighbours)
        visibility = visibility_of(truth, scene.ego, sensor, scene.visible)
        return draw_qualities(grid, visibility, neighbours, Draws(seed))

    def _simulated_figures(self, noise: ClassNoise) -> Floats:
        """Return mean figures of simulated false positives over seeds."""
        profile = self.profile.model_copy(
            update={"classes": {**self.profile.classes, self.name: noise}}
        )
        class_noise = [profile.noise(c) for c in self.classes]
        figures = []
        for seed, qualities in enumerate(self.qualities):
            parts = [
                self._simulate(class_noise, noise, number, seed, scene_qualities)
                for number, scene_qualities in enumerate(qualities)
            ]
            figures.append(figures_of(joined(parts), self.frames, self.high_score))
        return np.asarray(np.mean(figures, axis=0))

    def _simulate(
        self,
        class_noise: Sequence[ClassNoise],
        noise: ClassNoise,
        scene_number: int,
        seed: int,
        qualities: Qualities,
    ) -> FalsePositiveRows:
        """Draw the false positives of a scene.

        ``class_noise``: that of each class; ``noise``: that of the fitted class;
        ``qualities``: of the objects.
        """
        scene = self.scenes[scene_number]
        truth = scene.truth
        draw_seed = 1000 * seed + scene_number
        similar = classes_of_same_noise(truth, self.noise_names)
        grid = truth_grid(truth, class_noise, _SAME_PERIOD)
        parts = [near_false_positives(grid, scene, qualities, similar, draw_seed)]
        reported = reported_classes(
            truth, self.classes, self.noise_names, self.name, noise
        )
        if reported is not None:
            parts.append(free_false_positives(noise, reported, scene, 0, draw_seed))
        detected = detect_false_positives(parts, scene)
        of_class = np.array(self.noise_names)[truth.class_id] == self.name
        nearest_row, object_distance = nearest_true_boxes(
            truth, of_class, detected.frame, detected.box
        )
        # the last value is that of frames without a true box
        score = np.where(qualities.reported, qualities.score, -np.inf)
        score = np.append(score, -np.inf)
        return FalsePositiveRows(
            scene=np.full(len(detected.frame), scene_number),
            frame=detected.frame,
            place=detected.box[:, :2],
            score=detected.score,
            object_distance=object_distance,
            parent_score=score[nearest_row],
        )


def _with_unknown(noise: ClassNoise, unknown: Floats, dt: float) -> ClassNoise:
    """Return the noise with values of the unknowns, in the order of `_START`."""
    assert noise.near is not None
    assert noise.free is not None
    value_by_name = dict(zip(_START, unknown.tolist(), strict=True))
    factor = {name: float(np.exp(log)) for name, log in value_by_name.items()}
    chance = _MIN_CHANCE + (1.0 - _MIN_CHANCE) * from_log_odds(value_by_name["chance"])
    extra_dispersion = max(noise.free.dispersion - 1.0, 0.05) * factor["dispersion"]
    free_update = {
        "chance": round(chance, 4),
        "survive": round(from_log_odds(value_by_name["survive"]), 4),
        "siblings": round(factor["siblings"], 4),
        "family": round(from_log_odds(value_by_name["family"]), 4),
        "rate": round(noise.free.rate * factor["rate"], 4),
        "dispersion": round(1.0 + extra_dispersion, 4),
        **_memory(value_by_name["lasting"], value_by_name["constant"], dt),
    }
    near_update = {
        "chance": round(min(noise.near.chance * factor["near_rate"], 1.0), 5),
        "parent": round(float(np.tanh(value_by_name["parent"])), 4),
        **_memory(value_by_name["near_lasting"], value_by_name["near_constant"], dt),
    }
    near = noise.near.model_copy(update=near_update)
    free = noise.free.model_copy(update=free_update)
    return noise.model_copy(update={"near": near, "free": free})
