"""False positives beside true boxes, which they follow.

They are duplicates, shadows and boxes of a wrong class.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core import Bools, Floats, Ints, Truth, rotate, unit_vectors
from .draws import Component, Draws, NoiseKind, NoiseSubject, exponential, parts, skewed
from .errors import BoxErrors, draw_errors, of_axes
from .false_positives import DetectedRows, SensedScene, spread_sizes
from .grid import Grid
from .profile import DISTANCE_RANKS, SLOTS_PER_BOX, ClassNoise, NearFalsePositives
from .quality import Qualities, best_ranks, score_by_rank

# m from the object's centre, where the chance to have the object's class changes
BESIDE_DISTANCES_M = (0.75, 1.5)
# distance, angle, and two numbers that decide the class
_PLACE = (
    *parts(Component.BIAS, NoiseKind.PLACE),
    *parts(Component.SECOND, NoiseKind.PLACE),
    *parts(Component.BIAS, NoiseKind.CLASS),
    *parts(Component.SECOND, NoiseKind.CLASS),
)
# of a noise without any: too unlikely to be visible
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
    """Return visible false positives beside the true boxes, with their errors.

    ``grid`` and ``qualities`` belong to the true boxes. ``similar``: see
    `classes_of_same_noise`. A duplicate appears only beside a detected object.
    """
    draws = Draws(seed, NoiseSubject.NEAR_OBJECTS)
    slots = _slots_of(grid)
    true_row = np.repeat(np.arange(len(grid.frame)), SLOTS_PER_BOX)
    visible, quality_rank = _visible(slots, qualities.random[true_row], draws)
    visible_slots = slots.select(visible)
    true_row = true_row[visible]
    place_uniforms = visible_slots.constant(
        draws, "place", lambda keys: draws.uniforms(_PLACE, keys)
    )
    distance, angle, same_uniform, other_uniform = place_uniforms[
        :, visible_slots.column
    ]
    true_class = scene.truth.class_id[true_row]
    offset_m = _offsets(visible_slots, distance)
    class_id = _classes(
        visible_slots, true_class, offset_m, same_uniform, other_uniform, similar
    )
    of_object = class_id == true_class
    slot_scores = _scores(
        visible_slots, quality_rank, of_object & (offset_m < BESIDE_DISTANCES_M[0])
    )
    # a duplicate
    needs_object = of_object & (offset_m < BESIDE_DISTANCES_M[1])
    is_reported = slot_scores >= visible_slots.of_rows("quality.floor")
    is_reported &= ~(needs_object & ~qualities.detected[true_row])
    reported_rows = np.flatnonzero(is_reported)
    visible_slots = visible_slots.select(reported_rows)
    true_row = true_row[reported_rows]
    box = _boxes(
        visible_slots,
        scene.truth.box[true_row],
        offset_m[reported_rows],
        2 * np.pi * angle[reported_rows],
        draws,
    )
    velocity = scene.truth.velocity[true_row]
    rows = DetectedRows(
        visible_slots.frame,
        box,
        velocity,
        class_id[reported_rows],
        slot_scores[reported_rows],
    )
    errors = draw_errors(
        slots, neighbours=None, draws=draws, row_index=visible[reported_rows]
    )
    return errors, rows


def _slots_of(grid: Grid) -> Grid:
    """Return the places beside every true box, each treated as an object."""
    slot = np.arange(SLOTS_PER_BOX)
    lives = grid.lives
    if lives is not None:
        lives = (np.repeat(lives[0], SLOTS_PER_BOX), np.repeat(lives[1], SLOTS_PER_BOX))
    return replace(
        grid,
        ids=(grid.ids[:, None] * SLOTS_PER_BOX + slot).ravel(),
        frame=np.repeat(grid.frame, SLOTS_PER_BOX),
        column=(grid.column[:, None] * SLOTS_PER_BOX + slot).ravel(),
        noise_number=np.repeat(grid.noise_number, SLOTS_PER_BOX),
        lives=lives,
    )


def classes_of_same_noise(truth: Truth, noise_names: Sequence[str]) -> list[Ints]:
    """Return for every class the indices of others with the same noise.

    ``noise_names``: name of the noise of each class. The most frequent classes of the
    truth come first.
    """
    box_count = np.bincount(truth.class_id, minlength=len(noise_names))
    order = np.argsort(-box_count, kind="stable")
    names = np.array(noise_names)
    return [order[(names[order] == names[k]) & (order != k)] for k in range(len(names))]


def _parameters(noise: ClassNoise) -> NearFalsePositives:
    return _NONE if noise.near is None else noise.near


def _numbers(noise: ClassNoise) -> tuple[float, ...]:
    """Return bias, share of the rest that is autoregressive, phi, parent and same."""
    parameters = _parameters(noise)
    ar = parameters.ar / max(1 - parameters.bias, 1e-12)
    return parameters.bias, ar, parameters.phi, parameters.parent, *parameters.same


def _visible(slots: Grid, object_quality: Floats, draws: Draws) -> tuple[Ints, Floats]:
    """Return visible rows, and the ranks of their quality among those."""
    _, _, phi, *_ = slots.of_noise(_numbers).T
    bias, ar, _, parent, *_ = slots.of_rows(_numbers).T
    series = slots.autoregression(phi[None], draws, (NoiseKind.QUALITY,))[0]
    new = draws.normal(NoiseKind.QUALITY, Component.WHITE, slots.row_keys)
    normal = np.sqrt(ar) * series + np.sqrt(1 - ar) * new
    normal = parent * object_quality + np.sqrt(1 - parent**2) * normal
    constant = slots.constant(
        draws,
        "skew",
        lambda keys: draws.normal(NoiseKind.QUALITY, Component.BIAS, keys),
    )
    quality = skewed(normal, exponential(constant)[slots.column], bias)
    quality_rank = np.full(len(quality), np.nan)
    for noise, rows in slots.by_noise():
        parameters = _parameters(noise)
        best_rows, best_rank = best_ranks(
            quality[rows], parameters.bias, parameters.chance
        )
        quality_rank[rows[best_rows]] = best_rank
    visible = np.flatnonzero(np.isfinite(quality_rank))
    return visible, quality_rank[visible]


def _offsets(slots: Grid, uniform: Floats) -> Floats:
    """Return distances [R], m, from the objects' centres, by uniform numbers."""
    offset_m = np.zeros(len(uniform))
    for noise, rows in slots.by_noise():
        quantiles = _parameters(noise).offset
        offset_m[rows] = np.interp(uniform[rows], DISTANCE_RANKS, quantiles)
    return offset_m


def _scores(slots: Grid, quality_rank: Floats, duplicate: Bools) -> Floats:
    """Return scores [R] by ranks.

    Duplicates may have a distribution of their own.
    """
    slot_scores = np.zeros(len(quality_rank))
    for noise, rows in slots.by_noise():
        parameters = _parameters(noise)
        slot_scores[rows] = score_by_rank(quality_rank[rows], parameters.score)
        if parameters.duplicates is not None:
            doubled = rows[duplicate[rows]]
            slot_scores[doubled] = score_by_rank(
                quality_rank[doubled], parameters.duplicates
            )
    return slot_scores


def _boxes(
    slots: Grid, true_box: Floats, offset_m: Floats, angle: Floats, draws: Draws
) -> Floats:
    """Return boxes [R, 7] at the distances ``offset_m`` from true boxes.

    They are on the same ground, and turn with them.
    """
    box = true_box.copy()
    box[:, :2] += rotate(offset_m[:, None] * unit_vectors(angle), true_box[:, 3])
    normal = slots.constant(
        draws,
        "side",
        lambda keys: draws.normal(NoiseKind.SIZE, Component.SECOND, of_axes(keys)).T,
    )
    box[:, 4:] = spread_sizes(box[:, 4:], normal.T[slots.column])
    box[:, 2] += (box[:, 6] - true_box[:, 6]) / 2
    return box


def _classes(
    slots: Grid,
    true_class: Ints,
    offset_m: Floats,
    uniform: Floats,
    other_uniform: Floats,
    similar: Sequence[Ints],
) -> Ints:
    """Return classes [R] of false positives.

    A class is that of the object, or another one with the same noise. ``uniform`` and
    ``other_uniform``: two uniform numbers, which decide it.
    """
    _, _, _, _, *same_shares = slots.of_rows(_numbers).T
    distance_band = np.digitize(offset_m, BESIDE_DISTANCES_M)
    is_wrong = uniform >= np.choose(distance_band, same_shares)
    class_id = np.array(true_class)
    for k in set(true_class[is_wrong].tolist()):
        rows = np.flatnonzero(is_wrong & (true_class == k))
        class_count = len(similar[k])
        if class_count:
            # the square makes the frequent classes likelier
            place = np.floor(other_uniform[rows] ** 2 * class_count).astype(np.int64)
            class_id[rows] = similar[k][place]
    return class_id
