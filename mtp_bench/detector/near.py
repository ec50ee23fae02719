"""False positives beside true boxes, which they follow: duplicates, shadows, boxes of a wrong class."""

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from ..geometry import rotate
from ..types import Bools, Floats, Ints, Truth
from .draws import Component, Draws, NoiseKind, NoiseSubject, exponential, keys_of, skewed
from .errors import draw_errors
from .false_positives import DetectedRows, SensedScene, detect_false_positives, spread_sizes
from .grid import Grid
from .profile import SLOTS, ClassNoise, NearFalsePositives
from .quality import Qualities, best_ranks, score_by_rank

BESIDE = 0.75, 1.5  # m from the object's centre, where the chance to have the object's class changes

_NONE = NearFalsePositives(
    bias=0, ar=0, phi=0, white=1, chance=1e-12, score=(0.0,) * 11, offset=(0.0,) * 11, same=(1, 1, 1)
)


def near_false_positives(
    grid: Grid, scene: SensedScene, qualities: Qualities, similar: Sequence[Ints], seed: int
) -> DetectedRows:
    """Detections of the false positives beside the true boxes of a scene.

    ``grid`` and ``qualities``: of the true boxes; ``similar``: see `classes_of_same_noise`. A duplicate appears only
    beside a detected object.
    """
    draws, slot = Draws(seed, NoiseSubject.NEAR), np.arange(SLOTS)
    slots = replace(  # the places beside every true box, each treated as an object
        grid,
        ids=(grid.ids[:, None] * SLOTS + slot).ravel(),
        frame=np.repeat(grid.frame, SLOTS),
        column=(grid.column[:, None] * SLOTS + slot).ravel(),
        noise_number=np.repeat(grid.noise_number, SLOTS),
        lives=None if grid.lives is None else (np.repeat(grid.lives[0], SLOTS), np.repeat(grid.lives[1], SLOTS)),
    )
    row = np.repeat(np.arange(len(grid.frame)), SLOTS)
    visible, rank = _visible(slots, qualities.random[row], draws)
    every, slots, row = slots, slots.select(visible), row[visible]
    true_class, offset = scene.truth.class_id[row], _offsets(slots, draws)
    class_id = _classes(slots, true_class, offset, similar, draws)
    score = _scores(slots, rank, (class_id == true_class) & (offset < BESIDE[0]))
    without_object = (class_id == true_class) & (offset < BESIDE[1]) & ~qualities.detected[row]
    floor = slots.of_rows(lambda noise: noise.quality.floor)
    reported = np.flatnonzero(~without_object & (score >= floor))
    slots, row = slots.select(reported), row[reported]
    box = _boxes(slots, scene.truth.box[row], offset[reported], draws)
    velocity = scene.truth.velocity[row]
    candidates = DetectedRows(slots.frame, box, velocity, class_id[reported], score[reported])
    return detect_false_positives(draw_errors(every, None, draws, visible[reported]), candidates, scene)


def classes_of_same_noise(truth: Truth, noise_names: Sequence[str]) -> list[Ints]:
    """For every class the others with the same of ``noise_names``, the most frequent ones of the scene first."""
    boxes = np.bincount(truth.class_id, minlength=len(noise_names))
    order = np.argsort(-boxes, kind="stable")
    names = np.array(noise_names)
    return [order[(names[order] == names[k]) & (order != k)] for k in range(len(names))]


def _parameters(noise: ClassNoise) -> NearFalsePositives:
    return _NONE if noise.near is None else noise.near


def _visible(slots: Grid, object_quality: Floats, draws: Draws) -> tuple[Ints, Floats]:
    """Visible rows, and the ranks of their quality among those."""
    memory = attrgetter("bias", "ar", "phi", "parent")
    bias, ar, phi, parent = slots.of_objects(lambda noise: memory(_parameters(noise))).T
    ar, parent = (ar / np.maximum(1 - bias, 1e-12))[slots.column], parent[slots.column]
    new = draws.normal(NoiseKind.QUALITY, Component.WHITE, slots.row_keys)
    series = slots.autoregression(phi, draws, NoiseKind.QUALITY)
    normal = np.sqrt(ar) * series + np.sqrt(1 - ar) * new
    normal = parent * object_quality + np.sqrt(1 - parent**2) * normal
    positive = exponential(draws.normal(NoiseKind.QUALITY, Component.BIAS, slots.object_keys))
    quality = skewed(normal, positive[slots.column], bias[slots.column])
    rank = np.full(len(quality), np.nan)
    for noise, rows in slots.by_noise():
        index, own_rank = best_ranks(quality[rows], _parameters(noise).bias, _parameters(noise).chance)
        rank[rows[index]] = own_rank
    visible = np.flatnonzero(np.isfinite(rank))
    return visible, rank[visible]


def _offsets(slots: Grid, draws: Draws) -> Floats:
    """Distances from the objects' centres ``[R]`` m."""
    offset = draws.uniform(NoiseKind.PLACE, Component.BIAS, slots.object_keys)[slots.column]
    for noise, rows in slots.by_noise():
        quantiles = _parameters(noise).offset
        offset[rows] = np.interp(offset[rows], np.linspace(0.0, 1.0, len(quantiles)), quantiles)
    return offset


def _scores(slots: Grid, rank: Floats, duplicate: Bools) -> Floats:
    """Scores ``[R]`` by ranks; duplicates may have their own distribution."""
    score = np.zeros(len(rank))
    for noise, rows in slots.by_noise():
        quantiles, duplicates = _parameters(noise).score, _parameters(noise).duplicates
        score[rows] = score_by_rank(rank[rows], quantiles)
        if duplicates is not None:
            score[rows] = np.where(duplicate[rows], score_by_rank(rank[rows], duplicates), score[rows])
    return score


def _boxes(slots: Grid, true: Floats, offset: Floats, draws: Draws) -> Floats:
    """Boxes ``[R, 7]`` at the distances ``offset`` from ``true`` boxes, on the same ground; they turn with them."""
    angle = 2 * np.pi * draws.uniform(NoiseKind.PLACE, Component.OTHER, slots.object_keys)[slots.column]
    box = np.array(true, dtype=np.float64)
    box[:, :2] += rotate(offset[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1), true[:, 3])
    keys = keys_of(slots.object_keys[:, None], np.arange(3)[None, :])
    box[:, 4:] = spread_sizes(box[:, 4:], draws.normal(NoiseKind.SIZE, Component.OTHER, keys)[slots.column])
    box[:, 2] += (box[:, 6] - true[:, 6]) / 2
    return box


def _classes(slots: Grid, true_class: Ints, offset: Floats, similar: Sequence[Ints], draws: Draws) -> Ints:
    """Classes ``[R]``: that of the object, or another one with the same noise."""
    zone = np.digitize(offset, BESIDE)
    same = slots.of_rows(lambda noise: _parameters(noise).same)[np.arange(len(offset)), zone]
    wrong = draws.uniform(NoiseKind.CLASS, Component.BIAS, slots.object_keys)[slots.column] >= same
    uniform = draws.uniform(NoiseKind.CLASS, Component.OTHER, slots.object_keys)[slots.column]
    class_id = np.array(true_class)
    for k, others in enumerate(similar):
        rows = np.flatnonzero(wrong & (true_class == k))
        if len(others):
            class_id[rows] = others[np.floor(uniform[rows] ** 2 * len(others)).astype(np.int64)]
    return class_id
