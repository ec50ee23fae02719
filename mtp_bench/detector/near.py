"""False positives beside true boxes, which they follow: duplicates, shadows, boxes of a wrong class."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import Bools, Floats, Ints, Truth, rotate, unit_vectors
from .draws import Component, Draws, NoiseKind, NoiseSubject, exponential, parts, skewed
from .errors import BoxErrors, draw_errors, of_axes
from .false_positives import DetectedRows, SensedScene, spread_sizes
from .grid import Grid
from .profile import EVEN_RANKS, SLOTS, ClassNoise, NearFalsePositives
from .quality import Qualities, best_ranks, score_by_rank

BESIDE = (
    0.75,
    1.5,
)  # m from the object's centre, where the chance to have the object's class changes
_PLACE = (
    *parts(Component.BIAS, NoiseKind.PLACE),
    *parts(Component.OTHER, NoiseKind.PLACE),
)
_PLACE += (
    *parts(Component.BIAS, NoiseKind.CLASS),
    *parts(Component.OTHER, NoiseKind.CLASS),
)
_NONE = NearFalsePositives(
    bias=0,
    ar=0,
    phi=0,
    white=1,
    chance=1e-12,
    score=(0.0,) * 11,
    offset=(0.0,) * 11,
    same=(1, 1, 1),
)


def near_false_positives(
    grid: Grid,
    scene: SensedScene,
    qualities: Qualities,
    similar: Sequence[Ints],
    seed: int,
) -> tuple[BoxErrors, DetectedRows]:
    """Visible false positives beside the true boxes of a scene, with their errors.

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
        lives=None
        if grid.lives is None
        else (np.repeat(grid.lives[0], SLOTS), np.repeat(grid.lives[1], SLOTS)),
    )
    row = np.repeat(np.arange(len(grid.frame)), SLOTS)
    visible, rank = _visible(slots, qualities.random[row], draws)
    every, slots, row = slots, slots.select(visible), row[visible]
    places = slots.constant(draws, "place", lambda keys: draws.uniforms(_PLACE, keys))
    offset, angle, same, other = places[:, slots.column]
    true_class, offset = scene.truth.class_id[row], _offsets(slots, offset)
    class_id = _classes(slots, true_class, offset, same, other, similar)
    of_object = class_id == true_class
    score = _scores(slots, rank, of_object & (offset < BESIDE[0]))
    without_object = of_object & (offset < BESIDE[1]) & ~qualities.detected[row]
    reported = np.flatnonzero(
        ~without_object & (score >= slots.of_rows("quality.floor"))
    )
    slots, row = slots.select(reported), row[reported]
    box = _boxes(
        slots,
        scene.truth.box[row],
        offset[reported],
        2 * np.pi * angle[reported],
        draws,
    )
    candidates = DetectedRows(
        slots.frame, box, scene.truth.velocity[row], class_id[reported], score[reported]
    )
    return draw_errors(every, None, draws, visible[reported]), candidates


def classes_of_same_noise(truth: Truth, noise_names: Sequence[str]) -> list[Ints]:
    """For every class the others with the same of ``noise_names``, the most frequent ones of the scene first."""
    boxes = np.bincount(truth.class_id, minlength=len(noise_names))
    order = np.argsort(-boxes, kind="stable")
    names = np.array(noise_names)
    return [order[(names[order] == names[k]) & (order != k)] for k in range(len(names))]


def _parameters(noise: ClassNoise) -> NearFalsePositives:
    return _NONE if noise.near is None else noise.near


def _numbers(noise: ClassNoise) -> tuple[float, ...]:
    near = _parameters(noise)
    return (
        near.bias,
        near.ar / max(1 - near.bias, 1e-12),
        near.phi,
        near.parent,
        *near.same,
    )


def _visible(slots: Grid, object_quality: Floats, draws: Draws) -> tuple[Ints, Floats]:
    """Visible rows, and the ranks of their quality among those."""
    bias, ar, phi, parent, *_ = slots.of_noise(_numbers).T
    series = slots.autoregression(phi[None], draws, (NoiseKind.QUALITY,))[0]
    number, new = (
        slots.row_noise,
        draws.normal(NoiseKind.QUALITY, Component.WHITE, slots.row_keys),
    )
    normal = np.sqrt(ar)[number] * series + np.sqrt(1 - ar)[number] * new
    normal = parent[number] * object_quality + np.sqrt(1 - parent**2)[number] * normal
    constant = slots.constant(
        draws,
        "skew",
        lambda keys: draws.normal(NoiseKind.QUALITY, Component.BIAS, keys),
    )
    quality = skewed(normal, exponential(constant)[slots.column], bias[number])
    rank = np.full(len(quality), np.nan)
    for noise, rows in slots.by_noise():
        index, own_rank = best_ranks(
            quality[rows], _parameters(noise).bias, _parameters(noise).chance
        )
        rank[rows[index]] = own_rank
    visible = np.flatnonzero(np.isfinite(rank))
    return visible, rank[visible]


def _offsets(slots: Grid, uniform: Floats) -> Floats:
    """Distances from the objects' centres ``[R]`` m, from uniform numbers."""
    offset = np.zeros(len(uniform))
    for noise, rows in slots.by_noise():
        quantiles = _parameters(noise).offset
        offset[rows] = np.interp(uniform[rows], EVEN_RANKS, quantiles)
    return offset


def _scores(slots: Grid, rank: Floats, duplicate: Bools) -> Floats:
    """Scores ``[R]`` by ranks; duplicates may have their own distribution."""
    score = np.zeros(len(rank))
    for noise, rows in slots.by_noise():
        quantiles, duplicates = _parameters(noise).score, _parameters(noise).duplicates
        score[rows] = score_by_rank(rank[rows], quantiles)
        if duplicates is not None:
            score[rows] = np.where(
                duplicate[rows], score_by_rank(rank[rows], duplicates), score[rows]
            )
    return score


def _boxes(
    slots: Grid, true: Floats, offset: Floats, angle: Floats, draws: Draws
) -> Floats:
    """Boxes ``[R, 7]`` at the distances ``offset`` from ``true`` boxes, on the same ground; they turn with them."""
    box = true.copy()
    box[:, :2] += rotate(offset[:, None] * unit_vectors(angle), true[:, 3])
    normal = slots.constant(
        draws,
        "side",
        lambda keys: draws.normal(NoiseKind.SIZE, Component.OTHER, of_axes(keys)).T,
    )
    box[:, 4:] = spread_sizes(box[:, 4:], normal.T[slots.column])
    box[:, 2] += (box[:, 6] - true[:, 6]) / 2
    return box


def _classes(
    slots: Grid,
    true_class: Ints,
    offset: Floats,
    uniform: Floats,
    other: Floats,
    similar: Sequence[Ints],
) -> Ints:
    """Classes ``[R]``: that of the object, or another one with the same noise, by two uniform numbers."""
    wrong = (
        uniform
        >= slots.of_rows(_numbers)[
            np.arange(len(offset)), 4 + np.digitize(offset, BESIDE)
        ]
    )
    class_id = np.array(true_class)
    for k in set(true_class[wrong].tolist()):
        rows, others = np.flatnonzero(wrong & (true_class == k)), similar[k]
        if len(others):
            class_id[rows] = others[
                np.floor(other[rows] ** 2 * len(others)).astype(np.int64)
            ]
    return class_id
