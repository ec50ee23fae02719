"""Canonical JSON, its digests and its differences: equal contents have equal bytes."""

import datetime
import hashlib
import json
import math
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, Field

TOLERANCE = 1e-9  # of a number that is scored again, absolute and relative
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
_YYYY_MM_DD = Field(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}$")
Date = Annotated[
    str,
    _YYYY_MM_DD,
    AfterValidator(lambda text: datetime.date.fromisoformat(text).isoformat()),
]


def canonical(content: Any) -> bytes:
    """JSON with sorted keys and no spaces, UTF-8. Raises ValueError for NaN and for half of a surrogate pair."""
    text = json.dumps(
        content,
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=False,
        allow_nan=False,
    )
    return text.encode()


def digest_of(content: Any) -> str:
    """Hex sha256 of the canonical JSON; raises ValueError as `canonical`."""
    return hashlib.sha256(canonical(content)).hexdigest()


def today(days: int = 0) -> str:
    """Today's date in UTC, as YYYY-MM-DD, or that of some ``days`` later."""
    return (
        datetime.datetime.now(datetime.UTC).date() + datetime.timedelta(days)
    ).isoformat()


def rounded(value: Any) -> Any:
    """JSON with its numbers to 12 digits, a thousand times finer than TOLERANCE.

    The last digits of a product of matrices differ between machines.
    """
    if isinstance(value, dict):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(rounded, value))
    return float(f"{value:.12g}") if isinstance(value, float) else value


class Difference(NamedTuple):
    """A value of a record, and the different value that was found in its place."""

    what: str
    recorded: Any
    found: Any


def differences(where: str, recorded: Any, found: Any) -> Iterator[Difference]:
    """Values in which two contents of JSON differ, each with its path below ``where``; numbers: by over TOLERANCE."""
    if isinstance(recorded, dict) and isinstance(found, dict):
        for name in dict.fromkeys([*recorded, *found]):
            path = f"{where}.{name}" if where else name
            yield from differences(path, recorded.get(name), found.get(name))
    elif (
        isinstance(recorded, list)
        and isinstance(found, list)
        and len(recorded) == len(found)
    ):
        for index, (one, other) in enumerate(zip(recorded, found, strict=True)):
            yield from differences(f"{where}[{index}]", one, other)
    elif not _equal(recorded, found):
        yield Difference(where, recorded, found)


def _equal(recorded: Any, found: Any) -> bool:
    if all(
        isinstance(value, int | float) and not isinstance(value, bool)
        for value in (recorded, found)
    ):
        return math.isclose(recorded, found, rel_tol=TOLERANCE, abs_tol=TOLERANCE)
    return type(recorded) is type(found) and bool(recorded == found)
