"""Folds by scene: to choose on a training split, some of its scenes are held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import MtpBenchError

Fold = tuple[int, int]  # the number of a fold, from 1 on, and how many there are


def fold_of(text: str) -> Fold:
    """The fold that "2/4" names: the second of four. Raises MtpBenchError for anything else."""
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and 1 <= int(first) <= int(second) and int(second) >= 2):
        raise MtpBenchError(f"fold is {text!r}, expected the number of a fold and how many there are, such as 1/4")
    return int(first), int(second)


def held_out(names: Sequence[str], fold: Fold) -> tuple[str, ...]:
    """The scenes of a fold, in their order: by lot, the same for the same set of names.

    Raises MtpBenchError where there is no such fold, or where there are fewer scenes than folds.
    """
    number, folds = fold
    if not 1 <= number <= folds:
        raise MtpBenchError(
            f"fold is ({number}, {folds}), expected the number of a fold and how many there are, such as (1, 4)"
        )
    if len(names) < folds:
        raise MtpBenchError(f"{len(names)} scenes cannot be cut into {folds} folds")
    lot = np.random.default_rng(0).permutation(len(names)) % folds
    mine = {name for name, drawn in zip(sorted(names), lot, strict=True) if drawn == number - 1}
    return tuple(name for name in names if name in mine)
