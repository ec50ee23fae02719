"""Predictor along lanes, without learning: speed profiles on the lanes of the observation, and free motion."""

import numpy as np

from ..agent import Frame
from ..core import Floats, Ints
from ..tracking import kernel, part
from .kinematic import KinematicPredictor, absolute
from .lane_paths import STEP, lane_paths

ALONG = 0.6  # share of the samples that follow lanes
_ON_FOOT = ("pedestrian",)  # classes that do not follow lanes
_PATHS = 6  # per track
_MOVING = 1.0  # m/s; slower tracks point where their box does
_LONGEST = 200.0  # m, of a path
_EVEN = (
    0.5698402909980532,
    0.7548776662466927,
)  # steps of a sequence that fills the unit square evenly (Roberts)
_FADING = 12.0  # m of the lane, over which the distance to its middle fades
_SWERVE = 2.0  # m/s2, usual lateral acceleration in bends
_BRAKING = 1.5  # m/s2, before bends
_PEDAL = (
    0.5,
    0.08,
)  # m/s2 and 1/s: deviation of the acceleration of one who stands, and what each m/s adds
_FASTEST = 2.5  # deviations of the fastest profile, at most
_HARDEST = 3.0  # m/s2, braking in samples that come to a bend too fast


class LanePredictor(KinematicPredictor):
    """Draw `ALONG` of the k samples along lanes and their successors; the others are `KinematicPredictor`'s.

    Paths share the samples by their plausibility. On a path the samples are quantiles of the distance that the motion
    noise allows, from braking to accelerating; they slow down before bends, and the distance to the lane's middle
    fades. People on foot, and tracks without a lane near in their direction, have free samples alone, as all have where
    the task shows no lanes. ``noise``, ``past`` and ``draws``: of `KinematicPredictor`; draws take other quantiles.
    """

    def futures(self, frame: Frame, track: Ints, draw: Ints, samples: int) -> Floats:
        """Futures [Q, samples, T, 2], absolute x y, of tracks ``track`` [Q]; ``draw`` [Q] picks the random numbers."""
        futures = super().futures(frame, track, draw, samples)
        along = round(ALONG * samples)
        if not self._task.lanes or not along or not len(track):
            return futures
        state = self.states(frame.tracks)
        tau = self._task.dt * np.arange(1, self._task.future + 1)
        place, velocity = absolute(state)
        speed = np.linalg.norm(velocity, axis=1)
        heading = np.where(
            speed > _MOVING,
            np.arctan2(velocity[:, 1], velocity[:, 0]),
            frame.tracks.box[:, 3],
        )
        spread = _spread(state, speed, tau)
        metres = np.clip(speed * tau[-1] + _FASTEST * spread[:, -1], 2 * STEP, _LONGEST)
        on_foot = np.array([name in _ON_FOOT for name in self._task.classes])
        place[on_foot[frame.tracks.class_id]] = np.inf  # on no lane
        found = lane_paths(frame.seen[-1], place, heading, _PATHS, metres)
        limit = np.empty(found.points.shape[:3])
        bend_limits(found.points, found.chance, limit)
        among = futures[:, :along]
        drive(
            found.points,
            found.chance,
            found.offset,
            limit,
            speed,
            spread,
            track,
            draw,
            tau,
            among,
        )
        return futures


def _spread(state: Floats, speed: Floats, tau: Floats) -> Floats:
    """Standard deviations [N, T] of the distance along the lane at the times ``tau`` [T]."""
    place, cross, velocity = (
        state[:, i, None] for i in (2, 3, 4)
    )  # Cholesky factor along the heading
    pedal = np.maximum(state[:, 5], _PEDAL[0] + _PEDAL[1] * speed)[:, None]
    return np.asarray(
        np.sqrt(
            (place + tau * cross) ** 2
            + (tau * velocity) ** 2
            + (0.5 * tau**2 * pedal) ** 2
        )
    )


@kernel("void(f8[:, :, :, ::1], f8[:, ::1], f8[:, :, ::1])")
def bend_limits(paths: Floats, chance: Floats, limit: Floats) -> None:
    """Write the usual speeds [N, M, S], m/s, on paths [N, M, S, 2] of chance [N, M]: slow in bends and before them."""
    for n in range(len(paths)):
        for m in range(paths.shape[1]):
            if chance[n, m] <= 0:
                break
            path = paths[n, m]
            speed = limit[n, m]
            for s in range(len(path)):
                a = path[max(s - 2, 0)]
                b = path[s]
                c = path[min(s + 2, len(path) - 1)]
                ux = b[0] - a[0]
                uy = b[1] - a[1]
                vx = c[0] - b[0]
                vy = c[1] - b[1]
                turn = abs(np.arctan2(ux * vy - uy * vx, ux * vx + uy * vy))
                bend = (
                    turn / (2 * STEP) if 0 < s < len(path) - 1 else 0.0
                )  # atan2(0, -0) is pi
                speed[s] = np.sqrt(_SWERVE / max(bend, 1e-4))
            for s in range(len(path) - 2, -1, -1):
                speed[s] = min(
                    speed[s], np.sqrt(speed[s + 1] ** 2 + 2 * _BRAKING * STEP)
                )


@part
def _follow(
    path: Floats,
    limit: Floats,
    offset: Floats,
    speed: float,
    ahead: Floats,
    tau: Floats,
    out: Floats,
) -> None:
    """Write places [T, 2] on a path [S, 2] for distances ``ahead`` [T] on a straight road, slower where it bends."""
    arc = 0.0
    before = 0.0
    last = 0.0
    now = speed
    for t in range(len(tau)):
        period = tau[t] - last
        g = min(int(arc / STEP), len(path) - 1)
        wanted = max(ahead[t] - before, 0.0) / period
        before = max(ahead[t], before)
        last = tau[t]
        now = max(min(wanted, limit[g]), min(wanted, now - _HARDEST * period))
        arc += now * period
        g = min(int(arc / STEP), len(path) - 2)
        ux = (path[g + 1, 0] - path[g, 0]) / STEP
        uy = (path[g + 1, 1] - path[g, 1]) / STEP
        aside = offset * np.exp(-arc / _FADING)
        out[t, 0] = path[g, 0] + (arc - STEP * g) * ux - aside * uy
        out[t, 1] = path[g, 1] + (arc - STEP * g) * uy + aside * ux


@kernel(
    "void(f8[:, :, :, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8[::1], f8[:, ::1], i8[::1], i8[::1], f8[::1], "
    "f8[:, :, :, :])"
)
def drive(
    paths: Floats,
    chance: Floats,
    offset: Floats,
    limit: Floats,
    speed: Floats,
    spread: Floats,
    track: Ints,
    draw: Ints,
    tau: Floats,
    samples: Floats,
) -> None:
    """Write samples [Q, A, T, 2] of tracks ``track`` [Q] that have paths: shares of paths, quantiles of the distance.

    ``paths`` [N, M, S, 2] with ``chance``, ``offset`` and ``limit``; ``speed`` [N], ``spread`` [N, T]: of the distance.
    """
    count = samples.shape[1]
    ahead = np.empty(len(tau))
    for q in range(len(track)):
        n = track[q]
        total = 0.0
        done = 0
        share = (0.5 + draw[q] * _EVEN[0]) % 1.0
        level = (0.5 + draw[q] * _EVEN[1]) % 1.0
        for m in range(paths.shape[1]):
            if chance[n, m] <= 0:
                break
            total += chance[n, m]
            upto = min(max(int(np.ceil(total * count - share - 1e-9)), done), count)
            for j in range(upto - done):
                quantile = (j + level) / (upto - done)
                z = min(
                    max(np.log(quantile / (1 - quantile)) / 1.702, -_FASTEST), _FASTEST
                )  # nearly normal
                for t in range(len(tau)):
                    ahead[t] = tau[t] * speed[n] + z * spread[n, t]
                _follow(
                    paths[n, m],
                    limit[n, m],
                    offset[n, m],
                    float(speed[n]),
                    ahead,
                    tau,
                    samples[q, done + j],
                )
            done = upto
