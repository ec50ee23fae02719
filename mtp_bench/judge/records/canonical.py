"""Canonical JSON, its digests and its differences: equal contents have equal bytes."""

import datetime
import hashlib
import json
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative


def canonical(content: Any) -> bytes:
    """Return JSON with sorted keys and without spaces, UTF-8.

    Raises ValueError for NaN and for half of a surrogate pair.
    """
    text = json.dumps(
        content,
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=False,
        allow_nan=False,
    )
    return text.encode()


def digest_of(content: Any) -> str:
    """Return the hex sha256 of the canonical JSON.

    Raises ValueError as `canonical`.
    """
    return hashlib.sha256(canonical(content)).hexdigest()


def today(days: int = 0) -> str:
    """Return the date in UTC some ``days`` from today, as YYYY-MM-DD."""
    date = datetime.datetime.now(datetime.UTC).date()
    return (date + datetime.timedelta(days)).isoformat()


def rounded(value: Any, spec: str = ".12g") -> Any:
    """Round the numbers of JSON as the format ``spec`` does.

    By default to 12 digits, a thousand times finer than TOLERANCE: the last digits of a
    product of matrices differ between machines.
    """
    if isinstance(value, dict):
        return {name: rounded(item, spec) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(rounded(item, spec) for item in value)
    return float(format(value, spec)) if isinstance(value, float) else value


class Difference(NamedTuple):
    """A value of a record, and the different value that another run gave."""

    what: str
    recorded: Any
    found: Any


def differences(where: str, recorded: Any, repeated: Any) -> Iterator[Difference]:
    """Yield the values in which two contents of JSON differ, numbers by over TOLERANCE.

    Each has its path below ``where``.
    """
    kinds = {type(recorded), type(repeated)}
    if kinds == {dict}:
        for name in dict.fromkeys([*recorded, *repeated]):
            path = f"{where}.{name}".removeprefix(".")
            yield from differences(path, recorded.get(name), repeated.get(name))
    elif kinds == {list} and len(recorded) == len(repeated):
        for index, item in enumerate(recorded):
            yield from differences(f"{where}[{index}]", item, repeated[index])
    elif not _are_equal(recorded, repeated):
        yield Difference(where, recorded, repeated)


def _are_equal(recorded: Any, repeated: Any) -> bool:
    if _is_number(recorded) and _is_number(repeated):
        return math.isclose(recorded, repeated, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(recorded) is type(repeated) and bool(recorded == repeated)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
