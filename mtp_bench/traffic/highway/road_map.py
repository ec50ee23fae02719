"""Pieces of a road map, in highway-env's frame (y down)."""

from dataclasses import dataclass
from typing import Any

from .lanes import LaneGeometry, Route


@dataclass(frozen=True)
class Crossing:
    """A zebra crossing over an arm.

    Its axis begins at ``origin`` and runs along ``direction``, across the whole road.
    """

    origin: tuple[float, float]  # m
    direction: tuple[float, float]  # unit vector
    span: float  # m, width of the road
    width: float  # m, along the road


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

    It begins at ``start`` and runs along ``direction``, to the right of the traffic.
    """

    start: tuple[float, float]  # m
    direction: tuple[float, float]  # unit vector
    length: float  # m


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A road network with its routes."""

    network: Any  # a RoadNetwork
    geometry: LaneGeometry
    routes: tuple[Route, ...]
    sensor: tuple[float, float, float]  # m, x y z of a roadside sensor
    # True: vehicles give way where routes cross; False: they change lanes to overtake
    regulated: bool
    # True: who asks first goes first; False: vehicles may go before a distant one
    first_in_first_out: bool = True
    crossings: tuple[Crossing, ...] = ()
    pavement: Pavement | None = None
    kerbs: tuple[Kerb, ...] = ()

    @property
    def overtaking(self) -> bool:
        """True if vehicles change lanes."""
        return not self.regulated
