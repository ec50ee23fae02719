"""What the detector reports of false positives: they are estimated as true objects of poor quality are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Floats, Ints
from ..rows import Rows
from ..sight import polar, within
from ..surroundings import Surroundings
from .draws import Draws, Grid
from .errors import estimated, position_errors, velocities
from .neighbours import Neighbours

_POOR = -1.0  # random part of the quality that the errors of false positives have


@dataclass(frozen=True, eq=False)
class Ghosts:
    """False positives that are seen, before any error; those that the sensor does not cover included."""

    grid: Grid
    frame: Ints  # [R] of the scene; those of the grid may be others
    box: Floats  # [R, 7]
    velocity: Floats  # [R, 2] m/s
    class_id: Ints  # [R]
    score: Floats  # [R]


def report(ghosts: Ghosts, around: Surroundings, draws: Draws) -> Rows:
    """Detections of what the sensor covers."""
    distance, bearing = polar(ghosts.box[:, :2], around.ego[ghosts.frame])
    kept = within(distance, bearing, around.sensor)
    grid = ghosts.grid.of_these(np.flatnonzero(kept))
    frame, distance = ghosts.frame[kept], distance[kept]
    toward, poor = bearing[kept] + around.ego[frame, 3], np.full(len(frame), _POOR)
    alone = Neighbours.none()
    off = position_errors(grid, distance, toward, poor, alone, draws)
    box = estimated(ghosts.box[kept], off, grid, draws)
    velocity = velocities(ghosts.velocity[kept], grid, toward, draws)
    return Rows(frame, box, velocity, ghosts.class_id[kept], ghosts.score[kept])
