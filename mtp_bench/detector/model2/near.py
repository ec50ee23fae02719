"""False positives beside true boxes: duplicates, shadows, boxes of a wrong class. They follow their objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...geometry import rotate
from ...types import Bools, Floats, Ints, Truth
from ..rows import Rows
from ..surroundings import Surroundings, spread_sides
from .draws import Draws, Grid, Kind, Part, Whose, keys_of
from .profile import SLOTS, ClassNoise, NearGhosts
from .quality import Qualities, score_by_rank, seen_rank
from .reports import report
from .skewed import exponential, with_exponential

BESIDE = 0.75, 1.5  # m from the object's centre: what is nearer, or farther, has its class more or less often

_NONE = NearGhosts(bias=0, ar=0, phi=0, white=1, chance=1e-12, score=(0.0,) * 11, offset=(0.0,) * 11, same=(1, 1, 1))


def near_ghosts(grid: Grid, around: Surroundings, found: Qualities, alike: Sequence[Ints], seed: int) -> Rows:
    """False positives beside the true boxes of a scene.

    ``grid``: the truth's; ``found``: qualities of the objects; ``alike``: for every class the others with the same
    noise, most frequent first. A duplicate needs the detection that it is a duplicate of.
    """
    draws = Draws(seed, Whose.NEAR)
    slots = _slots(grid)
    row = np.repeat(np.arange(len(grid.frame)), SLOTS)
    kept, rank = _seen(slots, found.random[row], draws)
    slots, row = slots.of_these(kept), row[kept]
    true, offset = around.truth.class_id[row], _offsets(slots, draws)
    class_id = _classes(slots, true, offset, alike, draws)
    score = _scores(slots, rank, (class_id == true) & (offset < BESIDE[0]))
    alone = (class_id == true) & (offset < BESIDE[1]) & ~found.present[row]
    reported = np.flatnonzero(~alone & (score >= slots.of_rows(lambda noise: noise.quality.floor)))
    slots, row = slots.of_these(reported), row[reported]
    box = _boxes(slots, around.truth.box[row], offset[reported], draws)
    velocity = around.truth.velocity[row]
    return report(slots, Rows(slots.frame, box, velocity, class_id[reported], score[reported]), around, draws)


def _law(noise: ClassNoise) -> NearGhosts:
    return _NONE if noise.near is None else noise.near


def _slots(grid: Grid) -> Grid:
    """The places beside every true box, as objects of their own."""
    slot = np.arange(SLOTS)
    return replace(
        grid,
        ids=(grid.ids[:, None] * SLOTS + slot).ravel(),
        frame=np.repeat(grid.frame, SLOTS),
        column=(grid.column[:, None] * SLOTS + slot).ravel(),
        of_noise=np.repeat(grid.of_noise, SLOTS),
    )


def _seen(slots: Grid, of_object: Floats, draws: Draws) -> tuple[Ints, Floats]:
    """Rows that are seen, and the ranks of their quality among those."""
    bias, ar, phi, parent = slots.of_objects(lambda n: (_law(n).bias, _law(n).ar, _law(n).phi, _law(n).parent)).T
    ar, parent = (ar / np.maximum(1 - bias, 1e-12))[slots.column], parent[slots.column]
    new = draws.normal(Kind.QUALITY, Part.WHITE, slots.of_frames)
    own = np.sqrt(ar) * slots.series(phi, draws, Kind.QUALITY) + np.sqrt(1 - ar) * new
    own = parent * of_object + np.sqrt(1 - parent**2) * own
    positive = exponential(draws.normal(Kind.QUALITY, Part.BIAS, slots.of_ids))
    quality = with_exponential(own, positive[slots.column], bias[slots.column])
    kept, ranks = [], []
    for noise, rows in slots.by_noise():
        law = _law(noise)
        seen, rank = seen_rank(quality[rows], law.bias, law.chance)
        kept.append(rows[seen])
        ranks.append(rank)
    order = np.argsort(np.concatenate(kept))
    return np.concatenate(kept)[order], np.concatenate(ranks)[order]


def _offsets(slots: Grid, draws: Draws) -> Floats:
    """Distances from the objects' centres ``[R]`` m."""
    offset = draws.uniform(Kind.PLACE, Part.BIAS, slots.of_ids)[slots.column]
    for noise, rows in slots.by_noise():
        quantile = _law(noise).offset
        offset[rows] = np.interp(offset[rows], np.linspace(0.0, 1.0, len(quantile)), quantile)
    return offset


def _scores(slots: Grid, rank: Floats, duplicate: Bools) -> Floats:
    """Scores ``[R]`` by ranks; those of duplicates have a law of their own where the profile has it."""
    score = np.zeros(len(rank))
    for noise, rows in slots.by_noise():
        law = _law(noise)
        weaker = law.score if law.duplicates is None else law.duplicates
        score[rows] = np.where(duplicate[rows], score_by_rank(rank[rows], weaker), score_by_rank(rank[rows], law.score))
    return score


def _boxes(slots: Grid, true: Floats, offset: Floats, draws: Draws) -> Floats:
    """Boxes ``[R, 7]`` at distances from ``true`` ones that turn with these."""
    angle = 2 * np.pi * draws.uniform(Kind.PLACE, Part.OTHER, slots.of_ids)[slots.column]
    box = np.array(true, dtype=np.float64)
    box[:, :2] += rotate(offset[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1), true[:, 3])
    spread = draws.normal(Kind.SIZE, Part.OTHER, keys_of(slots.of_ids[:, None], np.arange(3)[None, :]))[slots.column]
    box[:, 4:] = spread_sides(box[:, 4:], spread)
    box[:, 2] += (box[:, 6] - true[:, 6]) / 2  # on the same ground
    return box


def _classes(slots: Grid, true: Ints, offset: Floats, alike: Sequence[Ints], draws: Draws) -> Ints:
    """Classes ``[R]``: that of the object, or perhaps another one with the same noise."""
    same = slots.of_rows(lambda noise: _law(noise).same)[np.arange(len(offset)), np.digitize(offset, BESIDE)]
    wrong = draws.uniform(Kind.CLASS, Part.BIAS, slots.of_ids)[slots.column] >= same
    which = draws.uniform(Kind.CLASS, Part.OTHER, slots.of_ids)[slots.column]
    class_id = np.array(true)
    for own, others in enumerate(alike):
        rows = np.flatnonzero(wrong & (true == own))
        if len(others):
            class_id[rows] = others[np.floor(which[rows] ** 2 * len(others)).astype(np.int64)]
    return class_id


def classes_alike(truth: Truth, noise_names: Sequence[str]) -> list[Ints]:
    """For every class the others with the same noise, those with most boxes first; names of noise per class."""
    boxes = np.bincount(truth.class_id, minlength=len(noise_names))
    order = np.argsort(-boxes, kind="stable")
    names = np.array(noise_names)
    return [order[(names[order] == names[own]) & (order != own)] for own in range(len(names))]
