"""Maps of the plane that wrong frames, units and mirrors make, one for each frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..core import Floats, Ints, rotation, unit_vectors, wrap_angle

UNITS = {  # name -> how often it goes into a metre
    "feet": 1 / 0.3048,
    "centimetres": 100.0,
    "millimetres": 1000.0,
}


@dataclass(frozen=True, eq=False)
class PlaneMap:
    """Map of places in each frame: ``matrix`` times the place plus ``shift``."""

    matrix: Floats  # [F, 2, 2]
    shift: Floats  # [F, 2] m

    def places(self, xy: Floats, frame: Ints) -> Floats:
        """Return where places [n, 2] of frames [n] appear."""
        return self.turned(xy, frame) + self.shift[frame]

    def turned(self, vector: Floats, frame: Ints) -> Floats:
        """Return how vectors [n, 2] of frames [n] appear, such as velocities."""
        return np.asarray(np.einsum("nij,nj->ni", self.matrix[frame], vector))

    def headings(self, yaw: Floats, frame: Ints) -> Floats:
        """Return how headings [n] of frames [n] appear, rad."""
        x, y = self.turned(unit_vectors(yaw), frame).T
        return np.asarray(np.arctan2(y, x))

    def boxes(self, box: Floats, frame: Ints) -> Floats:
        """Return how boxes [n, 7] of frames [n] appear; their sizes stay."""
        moved = box.copy()
        moved[:, 2] *= np.sqrt(np.abs(np.linalg.det(self.matrix)))[frame]
        moved[:, :2] = self.places(box[:, :2], frame)
        moved[:, 3] = wrap_angle(self.headings(box[:, 3], frame))
        return moved

    def inverse(self) -> "PlaneMap":
        """Return the map that undoes this one."""
        back = np.linalg.inv(self.matrix)
        return PlaneMap(back, -np.einsum("fij,fj->fi", back, self.shift))

    @property
    def changes(self) -> bool:
        """True unless all places stay."""
        same = np.allclose(self.matrix, np.eye(2), atol=1e-6)
        return not (same and np.allclose(self.shift, 0.0, atol=1e-3))


def about(matrix: Floats, center: Floats) -> PlaneMap:
    """Return the map [F] that leaves ``center`` [F, 2] where it is."""
    matrix = np.broadcast_to(matrix, (len(center), 2, 2))
    return PlaneMap(matrix, center - np.einsum("fij,fj->fi", matrix, center))


def offset_ego(parameters: Floats, ego: Floats) -> PlaneMap:
    """Move by metres ahead and to the left of the ego."""
    shift = np.einsum("fij,j->fi", rotation(ego[:, 3]), parameters)
    return PlaneMap(_same(ego), shift)


def offset_world(parameters: Floats, ego: Floats) -> PlaneMap:
    """Move by metres along x and y."""
    return PlaneMap(_same(ego), np.broadcast_to(parameters, (len(ego), 2)))


def later_offset(first: int, parameters: Floats, ego: Floats) -> PlaneMap:
    """Move by metres along x and y before a frame, by two others from there on."""
    later = np.arange(len(ego)) >= first
    shift = np.where(later[:, None], parameters[2:], parameters[:2])
    return PlaneMap(_same(ego), shift)


def turn(parameters: Floats, ego: Floats) -> PlaneMap:
    """Turn about the ego by an angle, rad."""
    return about(rotation(np.repeat(parameters, len(ego))), ego[:, :2])


def scale(parameters: Floats, ego: Floats) -> PlaneMap:
    """Enlarge distances from the ego by a share."""
    return about((1.0 + parameters[0]) * np.eye(2), ego[:, :2])


def pose_late(parameters: Floats, ego: Floats) -> PlaneMap:
    """Use the pose of the ego of some frames before."""
    frame = np.arange(len(ego), dtype=float)
    then = frame - parameters[0]
    yaw = np.unwrap(ego[:, 3])
    x, y, angle = (np.interp(then, frame, each) for each in (*ego[:, :2].T, yaw))
    matrix = rotation(angle - yaw)
    shift = np.column_stack([x, y]) - np.einsum("fij,fj->fi", matrix, ego[:, :2])
    return PlaneMap(matrix, shift)


def fixed_maps(ego: Floats) -> Iterator[tuple[str, str, PlaneMap]]:
    """Yield the kind, its variant in words, and the map of each fixed mistake."""
    place = ego[:, :2]
    to_ego = rotation(-ego[:, 3])
    from_ego = rotation(ego[:, 3])
    seen = PlaneMap(to_ego, -np.einsum("fij,fj->fi", to_ego, place))
    flip_y = np.diag([1.0, -1.0])
    flip_x = np.diag([-1.0, 1.0])
    yield "ego_frame", "x ahead, y left", seen
    yield (
        "ego_frame",
        "x ahead, y right",
        PlaneMap(flip_y @ to_ego, seen.shift @ flip_y),
    )
    yield "truth_ego_frame", "", PlaneMap(from_ego, place)
    left_right = from_ego @ flip_y @ to_ego
    front_back = from_ego @ flip_x @ to_ego
    yield "mirrored", "left and right of the ego", about(left_right, place)
    yield "mirrored", "before and behind the ego", about(front_back, place)
    zero = np.zeros_like(place)
    yield "mirrored", "y to -y", about(flip_y, zero)
    yield "mirrored", "x to -x", about(flip_x, zero)
    yield "axes", "x and y exchanged", about(np.array([[0.0, 1], [1, 0]]), zero)
    for degrees in (90, -90, 180):
        angle = np.full(len(ego), np.radians(degrees))
        yield "axes", f"turned by {degrees}°", about(rotation(angle), place)
    back = np.broadcast_to(to_ego[0], _same(ego).shape)
    yield (
        "first_pose",
        "with its turn",
        PlaneMap(back, np.tile(-to_ego[0] @ place[0], (len(ego), 1))),
    )
    yield "first_pose", "without its turn", PlaneMap(_same(ego), zero - place[0])
    for unit, factor in UNITS.items():
        for kind, share in (("units", factor), ("truth_units", 1 / factor)):
            yield kind, unit, about(share * np.eye(2), zero)
            yield kind, unit, about(share * np.eye(2), place)


def _same(ego: Floats) -> Floats:
    return np.broadcast_to(np.eye(2), (len(ego), 2, 2))
