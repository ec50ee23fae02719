"""Order of environments on a leaderboard."""

from __future__ import annotations

from functools import cache

from ..._bundle import card_ids
from ...cards import load_card

_LAST = 1000  # behind all envs whose card states a place


@cache
def env_place(env_id: str) -> tuple[int, str]:
    """Sort key of environments: the place that the card states, then recorded ones, then simulated ones."""
    place = load_card(env_id).board if env_id in card_ids() else None
    return _LAST + simulated(env_id) if place is None else place, env_id


@cache
def simulated(env_id: str) -> bool:
    """Return True if the scenes of an environment are simulated; False for one that does not ship."""
    return env_id in card_ids() and load_card(env_id).simulated


def short_name(env_id: str) -> str:
    """Short form of an id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")
