"""What each version of the simulated content makes of a place: its sizes, its limits, and who takes which way."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """Sizes in metres, limits in m/s, and how often a way is taken."""

    approach: float = 75.0  # of the arms of a junction
    strip: float = 0.0  # beside the lanes of the arms, where cars park
    arms: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)  # how often vehicles come from each
    turns: tuple[float, float, float] = (0.7, 1.0, 0.8)  # how often they go left, ahead, right at the intersection
    quarters: tuple[float, float, float] = (0.8, 1.0, 0.7)  # or a quarter, two and three around the roundabout
    street: float = 11.0  # limit of the arms
    bends: tuple[float, float] = (7.5, 5.5)  # limits of left and right turns
    ring: float = 20.0  # radius of the roundabout's ring
    entry: float = 14.0  # radius of its entries and exits
    around: tuple[float, float, float] = (6.5, 7.5, 7.0)  # limits of the entries, the ring and the exits
    ask_time: float = 2.0  # s before the line, at which drivers ask for the right to pass
    straight_on: float = 0.5  # share of the people on foot who come along the road that they do not cross
    warm_up: float = 15.0  # s before the record begins
    filled: tuple[float, float] = (0.6, 0.25)  # share of the entry lanes that is filled at first: junctions, fast roads
    leaving: float = 0.0  # share of the first vehicles at a junction that have passed it


PLANS = {
    1: Plan(),
    2: Plan(
        approach=105.0,
        strip=2.5,
        arms=(1.0, 0.35, 1.0, 0.35),
        turns=(0.235, 1.0, 0.57),
        quarters=(0.6, 1.0, 0.4),
        street=9.0,
        bends=(4.8, 3.4),
        ring=24.0,
        entry=20.0,
        around=(4.4, 5.0, 5.3),
        ask_time=4.0,
        straight_on=0.8,
        warm_up=10.0,
        filled=(0.95, 0.25),
        leaving=0.4,
    ),
}  # by generator
