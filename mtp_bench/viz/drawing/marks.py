"""How each kind of thing is outlined in a picture and in its legend.

No meaning hangs on colour alone: truth is a bold outline (dashed where it is not tracked), a detection thin, a track
filled, a false positive crossed.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..palette import DETECTION, EGO, FALSE, OTHER_TRACK, TRACK, TRUTH, Color


@dataclass(frozen=True)
class Outline:
    """How a box is drawn."""

    color: Color
    width: float = 1.0  # pixels
    fill: int = 0  # opacity of the inside, 0 (none) to 255
    dashed: bool = False
    heading: bool = False  # a tick out of the front
    crossed: bool = False


TRACKED = Outline(TRUTH, 2.0, heading=True)
UNTRACKED = Outline(TRUTH, 2.0, heading=True, dashed=True)
DETECTED = Outline(DETECTION, 1.2)
FALSE_DETECTION = Outline(DETECTION, crossed=True)
TRACK_BOX = Outline(TRACK, fill=95)
FALSE_TRACK = Outline(FALSE, fill=25)
OTHER = Outline(OTHER_TRACK, 0.8, dashed=True)
VEHICLE = Outline(EGO, 1.5, fill=200, heading=True)
