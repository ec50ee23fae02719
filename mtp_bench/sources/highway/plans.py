"""What the simulated content makes of a place: sizes in metres, limits in m/s, and who takes which way.

A change of any of these changes the worlds: then ``GENERATOR`` in ``section.py`` gets its next number.
"""

from __future__ import annotations

APPROACH = 105.0  # length of the arms of a junction
STRIP = 2.5  # beside the lanes of the arms, where cars park
ARMS = (1.0, 0.35, 1.0, 0.35)  # how often vehicles come from each
TURNS = (0.235, 1.0, 0.57)  # how often they go left, ahead, right at the intersection
QUARTERS = (0.6, 1.0, 0.4)  # or a quarter, two and three around the roundabout
STREET = 9.0  # limit of the arms
BENDS = (4.8, 3.4)  # limits of left and right turns
RING = 24.0  # radius of the roundabout's ring
ENTRY = 20.0  # radius of its entries and exits
AROUND = (4.4, 5.0, 5.3)  # limits of the entries, the ring and the exits
ASK_TIME = 4.0  # s before the line, at which drivers ask for the right to pass, and some metres earlier
STRAIGHT_ON = 0.8  # share of the people on foot who come along the road that they do not cross
WARM_UP = 10.0  # s before the record begins
FILLED = (0.95, 0.25)  # share of the entry lanes that is filled at first: junctions, fast roads
LEAVING = 0.4  # share of the first vehicles at a junction that have passed it
