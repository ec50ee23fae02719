"""False positives away from objects: families that are born together, stand still and are visible now and then."""

from dataclasses import dataclass, replace

import numpy as np

from ..core import Floats, Ints, Ragged, select, starts_of, wrap_angle
from .draws import Draws, NoiseKind, NoiseSubject, decayed, exponential, skewed
from .errors import BoxErrors, draw_errors
from .false_positives import (
    DetectedRows,
    ReportedClasses,
    SensedScene,
    draw_places,
    ground_height,
    spread_sizes,
)
from .grid import Grid, kept
from .profile import ClassNoise, FreeFalsePositives
from .quality import best_ranks, score_by_rank


@dataclass(frozen=True, eq=False)
class _Members:
    """Members of families; each lives for some frames."""

    birth: Ints  # [B] frame
    life: Ints  # [B] frames, at most to the end of the scene
    family: Ints  # [B]
    shift: Floats  # [B, 2] m, from the place of the family
    heading: Floats  # [B] rad
    size: Floats  # [B, 3] m
    class_id: Ints  # [B]


def free_false_positives(
    noise: ClassNoise,
    classes: ReportedClasses,
    scene: SensedScene,
    number: int,
    seed: int,
) -> tuple[BoxErrors, DetectedRows]:
    """Visible free false positives of one noise, with their errors; members born beyond reach are dropped.

    ``number`` separates the random numbers of several noises.
    """
    parameters = noise.free
    assert parameters is not None  # as `reported_classes` has seen
    draws = Draws(seed, NoiseSubject.FREE, number)
    members, member, frame, score, errors = kept(
        scene.memory,
        ("free", number),
        lambda: _appearances(noise, parameters, classes, scene, draws),
    )
    rows = (
        np.arange(len(member))
        if scene.memory is None
        else np.flatnonzero(frame == scene.memory.frame)
    )
    own = member[rows]  # ascending
    first = np.diff(own, prepend=-1) > 0
    used, at = own[first], np.cumsum(first) - 1
    birth, family, rng = (
        members.birth[used],
        members.family[used],
        draws.generator(NoiseKind.PLACE),
    )
    ego, every = (
        scene.ego[birth],
        (int(members.family.max(initial=-1)) + 1, 2),
    )  # numbers of all families, seen or not
    place = draw_places(
        parameters.distance, scene.sensor, ego, lambda: rng.random(every)[family]
    )
    place += members.shift[used]
    near = np.hypot(*(place - ego[:, :2]).T) <= scene.sensor.reach
    used, rows, at = used[near], rows[near[at]], (np.cumsum(near) - 1)[at[near[at]]]
    height = ground_height(place[near], birth[near], scene) + members.size[used, 2] / 2
    box = np.column_stack(
        [place[near], height, members.heading[used], members.size[used]]
    )[at]
    velocity, class_id = np.zeros((len(rows), 2)), members.class_id[used[at]]
    return select(errors, rows), DetectedRows(
        frame[rows], box, velocity, class_id, score[rows]
    )


def _appearances(
    noise: ClassNoise,
    parameters: FreeFalsePositives,
    classes: ReportedClasses,
    scene: SensedScene,
    draws: Draws,
) -> tuple[_Members, Ints, Ints, Floats, BoxErrors]:
    """Members; member, frame, score and errors of their visible rows, wherever the sensor is."""
    members = _draw_members(parameters, classes, scene, draws)
    rows = Ragged(starts_of(members.life))
    member = rows.frame_of_rows
    age = np.arange(len(member)) - rows.start[member]
    count, longest = (
        len(members.life),
        int(members.life.max(initial=0)),
    )  # frames of the grid are ages
    grid = Grid(
        longest,
        np.arange(count),
        age,
        member,
        (noise,),
        np.zeros(count, dtype=np.int64),
        scene.steps,
    )
    visible, rank = _visible(parameters, members, grid, draws)
    score = score_by_rank(rank, parameters.score)
    visible, score = (
        visible[score >= noise.quality.floor],
        score[score >= noise.quality.floor],
    )
    frame = (members.birth[member] + age)[visible]
    return (
        members,
        member[visible],
        frame,
        score,
        draw_errors(grid, None, draws, visible),
    )


def _visible(
    parameters: FreeFalsePositives, members: _Members, grid: Grid, draws: Draws
) -> tuple[Ints, Floats]:
    """Visible rows of the grid and the ranks of their quality; siblings share a part of it."""
    families = int(members.family.max(initial=-1)) + 1
    column, number = members.family[grid.column], np.zeros(families, dtype=np.int64)
    family_grid = replace(
        grid, ids=np.arange(families), column=column, noise_number=number
    )
    own, own_constant = _latent(parameters, grid, draws, NoiseKind.QUALITY)
    common, common_constant = _latent(parameters, family_grid, draws, NoiseKind.FAMILY)
    share, rest = np.sqrt(parameters.family), np.sqrt(1 - parameters.family)
    positive = exponential(
        share * common_constant[members.family] + rest * own_constant
    )
    quality = skewed(
        share * common + rest * own, positive[grid.column], parameters.bias
    )
    return best_ranks(quality, parameters.bias, parameters.chance)


def _latent(
    parameters: FreeFalsePositives, grid: Grid, draws: Draws, kind: NoiseKind
) -> tuple[Floats, Floats]:
    """Normal numbers that change over frames ``[R]``, and those behind the constant share ``[J]``."""
    ar = parameters.ar / max(1 - parameters.bias, 1e-12)
    rng = draws.generator(kind)  # hashing so many numbers would take long
    constant, (push, white) = (
        rng.standard_normal(len(grid.ids)),
        rng.standard_normal((2, len(grid.cells[0]))),
    )
    new = grid.on_grid(white)[
        grid.frame, grid.column
    ]  # siblings share the numbers of their family
    series = grid.autoregression(
        np.array([[parameters.phi]]), draws, (kind,), push[None]
    )[0]
    return np.sqrt(ar) * series + np.sqrt(1 - ar) * new, constant


def _draw_members(
    parameters: FreeFalsePositives,
    classes: ReportedClasses,
    scene: SensedScene,
    draws: Draws,
) -> _Members:
    """Draw the members of all families, also those beyond the sensor's reach."""
    frames = len(scene.ego)
    survive = float(decayed(np.asarray(parameters.survive), scene.steps))
    birth = _draw_births(parameters, survive, scene, draws)
    life = np.minimum(
        draws.generator(NoiseKind.LIFE).geometric(1.0 - survive, len(birth)),
        frames - birth,
    )
    rng = draws.generator(NoiseKind.FAMILY)
    family = np.repeat(
        np.arange(len(birth)), 1 + rng.poisson(parameters.siblings, len(birth))
    )
    first = np.append(True, family[1:] != family[:-1])[: len(family)]
    shift = np.where(
        first[:, None], 0.0, parameters.spread * rng.standard_normal((len(family), 2))
    )
    heading = wrap_angle(
        2 * np.pi * draws.generator(NoiseKind.HEADING).random(len(birth))
    )[family]
    kind = draws.generator(NoiseKind.CLASS).choice(
        len(classes.share), len(family), p=classes.share
    )
    size = spread_sizes(
        classes.size[kind],
        draws.generator(NoiseKind.SIZE).standard_normal((len(family), 3)),
    )
    return _Members(
        birth[family],
        life[family],
        family,
        shift,
        heading,
        size,
        classes.class_id[kind],
    )


def _draw_births(
    parameters: FreeFalsePositives, survive: float, scene: SensedScene, draws: Draws
) -> Ints:
    """Draw the frame of every family's birth, ascending: Poisson, a Gamma factor per scene, first in equilibrium."""
    factor = 1.0
    if parameters.dispersion > 1.0:
        shape = parameters.rate / (parameters.dispersion - 1.0)
        factor = float(draws.generator(NoiseKind.SCENE).gamma(shape) / shape)
    rate = parameters.rate * scene.field_ratio
    alive = rate * factor / parameters.chance / (1.0 + parameters.siblings)
    mean = np.full(len(scene.ego), alive * (1.0 - survive))
    mean[:1] = alive
    return np.repeat(
        np.arange(len(scene.ego)), draws.generator(NoiseKind.BIRTH).poisson(mean)
    )
