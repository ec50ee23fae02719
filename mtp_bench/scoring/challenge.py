"""The metrics of the nuScenes prediction challenge, as its devkit defines them (``compute_metrics``).

Forecasts of known objects from ground-truth tracks: no object is tracked or missed. The numbers are comparable with
those of the challenge, not with those of this benchmark. OffRoadRate needs the map and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import ShapeError
from ..types import Floats

KS = (1, 5, 10)
TOLERANCE = 2.0  # m: a mode misses if it is so far off, or farther, in any frame


@dataclass(frozen=True, eq=False)
class ChallengeErrors:
    """Errors of n predictions, each over its k most probable modes, or over all if it has fewer, for each k of KS."""

    min_ade: Floats  # [n, len(KS)] m
    min_fde: Floats  # [n, len(KS)] m
    miss: Floats  # [n, len(KS)] 1 where all of these modes miss by 2 m or more in some frame, else 0

    def means(self) -> dict[str, list[float | None]]:
        """Means over the predictions by the challenge's names; None without any."""
        named = {"MinADEK": self.min_ade, "MinFDEK": self.min_fde, "MissRateTopK_2": self.miss}
        return {
            name: [float(value) for value in table.mean(axis=0)] if len(table) else [None] * len(KS)
            for name, table in named.items()
        }


def challenge_errors(
    modes: Sequence[Floats], truth: Sequence[Floats], probability: Sequence[Floats]
) -> ChallengeErrors:
    """Errors of n predictions.

    ``modes``: n of [S, T, 2] m, S may differ. ``truth``: n of [T, 2] m. ``probability``: n of [S]; of equal ones the
    later mode counts as the more probable (the devkit leaves it to the sort). Raises ShapeError for shapes that do not
    fit.
    """
    table = np.zeros((3, len(modes), len(KS)))
    for at, (guess, true, chance) in enumerate(zip(modes, truth, probability, strict=True)):
        if np.shape(guess)[1:] != np.shape(true) or np.shape(chance) != np.shape(guess)[:1] or not len(guess):
            raise ShapeError(
                f"prediction {at} has shape {np.shape(guess)} with {np.shape(chance)} probabilities, expected "
                f"{('S', *np.shape(true))} with S of them, S at least 1"
            )
        distance = np.linalg.norm(np.asarray(guess) - true, axis=-1)[np.argsort(chance, kind="stable")[::-1]]
        each = np.stack([distance.mean(axis=1), distance[:, -1], distance.max(axis=1) >= TOLERANCE])
        best = np.minimum.accumulate(each, axis=1)
        table[:, at] = best[:, [min(k, len(guess)) - 1 for k in KS]]
    return ChallengeErrors(*table)
