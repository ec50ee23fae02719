"""Colours of recordings, and one for every track; those of texts can be read on a dark and on a light ground."""

import numpy as np
from numpy.typing import NDArray

from ...types import Ints
from ..palette import BLUE, FALSE, GREEN, NOW, ORANGE, PURPLE, YELLOW, Color

Colors = NDArray[np.uint8]  # [..., 3] red green blue

# What is right or wrong has a colour of its own, which no track takes.
TRUTH = GREEN
NEUTRAL: Color = (0, 79, 58)
DETECTION = YELLOW
EGO: Color = (255, 255, 255)
CENTER: Color = (44, 44, 52)
BORDER: Color = (92, 92, 104)
UNTRACKED: Color = (84, 84, 84)
UNKNOWN: Color = (150, 150, 150)
SWITCH: Color = (235, 70, 180)
SKY: Color = (50, 145, 215)
TRACKS: tuple[Color, ...] = (  # a prime number of them: the ids of a switch seldom share one
    ORANGE, SKY, PURPLE, BLUE, (140, 150, 70), (166, 112, 0), (150, 130, 240),
)  # fmt: skip
EVENTS = {"ids": SWITCH, "lost": FALSE, "reacquired": SKY, "spurious": UNKNOWN}
ROLES: dict[str, Color] = {  # of a thing in an event
    "truth": TRUTH, "before": SKY, "now": NOW, "named": PURPLE, "detection": UNKNOWN, "ego": (140, 140, 150),
}  # fmt: skip


def track_colors(track_id: Ints) -> Colors:
    """Colour [N, 3] of each track id [N]: the same in every frame and run; grey for -1."""
    table = np.array([*TRACKS, UNKNOWN], dtype=np.uint8)
    ids = np.asarray(track_id)
    return table[np.where(ids < 0, len(TRACKS), ids % len(TRACKS))]


def packed(colors: Colors | Color) -> NDArray[np.uint32]:
    """Opaque colours [N] as one number each, from red, green, blue [N, 3]."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    number: NDArray[np.uint32] = rgb @ np.array([1 << 24, 1 << 16, 1 << 8], dtype=np.uint32) + np.uint32(255)
    return number


def pale(colors: Colors) -> Colors:
    """Lighter colours [N, 3], of names in a view: a viewer writes them on a dark ground, or on grey."""
    return np.uint8(255) - (0.36 * (255 - colors.astype(np.float64))).astype(np.uint8)
