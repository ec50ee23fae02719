"""Pieces of a road map, in highway-env's frame (y down)."""

from dataclasses import dataclass
from typing import Any

from .lanes import LaneGeometry, Route


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing over an arm.

    Its axis runs from ``origin`` in ``direction`` over ``span`` metres of road.
    """

    origin: tuple[float, float]
    direction: tuple[float, float]
    span: float
    width: float


@dataclass(frozen=True)
class Pavement:
    """Pavement beside two roads that cross at (0, 0) along the axes.

    The kerbs bend around the corners.
    """

    corner: float  # m, the middle of a kerb's bend is at (+-corner, +-corner)
    radius: float  # m, of the bend

    @property
    def kerb(self) -> float:
        """Distance in m from the middle of a road to its straight kerbs."""
        return self.corner - self.radius


@dataclass(frozen=True)
class Kerb:
    """A straight kerb where cars park.

    It is to the right of the way from ``start`` in ``direction``.
    """

    start: tuple[float, float]
    direction: tuple[float, float]
    length: float


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A road network with its routes."""

    network: Any  # a RoadNetwork
    geometry: LaneGeometry
    routes: tuple[Route, ...]
    sensor: tuple[float, float, float]  # x, y, z of a roadside sensor
    regulated: bool  # vehicles give way by conflicts of routes; else they overtake
    # False: vehicles may also go before one that is far away
    first_in_first_out: bool = True
    crossings: tuple[Crossing, ...] = ()
    pavement: Pavement | None = None
    kerbs: tuple[Kerb, ...] = ()

    @property
    def overtaking(self) -> bool:
        """Whether vehicles change lanes."""
        return not self.regulated
