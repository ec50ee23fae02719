"""The same scenes under a motion that nobody could know: an agent that tracks and predicts scores alike.

The seeds of a record are public, and with them how its scenes were turned and shifted: a table made for just those
motions would score. It does not under another one.
"""

from __future__ import annotations

import secrets

from .differences import Difference
from .record import Record
from .running import Plan, evaluate_plan, run_seed

ALIKE = 0.1  # share of the error by which other draws may be worse; a baseline's seeds differ by 0.06 at most
_NEGLIGIBLE = 1e-3  # m
_FIRST, _SEEDS = 1 << 16, 1 << 31  # far from what anybody counts up to


def error_when_moved(plan: Plan) -> float | None:
    """Missing-aware error of the submission of ``plan`` under one secret seed, metres; None without a target."""
    seed = _FIRST + secrets.randbelow(_SEEDS - _FIRST)
    return evaluate_plan(plan, {seed: run_seed(plan, seed)}).rows[0].missing_aware


def worse_when_moved(record: Record, error: float | None) -> Difference | None:
    """What differs where ``error`` is worse than what the record is ranked by; None where they are alike.

    The worst of its seeds would be no measure: a table for the others, and nothing for that one, would pass.
    """
    ranked = record.row.missing_aware
    if error is None or ranked is None or error <= ranked * (1 + ALIKE) + _NEGLIGIBLE:
        return None
    return Difference("missing_aware under another motion", ranked, error)
