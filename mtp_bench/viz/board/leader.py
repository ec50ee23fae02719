"""Who is best on the first environment, by how much, and how sure: for those who have ten seconds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .entries import Entry, by_env
from .lines import p_value
from .order import short_name

_NAMED = 3


def leader_of(entries: Sequence[Entry], ids: Mapping[Entry, str]) -> dict[str, Any] | None:
    """What the head of the page says; None where the first environment ranks nobody."""
    first = next(iter(by_env(entries).values()), [])
    best = [entry for entry in first if entry.rank == 1]
    if not best:
        return None
    leader = best[0]
    difference, row = leader.difference(), leader.row
    said = {"difference": "", "interval": "", "p": ""}
    if difference is not None and difference.interval is not None:
        sign = -1 if difference.mean < 0 else 1  # of how much lower, or how much higher
        low, high = sorted(sign * end for end in difference.interval)
        said = {
            "difference": f"{abs(difference.mean):.3f} m {'lower' if difference.mean < 0 else 'higher'}",
            "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
            "p": f"p {p_value(difference.p)}",
        }
    return said | {
        "env": leader.env,
        "name": short_name(leader.env),
        "first": [(entry, ids[entry]) for entry in best[:_NAMED]],
        "more": len(best[_NAMED:]),
        "error": f"{leader.error:.3f}",
        "ranked": sum(entry.rank is not None for entry in first),
        "targets": f"{row.targets:,}".replace(",", " "),
        "scenes": row.scenes,
    }
