"""The events that defined subsets up to 1.0: made from the reference baseline's run; nothing is frozen any more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..cards import Card
from ..scoring import ReferenceSubsets, SceneScore, reference_subsets

KINDS = ("ids", "lost", "reacquired")  # of events


@dataclass(frozen=True)
class Reference:
    """Subsets of targets and where they come from."""

    subsets: ReferenceSubsets
    frozen: bool  # False: made in this run, for a split or data without a frozen file
    differing: int = 0  # events in which this run's own reference differs from the frozen one

    @property
    def origin(self) -> str:
        """One sentence for the report."""
        name, short = self.subsets.reference, self.subsets.hash[:12]
        if not self.frozen:
            return f"subsets from the events of {name!r} in this run (hash {short}), not the frozen ones of a ranking"
        text = f"frozen subsets of {name!r} (hash {short})"
        if not self.differing:
            return text
        events = "1 event" if self.differing == 1 else f"{self.differing} events"
        return f"{text}; {name!r} on this machine differs in {events}"


def frozen_reference(card: Card) -> Reference | None:
    """None: the frozen files hold event weights now (`running.reference`)."""
    return None


def find_reference(card: Card, scores: Sequence[SceneScore]) -> Reference:
    """The frozen subsets of ``card``, else those of ``scores``, the scenes of the reference baseline.

    Raises DataError or CardError where the frozen file is broken.
    """
    made = reference_subsets(scores, card)
    reference = frozen_reference(card)
    if reference is None:
        return Reference(made, frozen=False)
    frozen = reference.subsets
    here = np.concatenate([score.truth_key for score in scores]) if scores else np.zeros(0, dtype=np.int64)
    differing = sum(len(np.setxor1d(made.keys(kind), np.intersect1d(frozen.keys(kind), here))) for kind in KINDS)
    return Reference(frozen, frozen=True, differing=differing)


def reference_of(card: Card, scores: Sequence[SceneScore], name: str) -> Reference:
    """The events of an agent other than the card's reference baseline."""
    return Reference(replace(reference_subsets(scores, card), reference=name), frozen=False)
