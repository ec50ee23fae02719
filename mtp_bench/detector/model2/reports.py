"""What the detector reports of false positives: they are estimated as true objects of poor quality are."""

from __future__ import annotations

import numpy as np

from ..rows import Rows
from ..sight import polar, within
from ..surroundings import Surroundings
from .draws import Draws, Grid
from .errors import estimated, position_errors, velocities
from .neighbours import Neighbours

_POOR = -1.0  # random part of the quality that the errors of false positives have


def report(grid: Grid, ghosts: Rows, around: Surroundings, draws: Draws) -> Rows:
    """Detections of those false positives that the sensor covers.

    ``ghosts``: those that are seen, before any error; ``grid``: their noise, whose frames may be others.
    """
    distance, bearing = polar(ghosts.box[:, :2], around.ego[ghosts.frame])
    kept = within(distance, bearing, around.sensor)
    grid = grid.of_these(np.flatnonzero(kept))
    frame, distance = ghosts.frame[kept], distance[kept]
    toward, poor = bearing[kept] + around.ego[frame, 3], np.full(len(frame), _POOR)
    alone = Neighbours.none()
    off = position_errors(grid, distance, toward, poor, alone, draws)
    box = estimated(ghosts.box[kept], off, grid, draws)
    velocity = velocities(ghosts.velocity[kept], grid, toward, draws)
    return Rows(frame, box, velocity, ghosts.class_id[kept], ghosts.score[kept])
