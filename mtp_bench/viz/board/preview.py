"""The picture that other pages show of the leaderboard: the best of its first environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...files import clean_text
from .entries import Entry, by_env
from .order import short_name

_ROWS = 5
_WIDTH = 400  # of the longest bar
_NAME = 24  # letters that fit beside the bars


def preview_rows(entries: Sequence[Entry]) -> dict[str, Any]:
    """What the template of the picture shows: without a ranked entry no rows."""
    first = next(iter(by_env(entries).values()), [])
    ranked = [entry for entry in first if entry.rank is not None and entry.error is not None][:_ROWS]
    most = max((entry.error or 0.0 for entry in ranked), default=0.0) or 1.0
    return {
        "env": short_name(first[0].env) if first else "",
        "rows": [
            {
                "rank": entry.rank,
                "name": clean_text(entry.name, _NAME),
                "width": round(_WIDTH * (entry.error or 0.0) / most),
                "error": f"{entry.error:.3f}",
            }
            for entry in ranked
        ],
    }
