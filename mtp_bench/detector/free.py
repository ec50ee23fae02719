"""False positives away from objects.

They belong to families that are born together, stand still and are visible now and
then.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core import Floats, Ints, in_groups, select, wrap_angle
from .draws import (
    Draws,
    NoiseKind,
    NoiseSubject,
    decayed,
    exponential,
    remembered,
    skewed,
)
from .errors import BoxErrors, draw_errors
from .false_positives import (
    DetectedRows,
    ReportedClasses,
    SensedScene,
    draw_places,
    ground_height,
    spread_sizes,
)
from .grid import Grid
from .profile import ClassNoise, FreeFalsePositives
from .quality import best_ranks, score_by_rank


@dataclass(frozen=True, eq=False)
class _Members:
    """Members of families. Each lives for some frames."""

    birth: Ints  # [B] frame
    life: Ints  # [B] frames, at most to the end of the scene
    family: Ints  # [B]
    shift: Floats  # [B, 2] m, from the place of the family
    heading: Floats  # [B] rad
    size: Floats  # [B, 3] m
    class_id: Ints  # [B]

    @property
    def families(self) -> int:
        """Number of families."""
        return int(self.family.max(initial=-1)) + 1


class _Appearances(NamedTuple):
    """Visible rows of members, wherever the sensor is."""

    members: _Members
    member: Ints  # [R] ascending
    frame: Ints  # [R]
    score: Floats  # [R]
    errors: BoxErrors


def free_false_positives(
    noise: ClassNoise,
    classes: ReportedClasses,
    scene: SensedScene,
    number: int,
    seed: int,
) -> tuple[BoxErrors, DetectedRows]:
    """Return visible free false positives of one noise, with their errors.

    Members born beyond reach are dropped. ``number`` separates the random numbers of
    several noises.
    """
    parameters = noise.free
    assert parameters is not None  # as `reported_classes` has seen
    draws = Draws(seed, NoiseSubject.FREE, number)
    appearances = remembered(
        scene.memory,
        ("free", number),
        lambda: _appearances(noise, parameters, classes, scene, draws),
    )
    members = appearances.members
    rows = np.arange(len(appearances.member))
    if scene.memory is not None:
        rows = np.flatnonzero(appearances.frame == scene.memory.frame)
    used_members, used_row = np.unique(appearances.member[rows], return_inverse=True)
    birth_frame = members.birth[used_members]
    family_number = members.family[used_members]
    ego = scene.ego[birth_frame]
    rng = draws.generator(NoiseKind.PLACE)
    number_shape = (members.families, 2)  # numbers of all families, seen or not
    place_xy = draw_places(
        parameters.distance,
        scene.sensor,
        ego,
        lambda: rng.random(number_shape)[family_number],
    )
    place_xy += members.shift[used_members]
    box_sizes = members.size[used_members]
    ground_z = ground_height(place_xy, birth_frame, scene)
    center_z = ground_z + box_sizes[:, 2] / 2
    box = np.column_stack(
        [place_xy, center_z, members.heading[used_members], box_sizes]
    )
    within_reach = np.hypot(*(place_xy - ego[:, :2]).T) <= scene.sensor.reach
    is_reached = within_reach[used_row]
    rows = rows[is_reached]
    used_row = used_row[is_reached]
    detected = DetectedRows(
        appearances.frame[rows],
        box[used_row],
        np.zeros((len(rows), 2)),
        members.class_id[used_members[used_row]],
        appearances.score[rows],
    )
    return select(appearances.errors, rows), detected


def _appearances(
    noise: ClassNoise,
    parameters: FreeFalsePositives,
    classes: ReportedClasses,
    scene: SensedScene,
    draws: Draws,
) -> _Appearances:
    """Return members and their visible rows."""
    members = _draw_members(parameters, classes, scene, draws)
    member_row, member_age = in_groups(members.life)
    count = len(members.life)
    grid = Grid(
        frames=int(members.life.max(initial=0)),  # of ages
        ids=np.arange(count),
        frame=member_age,
        column=member_row,
        noise=(noise,),
        noise_number=np.zeros(count, dtype=np.int64),
        steps=scene.steps,
    )
    visible, rank = _visible(parameters, members, grid, draws)
    score = score_by_rank(rank, parameters.score)
    reported = score >= noise.quality.floor
    rows = visible[reported]
    return _Appearances(
        members,
        member_row[rows],
        (members.birth[member_row] + member_age)[rows],
        score[reported],
        draw_errors(grid, neighbours=None, draws=draws, row_index=rows),
    )


def _visible(
    parameters: FreeFalsePositives, members: _Members, grid: Grid, draws: Draws
) -> tuple[Ints, Floats]:
    """Return visible rows of the grid and the ranks of their quality.

    Siblings share a part of the quality.
    """
    family_grid = replace(
        grid,
        ids=np.arange(members.families),
        column=members.family[grid.column],
        noise_number=np.zeros(members.families, dtype=np.int64),
    )
    single, single_constant = _quality_normals(
        parameters, grid, draws, NoiseKind.QUALITY
    )
    common, common_constant = _quality_normals(
        parameters, family_grid, draws, NoiseKind.FAMILY
    )
    common_weight = np.sqrt(parameters.family)
    single_weight = np.sqrt(1 - parameters.family)
    constant = common_weight * common_constant[members.family]
    positive = exponential(constant + single_weight * single_constant)
    normal = common_weight * common + single_weight * single
    quality = skewed(normal, positive[grid.column], parameters.bias)
    return best_ranks(quality, parameters.bias, parameters.chance)


def _quality_normals(
    parameters: FreeFalsePositives, grid: Grid, draws: Draws, kind: NoiseKind
) -> tuple[Floats, Floats]:
    """Return normal numbers that change over frames [R].

    Also returns a constant normal number of each object [J].
    """
    ar = parameters.ar / max(1 - parameters.bias, 1e-12)
    rng = draws.generator(kind)  # hashing so many numbers would take long
    constant = rng.standard_normal(len(grid.ids))
    push, white = rng.standard_normal((2, len(grid.cells[0])))
    # siblings share the numbers of their family
    new = grid.on_grid(white)[grid.frame, grid.column]
    phi = np.array([[parameters.phi]])
    series = grid.autoregression(phi, draws, (kind,), push[None])[0]
    return np.sqrt(ar) * series + np.sqrt(1 - ar) * new, constant


def _draw_members(
    parameters: FreeFalsePositives,
    classes: ReportedClasses,
    scene: SensedScene,
    draws: Draws,
) -> _Members:
    """Draw the members of all families, also those beyond the sensor's reach."""
    survive = float(decayed(np.asarray(parameters.survive), scene.steps))
    birth_frame = _draw_births(parameters, survive, scene, draws)
    families = len(birth_frame)
    life_frames = draws.generator(NoiseKind.LIFE).geometric(1.0 - survive, families)
    life_frames = np.minimum(life_frames, len(scene.ego) - birth_frame)
    rng = draws.generator(NoiseKind.FAMILY)
    siblings = rng.poisson(parameters.siblings, families)
    family_number = np.repeat(np.arange(families), 1 + siblings)
    members = len(family_number)
    is_first = np.diff(family_number, prepend=-1) > 0
    place_shift = parameters.spread * rng.standard_normal((members, 2))
    heading_turns = draws.generator(NoiseKind.HEADING).random(families)
    kind_rng = draws.generator(NoiseKind.CLASS)
    class_number = kind_rng.choice(len(classes.share), members, p=classes.share)
    side_normal = draws.generator(NoiseKind.SIZE).standard_normal((members, 3))
    return _Members(
        birth=birth_frame[family_number],
        life=life_frames[family_number],
        family=family_number,
        shift=np.where(is_first[:, None], 0.0, place_shift),
        heading=wrap_angle(2 * np.pi * heading_turns)[family_number],
        size=spread_sizes(classes.size[class_number], side_normal),
        class_id=classes.class_id[class_number],
    )


def _draw_births(
    parameters: FreeFalsePositives, survive: float, scene: SensedScene, draws: Draws
) -> Ints:
    """Draw the frame of every family's birth, ascending.

    Births are Poisson, with a Gamma factor per scene; the first frame is in
    equilibrium.
    """
    factor = 1.0
    if parameters.dispersion > 1.0:
        # of mean 1 and variance (dispersion - 1) / rate
        gamma_shape = parameters.rate / (parameters.dispersion - 1.0)
        factor = float(
            draws.generator(NoiseKind.SCENE).gamma(gamma_shape) / gamma_shape
        )
    # a member is visible with `chance`, and a family has 1 + `siblings` members
    visible_members = parameters.rate * scene.field_ratio
    alive_families = (
        visible_members * factor / parameters.chance / (1.0 + parameters.siblings)
    )
    mean_births = np.full(len(scene.ego), alive_families * (1.0 - survive))
    mean_births[:1] = alive_families
    count = draws.generator(NoiseKind.BIRTH).poisson(mean_births)
    return np.repeat(np.arange(len(scene.ego)), count)
