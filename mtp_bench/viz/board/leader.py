"""Who is best on the first environment, by how much, and how sure: for those who have ten seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...records.ranking import difference_of
from ...scoring.statistics import PairedDifference
from .entries import Entry, by_env
from .lines import p_value
from .order import short_name

_NAMED = 3


def leader_of(entries: Sequence[Entry], ids: Mapping[Entry, str]) -> dict[str, Any] | None:
    """What the head of the page says; None where the first environment ranks nobody."""
    first = next(iter(by_env(entries).values()), [])
    ranked = [entry for entry in first if entry.rank is not None]
    best = [entry for entry in ranked if entry.rank == 1]
    if not best:
        return None
    leader, row = best[0], best[0].row
    following = ranked[len(best)] if len(ranked) > len(best) else None
    return {
        "env": leader.env,
        "name": short_name(leader.env),
        "first": [(entry, ids[entry]) for entry in best[:_NAMED]],
        "more": len(best[_NAMED:]),
        "error": f"{leader.error:.3f}",
        "less_stp": _said(leader.difference()),
        "next": None if following is None else (following, ids[following]),
        "less_next": None if following is None else _said(difference_of(leader, following, "all")),
        "ranked": len(ranked),
        "targets": f"{row.targets:,}".replace(",", " "),
        "scenes": row.scenes,
    }


def _said(less: PairedDifference | None) -> dict[str, str] | None:
    """How much lower, or how much higher, and how sure that is; None where nobody knows."""
    if less is None or less.interval is None:
        return None
    sign = -1 if less.mean < 0 else 1
    low, high = sorted(sign * end for end in less.interval)
    return {
        "by": f"{abs(less.mean):.3f} m {'lower' if less.mean < 0 else 'higher'}",
        "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
        "p": f"p {p_value(less.p)}",
    }
