"""Parked cars: places along the kerbs, drawn at random; nobody in them moves."""

from __future__ import annotations

import numpy as np

from ...types import Floats
from .networks import Kerb
from .population import draw_size

_PITCH = 6.2  # m from one place to the next
_FILLED = 0.8  # share of the places of a kerb
_SPREAD = 0.3  # m along a place
_GAP = (0.1, 0.35)  # m to the kerb
_ASKEW = 0.02  # rad
_VANS = 0.15  # share
_LONGEST, _WIDEST = 5.5, 2.0  # m


def parked_boxes(kerbs: tuple[Kerb, ...], number: int, rng: np.random.Generator) -> Floats:
    """Boxes ``[K, 7]`` of parked cars in highway-env's frame (y down): ``number`` of them, fewer where no more fit.

    One kerb after the other is filled, but for some places that are taken last: cars stand in rows.
    """
    places = [(k, at) for k, kerb in enumerate(kerbs) for at in np.arange(_PITCH / 2, kerb.length - _PITCH / 2, _PITCH)]
    rank = rng.permutation(len(kerbs))
    late = rng.uniform(size=len(places)) > _FILLED
    order = sorted(range(len(places)), key=lambda p: (late[p], rank[places[p][0]], p))
    rows = [_box(kerbs[places[p][0]], float(places[p][1]), rng) for p in sorted(order[:number])]
    return np.round(np.array(rows, dtype=np.float64).reshape(-1, 7), 6) + 0.0


def _box(kerb: Kerb, at: float, rng: np.random.Generator) -> tuple[float, ...]:
    length, width, height = draw_size("van" if rng.uniform() < _VANS else "car", rng)
    length, width = min(length, _LONGEST), min(width, _WIDEST)
    (ux, uy), (x, y) = kerb.direction, kerb.start
    along, aside = at + rng.uniform(-_SPREAD, _SPREAD), rng.uniform(*_GAP) + width / 2
    heading = np.arctan2(uy, ux) + rng.uniform(-_ASKEW, _ASKEW)
    return x + along * ux + aside * uy, y + along * uy - aside * ux, height / 2, heading, length, width, height
