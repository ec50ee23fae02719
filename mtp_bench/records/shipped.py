"""What ships for an env, which alone ranks: its card, and the frozen event weights of its scenes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from .._bundle import baseline_names, card_ids
from ..cards import Card, load_card
from ..running.reference import frozen_reference
from ..scoring import Reference
from ..scoring.subsets import SUBSETS, Subset
from ..submission.contents import digest_of, files_of
from ..submission.loader import load_submission


@dataclass(frozen=True)
class Shipped:
    """An env as it ships."""

    card: str  # digest
    simulated: bool  # hidden scenes rank
    most: float  # m, the largest error of a target
    weights: str  # hash of the frozen event weights
    sums: Mapping[str, Mapping[Subset, float]]  # `scene_key` -> weight of the targets of a scene on each subset


@cache
def shipped(env_id: str) -> Shipped | None:
    """The env of this id; None where none ships, or without frozen event weights.

    Raises DataError where the file of the weights is broken.
    """
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    frozen = frozen_reference(card)
    if frozen is None:
        return None
    return Shipped(card.digest, card.simulated, largest_error(card), frozen.digest, _sums(frozen))


def largest_error(card: Card) -> float:
    """Largest error of a target, metres: what it costs to say nothing about it."""
    return max(card.per_class(card.task.miss_error))


def baseline_digest(name: str, networks: Mapping[str, str] | None = None) -> str | None:
    """Digest of the baseline of that name as it ships, with weights that were trained for it; None for other names."""
    return _digest(name, tuple(sorted((networks or {}).items())))


@cache  # a leaderboard asks again for every subset
def _digest(name: str, networks: tuple[tuple[str, str], ...]) -> str | None:
    if name not in baseline_names():
        return None
    folder = load_submission(name).path
    return digest_of(folder, files_of(folder), dict(networks))


@cache
def baseline_networks(name: str) -> tuple[str, ...]:
    """Networks that the manifest of the baseline of that name takes, such as modes-truth; none for other names."""
    return load_submission(name).networks if name in baseline_names() else ()


def _sums(reference: Reference) -> dict[str, dict[Subset, float]]:
    """As `Reference.weight` of every scene, summed; the scenes are known by their keys alone."""
    found: dict[str, dict[Subset, float]] = {}
    for key, scene in reference.scenes.items():
        ids, lost, back, frag = (scene.counts.sum(axis=0, dtype=np.int64) / reference.runs).tolist()
        paper_ids, paper_frag = scene.stp[:, 0].sum(), (scene.stp[:, 1] | scene.stp[:, 2]).sum()
        values = (scene.targets, ids, lost, back, frag, paper_ids, paper_frag)
        found[key] = dict(zip(SUBSETS, map(float, values), strict=True))
    return found
