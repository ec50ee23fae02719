"""Predictor along lanes, without learning: speed profiles on lanes, and free motion."""

import numpy as np

from ..agent import Frame
from ..core import Floats, Ints
from ..tracking import kernel, part
from .kinematic import KinematicPredictor, absolute
from .lane_paths import STEP, lane_paths

LANE_SHARE = 0.6  # of the samples, which follow lanes
_WALKING_CLASSES = ("pedestrian",)  # they do not follow lanes
_MAX_PATHS = 6  # per track
_MIN_SPEED_MPS = 1.0  # slower tracks point where their box does
_MAX_PATH_M = 200.0
# steps of a sequence that fills the unit square evenly (Roberts)
_SEQUENCE_STEPS = (0.5698402909980532, 0.7548776662466927)
_FADING_M = 12.0  # of the lane, over which the distance to its middle fades
_LATERAL_MPS2 = 2.0  # usual acceleration in bends
_BEND_BRAKING_MPS2 = 1.5  # before bends
# deviation of the acceleration of one who stands, and what each m/s adds
_STANDING_DEVIATION_MPS2 = 0.5
_DEVIATION_PER_SPEED_HZ = 0.08
_MAX_DEVIATIONS = 2.5  # of the fastest profile
_MAX_BRAKING_MPS2 = 3.0  # in samples that come to a bend too fast
_MIN_CURVATURE = 1e-4  # 1/m, of a road that counts as straight
_LOGISTIC_SCALE = 1.702  # with it the logistic distribution is nearly the normal one
_ROUNDING = 1e-9  # must not add a sample


class LanePredictor(KinematicPredictor):
    """Predictor that draws `LANE_SHARE` of the k samples along lanes.

    The other samples are `KinematicPredictor`'s. Paths along lanes and their successors
    share the samples by their plausibility. On a path the samples are quantiles of the
    distance that the motion noise allows, from braking to accelerating; they slow down
    before bends, and the distance to the lane's middle fades. People on foot, and
    tracks without a lane near in their direction, have free samples alone, as all have
    where the task shows no lanes. ``noise``, ``past`` and ``draws``: of
    `KinematicPredictor`; draws take other quantiles.
    """

    def futures(self, frame: Frame, track: Ints, draw: Ints, samples: int) -> Floats:
        """Draw futures [Q, samples, T, 2], absolute x y, of tracks.

        ``track`` [Q]: their numbers; ``draw`` [Q] picks the random numbers.
        """
        futures = super().futures(frame, track, draw, samples)
        lane_samples = round(LANE_SHARE * samples)
        if not self._task.lanes or not lane_samples or not len(track):
            return futures
        state = self.states(frame.tracks)
        tau = self._task.dt * np.arange(1, self._task.future + 1)
        box_heading = frame.tracks.box[:, 3]
        place, velocity = absolute(state, box_heading)
        speed = np.linalg.norm(velocity, axis=1)
        heading = np.where(
            speed > _MIN_SPEED_MPS,
            np.arctan2(velocity[:, 1], velocity[:, 0]),
            box_heading,
        )
        deviation = _distance_deviations(state, speed, tau)
        path_m = speed * tau[-1] + _MAX_DEVIATIONS * deviation[:, -1]
        path_m = np.clip(path_m, 2 * STEP, _MAX_PATH_M)
        is_walking = np.isin(self._task.classes, _WALKING_CLASSES)
        place[is_walking[frame.tracks.class_id]] = np.inf  # on no lane
        paths = lane_paths(frame.seen[-1], place, heading, _MAX_PATHS, path_m)
        limit = np.empty(paths.points.shape[:3])
        bend_limits(paths.points, paths.chance, limit)
        drive(
            paths.points,
            paths.chance,
            paths.offset,
            limit,
            speed,
            deviation,
            track,
            draw,
            tau,
            futures[:, :lane_samples],
        )
        return futures


def _distance_deviations(state: Floats, speed: Floats, tau: Floats) -> Floats:
    """Return standard deviations [N, T] of the distance along the lane.

    ``tau`` [T]: s from now. Columns 2 to 4 of the state are the Cholesky factor of
    position and velocity along the heading, column 5 is the acceleration's deviation.
    """
    place = state[:, 2, None]
    cross = state[:, 3, None]
    velocity = state[:, 4, None]
    acceleration = np.maximum(
        state[:, 5], _STANDING_DEVIATION_MPS2 + _DEVIATION_PER_SPEED_HZ * speed
    )[:, None]
    variance = (
        (place + tau * cross) ** 2
        + (tau * velocity) ** 2
        + (0.5 * tau**2 * acceleration) ** 2
    )
    return np.asarray(np.sqrt(variance))


@kernel("void(f8[:, :, :, ::1], f8[:, ::1], f8[:, :, ::1])")
def bend_limits(paths: Floats, chance: Floats, limit: Floats) -> None:
    """Write the usual speeds: slow in bends and before them.

    ``limit`` [N, M, S], m/s, on paths [N, M, S, 2]. Paths end at a chance [N, M] of 0.
    """
    for n in range(len(paths)):
        for m in range(paths.shape[1]):
            if chance[n, m] <= 0:
                break
            path = paths[n, m]
            speed = limit[n, m]
            end = len(path) - 1
            for s in range(len(path)):
                a = path[max(s - 2, 0)]
                b = path[s]
                c = path[min(s + 2, end)]
                ux = b[0] - a[0]
                uy = b[1] - a[1]
                vx = c[0] - b[0]
                vy = c[1] - b[1]
                curvature = 0.0
                if 0 < s < end:  # at the ends atan2(0, -0) is pi
                    turn = abs(np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy))
                    # the middles of the two chords are so far apart
                    curvature = turn / (2 * STEP)
                speed[s] = np.sqrt(_LATERAL_MPS2 / max(curvature, _MIN_CURVATURE))
            for s in range(end - 1, -1, -1):
                braking_speed = np.sqrt(
                    speed[s + 1] ** 2 + 2 * _BEND_BRAKING_MPS2 * STEP
                )
                speed[s] = min(speed[s], braking_speed)


@part
def _follow(
    path: Floats,
    limit: Floats,
    offset: float,
    speed: float,
    ahead: Floats,
    tau: Floats,
    places: Floats,
) -> None:
    """Write places [T, 2] on a path [S, 2].

    ``ahead`` [T]: distances at times ``tau`` [T] on a straight road, with ``speed`` at
    the beginning. Beyond ``limit`` [S] the object brakes. It is ``offset`` m left of
    the path at first.
    """
    arc = 0.0
    old_ahead = 0.0
    old_tau = 0.0
    for t in range(len(tau)):
        period = tau[t] - old_tau
        g = min(int(arc / STEP), len(path) - 1)
        free_speed = max(ahead[t] - old_ahead, 0.0) / period
        old_ahead = max(ahead[t], old_ahead)
        old_tau = tau[t]
        braking_speed = speed - _MAX_BRAKING_MPS2 * period
        # no faster than the limit, unless the object cannot brake that hard
        speed = max(min(free_speed, limit[g]), min(free_speed, braking_speed))
        arc += speed * period
        g = min(int(arc / STEP), len(path) - 2)
        ux = (path[g + 1, 0] - path[g, 0]) / STEP
        uy = (path[g + 1, 1] - path[g, 1]) / STEP
        lateral = offset * np.exp(-arc / _FADING_M)
        places[t, 0] = path[g, 0] + (arc - STEP * g) * ux - lateral * uy
        places[t, 1] = path[g, 1] + (arc - STEP * g) * uy + lateral * ux


@part
def _normal_quantile(probability: float) -> float:
    """Return a quantile of a nearly normal distribution, limited."""
    z = np.log(probability / (1 - probability)) / _LOGISTIC_SCALE
    return float(min(max(z, -_MAX_DEVIATIONS), _MAX_DEVIATIONS))


@kernel(
    "void(f8[:, :, :, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8[::1], "
    "f8[:, ::1], i8[::1], i8[::1], f8[::1], f8[:, :, :, :])"
)
def drive(
    paths: Floats,
    chance: Floats,
    offset: Floats,
    limit: Floats,
    speed: Floats,
    deviation: Floats,
    track: Ints,
    draw: Ints,
    tau: Floats,
    samples: Floats,
) -> None:
    """Write samples [Q, A, T, 2] of tracks that have paths.

    Paths share the samples; those of a path are quantiles of the distance. ``track``
    [Q]: numbers of the tracks; ``draw`` [Q] picks the quantiles; ``paths`` [N, M, S, 2]
    with ``chance``, ``offset`` and ``limit``; ``speed`` [N]; ``deviation`` [N, T]: of
    the distance at times ``tau`` [T].
    """
    count = samples.shape[1]
    ahead = np.empty(len(tau))
    for q in range(len(track)):
        n = track[q]
        total = 0.0
        start = 0
        path_shift = (0.5 + draw[q] * _SEQUENCE_STEPS[0]) % 1.0
        level_shift = (0.5 + draw[q] * _SEQUENCE_STEPS[1]) % 1.0
        for m in range(paths.shape[1]):
            if chance[n, m] <= 0:
                break
            total += chance[n, m]
            # systematic sampling: as many samples as its chance, rounded by the shift
            end = int(np.ceil(total * count - path_shift - _ROUNDING))
            end = min(max(end, start), count)
            for j in range(start, end):
                z = _normal_quantile((j - start + level_shift) / (end - start))
                for t in range(len(tau)):
                    ahead[t] = tau[t] * speed[n] + z * deviation[n, t]
                _follow(
                    paths[n, m],
                    limit[n, m],
                    float(offset[n, m]),
                    float(speed[n]),
                    ahead,
                    tau,
                    samples[q, j],
                )
            start = end
