"""What each version of the simulated content makes of a junction: its size, its limits, and who takes which way."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """A junction's sizes in metres, limits in m/s, and how often a way is taken."""

    approach: float = 75.0  # of the arms
    strip: float = 0.0  # beside the lanes of the arms, where cars park
    arms: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)  # how often vehicles come from each
    turns: tuple[float, float, float] = (0.7, 1.0, 0.8)  # how often they go left, ahead, right at the intersection
    quarters: tuple[float, float, float] = (0.8, 1.0, 0.7)  # or a quarter, two and three around the roundabout
    street: float = 11.0  # limit of the arms
    bends: tuple[float, float] = (7.5, 5.5)  # limits of left and right turns
    ring: float = 20.0  # radius of the roundabout's ring
    entry: float = 14.0  # radius of its entries and exits
    around: tuple[float, float, float] = (6.5, 7.5, 7.0)  # limits of the entries, the ring and the exits


PLANS = {
    1: Plan(),
    2: Plan(approach=105.0, strip=2.5, arms=(1.0, 0.3, 1.0, 0.3), turns=(0.4, 1.0, 0.4), bends=(6.0, 4.0)),
}  # by generator
