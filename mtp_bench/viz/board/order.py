"""The order of environments on a leaderboard: those of the paper, other recorded ones, then simulated ones."""

from __future__ import annotations

from functools import cache

from ..._bundle import card_ids
from ...cards import load_card

PAPER = (
    "MTP-nuScenes-v0",
    "MTP-nuScenes-CenterPoint-v0",
    "MTP-nuScenes-mini-v0",
    "MTP-KITTI-v0",
    "MTP-KITTI-noego-v0",
    "MTP-KITTI-5Hz-v0",
    "MTP-WILDTRACK-v0",
    "MTP-WILDTRACK-k10-v0",
    "MTP-PETS-v0",
)


def env_place(env_id: str) -> tuple[int, str]:
    """What environments are sorted by."""
    if env_id in PAPER:
        return PAPER.index(env_id), env_id
    return len(PAPER) + simulated(env_id), env_id


@cache
def simulated(env_id: str) -> bool:
    """Whether an environment that ships makes its scenes itself; False for one that does not ship."""
    return env_id in card_ids() and load_card(env_id).simulated


def short_name(env_id: str) -> str:
    """The id without what all ids have: "nuScenes mini" of MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")
