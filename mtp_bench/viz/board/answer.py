"""The answer of a table in a few sentences: the best entry, how sure that is, and what runs it."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...records.held_back import difference_of
from ...scoring.statistics import PairedDifference
from .entries import Entry


def answer_of(entries: Sequence[Entry], ids: Mapping[Entry, str]) -> dict[str, Any] | None:
    """Content of the template ``answer.html`` for one table; None where no entry compares with others.

    Without ranks the first one is that of the lowest bADE on the public scenes.
    """
    compared = [entry for entry in entries if entry.compared and entry.error is not None]
    if not compared:
        return None
    ranked = [entry for entry in compared if entry.place is not None]
    first, span = compared[0], compared[0].standing.places["all"].span
    following = next((entry for entry in ranked if not entry.among_best), None)
    return {
        "entry": first,
        "id": ids[first],
        "env": short_name(first.env),
        "equals": [(entry, ids[entry]) for entry in ranked[1:] if entry.among_best],
        "others": len(ranked) - 1,
        "worse": 0 if span is None else len(ranked) - span[1],
        "less_stp": _lead(first.difference()),
        "next": None if following is None else (following, ids[following]),
        "less_next": None if following is None else _lead(difference_of(first, following, "all")),
    }


def short_name(env_id: str) -> str:
    """Short form of an id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")


def _lead(difference: PairedDifference | None) -> dict[str, str] | None:
    """Size and direction of a difference in words, with its interval and p; None without an interval."""
    if difference is None or difference.interval is None:
        return None
    sign = -1 if difference.mean < 0 else 1
    low, high = sorted(sign * end for end in difference.interval)
    return {
        "by": f"{abs(difference.mean):.3f} m {'lower' if difference.mean < 0 else 'higher'}",
        "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
        "p": f"p {p_value(difference.p)}",
    }


def p_value(p: float) -> str:
    """A p-value as text: "= .034", or "< .001" for a smaller one."""
    return "< .001" if p < 0.001 else "= " + f"{p:.3f}".removeprefix("0")
