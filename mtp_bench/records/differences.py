"""In what two contents of JSON differ."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative


class Difference(NamedTuple):
    """Something that a record says and that was found to be otherwise."""

    what: str
    recorded: Any
    found: Any


def unequal(where: str, recorded: Any, found: Any) -> Iterator[Difference]:
    """The leaves in which two contents of JSON differ, numbers by more than TOLERANCE."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for name in dict.fromkeys([*recorded, *found]):
            path = f"{where}.{name}" if where else name
            yield from unequal(path, recorded.get(name), found.get(name))
    elif isinstance(recorded, list) and isinstance(found, list) and len(recorded) == len(found):
        for index, (one, other) in enumerate(zip(recorded, found, strict=True)):
            yield from unequal(f"{where}[{index}]", one, other)
    elif not _same(recorded, found):
        yield Difference(where, recorded, found)


def _same(recorded: Any, found: Any) -> bool:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (recorded, found))
    if numbers:
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(recorded) is type(found) and bool(recorded == found)
