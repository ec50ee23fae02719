"""Cost of an identity switch near the ego: windows after a switch against matched windows without one.

A window of `SECONDS` begins at each frame of a drive; windows that the end of the drive cuts short are left out, unless
that is a collision at fault. Exposed windows begin with a switch near the ego. They are compared with windows of the
same agent with as many objects near, at the same speed and time (strata), by the difference of Mantel and Haenszel:
a stratum weighs n1 n0 / (n1 + n0). The others are of two kinds: without a switch in the window, as one would ask at
first, or in the `SECONDS` before it. The first kind is chosen by what happens later: a collision ends a window and
leaves less time for switches, so that switches seem to prevent collisions where they do nothing. The second kind has no
such bias, but later switches in both make a cost look smaller. Intervals resample scenes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.driving_measure import Array, Kept
from mtp_bench.core import HARD_BRAKING, Bools, Ints
from mtp_bench.traffic.highway.world import RATE

SECONDS = 4.0  # of a window
LOST = "way lost"  # m, less than at the speed at the start; the other outcomes happen or not
OBJECTS, SPEEDS, TIMES = (
    (4, 8, 12, 16),
    (1.0, 4.0, 8.0),
    (5.0, 10.0, 20.0),
)  # edges of strata: number, m/s, s
RESAMPLES = 2000
POWER = (
    1.960 + 0.842
)  # standard errors of a difference that a two-sided test at 5 % finds four times out of five


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows [n] of some drives."""

    scene: Ints
    stratum: Ints
    switch: Bools  # begins with a switch
    free: Mapping[str, Bools]  # by kind: without a switch
    outcome: Mapping[str, Array]  # 0 or 1: it happens in the window; for LOST m

    @classmethod
    def of(
        cls, kept: Kept, dt: float, scene: int, agent: int, ahead: bool = False
    ) -> Windows:
        """The windows of a drive; ``dt``: s between frames; ``ahead``: only switches ahead of the ego count."""
        drive, moments = kept.drive, kept.moments
        switches, start, length = (
            moments.switches(ahead) > 0,
            np.arange(len(moments.speed)) * dt,
            round(SECONDS / dt),
        )
        binned = ((moments.objects, OBJECTS), (moments.speed, SPEEDS), (start, TIMES))
        stratum = np.full(len(start), agent)
        for value, edges in binned:
            stratum = stratum * (len(edges) + 1) + np.digitize(value, edges)
        before = np.array(
            [switches[max(0, t - length) : t + 1].any() for t in range(len(start))]
        )
        within = np.array(
            [switches[t : t + length + 1].any() for t in range(len(start))]
        )
        times = {
            "collision at fault": np.array([drive.seconds] if drive.at_fault else []),
            "near miss": moments.missed,
            "phantom brake": moments.phantom,
            "hard brake": np.flatnonzero(drive.acceleration < HARD_BRAKING) / RATE,
        }
        outcome = {name: _within(start, seconds) for name, seconds in times.items()}
        outcome[LOST] = _lost(start, moments.speed, drive.acceleration)
        known = (start + SECONDS <= drive.seconds + 1e-9) | (
            bool(drive.at_fault) & (start < drive.seconds)
        )
        found = {"no switch in it": ~within, "no switch before it": ~before}
        return cls(
            np.full(int(known.sum()), scene),
            stratum[known],
            switches[known],
            {name: mask[known] for name, mask in found.items()},
            {name: mask[known] for name, mask in outcome.items()},
        )

    @classmethod
    def joined(cls, parts: Iterable[Windows]) -> Windows:
        """All windows of ``parts``."""
        every = list(parts)
        free, outcome = (
            {
                name: np.concatenate([getattr(part, field)[name] for part in every])
                for name in getattr(every[0], field)
            }
            for field in ("free", "outcome")
        )
        scene, stratum, switch = (
            np.concatenate([getattr(part, field) for part in every])
            for field in ("scene", "stratum", "switch")
        )
        return cls(scene, stratum, switch, free, outcome)


def _within(start: Array, seconds: Array) -> Array:
    """1 for windows [n] in which something happens at one of the ``seconds`` [m], else 0."""
    later = seconds[None] - start[:, None]
    return np.asarray(
        ((later >= -1e-9) & (later <= SECONDS + 1e-9)).any(axis=1).astype(float)
    )


def _lost(start: Array, speed: Array, acceleration: Array) -> Array:
    """Metres that the ego drives less in each window [n] than at its ``speed`` [n] at the start; at most to the end."""
    speeds = speed[0] + np.cumsum(np.append(0.0, acceleration)) / RATE
    way = np.append(0.0, np.cumsum(speeds)) / RATE
    first, last = (
        np.clip((t * RATE).round().astype(int), 0, len(way) - 1)
        for t in (start, start + SECONDS)
    )
    return np.asarray(speed * (last - first) / RATE - (way[last] - way[first]))


def matched_difference(
    scene: Ints, stratum: Ints, exposed: Bools, outcome: Array
) -> dict[str, Any] | None:
    """Mean ``outcome`` [n] of the exposed less that of the others in the same strata, with an interval over scenes.

    None unless a stratum holds both. ``seen``: the smallest difference that would have been seen.
    """
    scene, stratum = (
        np.unique(each, return_inverse=True)[1] for each in (scene, stratum)
    )
    shape = (scene.max(initial=0) + 1, stratum.max(initial=0) + 1)
    cell = np.ravel_multi_index((scene, stratum), shape)

    def total(weight: Array) -> Array:
        return np.bincount(cell, weights=weight, minlength=shape[0] * shape[1]).reshape(
            shape
        )

    sums = [
        total(mask * value)
        for mask in (exposed, ~exposed)
        for value in (np.ones(len(cell)), outcome)
    ]
    both = (sums[0].sum(0) > 0) & (sums[2].sum(0) > 0)
    if not both.any():
        return None
    sums = [each[:, both] for each in sums]
    with_switch, without = _pooled([each.sum(0)[None] for each in sums])
    counts = np.random.default_rng(0).multinomial(
        shape[0], np.full(shape[0], 1 / shape[0]), size=RESAMPLES
    )
    drawn = np.subtract(*_pooled([counts @ each for each in sums]))
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    rare = [
        3.0 / number.sum() * (event == 0).all()
        for number, event in (sums[:2], sums[2:])
    ]  # the rule of three
    return {
        "with": float(with_switch[0]),
        "without": float(without[0]),
        "difference": float(with_switch[0] - without[0]),
        "low": float(low - rare[1]),
        "high": float(high + rare[0]),
        "seen": max(POWER * float(np.nanstd(drawn)), float(rare[0])),
        "exposed": int(sums[0].sum()),
        "others": int(sums[2].sum()),
        "scenes": int((sums[0].sum(1) > 0).sum()),
    }


def _pooled(sums: list[Array]) -> tuple[Array, Array]:
    """Means [B] of the exposed and of the others over strata; ``sums`` [B, K]: number and outcome, of each."""
    number, event, others, without = sums
    weight = number * others / np.maximum(number + others, 1)
    size = weight.sum(1)
    size = np.where(size > 0, size, np.nan)
    first, second = event / np.maximum(number, 1), without / np.maximum(others, 1)
    return (weight * first).sum(1) / size, (weight * second).sum(1) / size


def cost_in_windows(windows: Windows) -> dict[str, dict[str, Any] | None]:
    """Differences per window, by outcome and kind of other windows."""
    found = {}
    for name, outcome in windows.outcome.items():
        for kind, free in windows.free.items():
            used = windows.switch | free
            scene, stratum, switch = (
                windows.scene[used],
                windows.stratum[used],
                windows.switch[used],
            )
            found[f"{name}, {kind}"] = matched_difference(
                scene, stratum, switch, outcome[used]
            )
    return found


def cost_in_scenes(
    switches: Array, seconds: Array, score: Array
) -> dict[str, dict[str, Any] | None]:
    """Differences of ``score`` [A, S], drive score less that of ground-truth tracks, between scenes of an agent.

    ``switches`` [A, S]: identity switches near the ego; ``seconds`` [A, S] of the drives. Scenes with a switch against
    those without, and scenes with more switches per second than the agent's median against the others.
    """
    agent, scene = np.indices(score.shape)
    rate = switches / np.maximum(seconds, 1e-9)
    splits = {
        "any switch": switches > 0,
        "more per second": rate > np.median(rate, axis=1, keepdims=True),
    }
    return {
        name: matched_difference(
            scene.ravel(), agent.ravel(), mask.ravel(), score.ravel()
        )
        for name, mask in splits.items()
    }
