"""False positives where nothing is: families that are born together, stand still, and are seen now and then."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...geometry import wrap_angle
from ...types import Floats, Ints, Ragged
from ..chains import decayed
from ..rows import Rows
from ..sight import polar
from ..surroundings import Labels, Surroundings, ground_at, places, spread_sides
from .draws import Draws, Grid, Kind, Whose
from .profile import ClassNoise, FreeGhosts
from .quality import score_by_rank, seen_rank
from .reports import report
from .skewed import exponential, with_exponential


@dataclass(frozen=True, eq=False)
class _Members:
    """Members of families, each for all frames of its life."""

    birth: Ints  # [B] frame
    life: Ints  # [B] frames, to the end of the scene at most
    family: Ints  # [B]
    box: Floats  # [B, 7]
    class_id: Ints  # [B]


def free_ghosts(noise: ClassNoise, labels: Labels, around: Surroundings, number: int, seed: int) -> Rows:
    """False positives of one noise over a scene; ``number`` tells the random numbers of several noises apart.

    ``labels``: classes and sizes that they may have. What appears beyond the sensor's reach is dropped.
    """
    law = noise.free
    if law is None or law.rate == 0:
        return Rows.none()
    draws = Draws(seed, Whose.FREE, number)
    members = _members(law, labels, around, draws)
    rows = Ragged.of_counts(members.life)
    which = rows.frame_of_rows
    age = np.arange(len(which)) - rows.start[which]
    count, longest = len(members.life), int(members.life.max(initial=0))  # the grid is by age
    of_noise = np.zeros(count, dtype=np.int64)
    grid = Grid(longest, np.arange(count), age, which, (noise,), of_noise, around.steps)
    kept, rank = _seen(law, members, grid, draws)
    near = polar(members.box[:, :2], around.ego[members.birth])[0] <= around.sensor.reach
    score = score_by_rank(rank, law.score)
    reported = near[which[kept]] & (score >= noise.quality.floor)
    kept, score = kept[reported], score[reported]
    which = which[kept]
    frame = members.birth[which] + age[kept]
    box = _on_the_ground(members, which, around)
    still = np.zeros((len(which), 2))
    ghosts = Rows(frame, box, still, members.class_id[which], score)
    return report(grid.of_these(kept), ghosts, around, draws)


def _on_the_ground(members: _Members, which: Ints, around: Surroundings) -> Floats:
    """Boxes ``[R, 7]`` of members ``which`` ``[R]`` at the height of the ground in the frame of their birth."""
    used = np.flatnonzero(np.bincount(which))
    ground = np.zeros(len(members.birth))
    ground[used] = ground_at(members.box[used, :2], members.birth[used], around)
    box = members.box[which]
    box[:, 2] = ground[which] + box[:, 6] / 2
    return box


def _seen(law: FreeGhosts, members: _Members, grid: Grid, draws: Draws) -> tuple[Ints, Floats]:
    """Rows of the grid that are seen, and the ranks of their quality; siblings share a part of it."""
    families = int(members.family.max(initial=-1)) + 1
    column, of_noise = members.family[grid.column], np.zeros(families, dtype=np.int64)
    of_families = replace(grid, ids=np.arange(families), column=column, of_noise=of_noise)
    own, alone = _latent(law, grid, draws, Kind.QUALITY)
    common, together = _latent(law, of_families, draws, Kind.FAMILY)
    share, rest = np.sqrt(law.family), np.sqrt(1 - law.family)
    positive = exponential(share * together[members.family] + rest * alone)
    quality = with_exponential(share * common + rest * own, positive[grid.column], law.bias)
    return seen_rank(quality, law.bias, law.chance)


def _latent(law: FreeGhosts, grid: Grid, draws: Draws, kind: Kind) -> tuple[Floats, Floats]:
    """Normal numbers that change over frames ``[R]``, and those behind the constant share ``[J]``."""
    ar = law.ar / max(1 - law.bias, 1e-12)
    rng = draws.stream(kind)  # hashes would take long for so many
    constant, (push, white) = rng.standard_normal(len(grid.ids)), rng.standard_normal((2, len(grid.cells[0])))
    new = grid.of_rows_in(grid.spread(white))  # siblings have the same rows of their family
    series = grid.series_of(np.full(len(grid.ids), law.phi), push)
    return np.sqrt(ar) * series + np.sqrt(1 - ar) * new, constant


def _members(law: FreeGhosts, labels: Labels, around: Surroundings, draws: Draws) -> _Members:
    """All members of all families, those beyond the sensor's reach included."""
    survive = float(decayed(np.asarray(law.survive), around.steps))
    birth = _births(law, survive, around, draws)
    life = np.minimum(draws.stream(Kind.LIFE).geometric(1.0 - survive, len(birth)), len(around.ego) - birth)
    rng = draws.stream(Kind.FAMILY)
    family = np.repeat(np.arange(len(birth)), 1 + rng.poisson(law.siblings, len(birth)))
    first = np.append(True, family[1:] != family[:-1])[: len(family)]
    place = places(law.distance, around.sensor, around.ego[birth], draws.stream(Kind.PLACE))[family]
    place = place + np.where(first[:, None], 0.0, law.spread * rng.standard_normal(place.shape))
    heading = wrap_angle(2 * np.pi * draws.stream(Kind.HEADING).random(len(birth)))[family]
    label = draws.stream(Kind.CLASS).choice(len(labels.share), len(family), p=labels.share)
    spread = draws.stream(Kind.SIZE).standard_normal((len(family), 3))
    size = spread_sides(labels.size[label], spread)
    birth, life = birth[family], life[family]
    box = np.column_stack([place, np.zeros(len(place)), heading, size])
    return _Members(birth, life, family, box, labels.class_id[label])


def _births(law: FreeGhosts, survive: float, around: Surroundings, draws: Draws) -> Ints:
    """Frame of every family's birth, ascending: Poisson with a Gamma factor per scene, in equilibrium at first."""
    rate = law.rate * around.wider
    factor = 1.0
    if law.dispersion > 1.0:
        shape = law.rate / (law.dispersion - 1.0)
        factor = float(draws.stream(Kind.SCENE).gamma(shape) / shape)
    alive = rate * factor / law.chance / (1.0 + law.siblings)
    mean = np.full(len(around.ego), alive * (1.0 - survive))
    mean[:1] = alive
    return np.repeat(np.arange(len(around.ego)), draws.stream(Kind.BIRTH).poisson(mean))
