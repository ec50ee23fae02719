"""Bounds of what a record may hold, whatever its fields are: texts, numbers, depth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ..errors import RecordError
from ..files import unseen
from .record import MOST_TEXT

MOST_BYTES = 8 << 20  # of a file
MOST_DETAILS = 1 << 20  # bytes of the section ``details``
MOST_UNITS = 2_000  # of a record: blocks of 20 s
_DEEPEST = 32
_LARGEST = 1 << 53  # whole numbers beyond are not the same in every reader of JSON
_LINES = "\n\t"  # the only control characters


def out_of_bounds(content: Any, where: str = "", depth: int = 0) -> Iterator[str]:
    """What no record may hold, each in a sentence that names the place; ``content`` is as JSON was read."""
    if depth > _DEEPEST:
        yield f"{where} lies deeper than {_DEEPEST} levels"
    elif isinstance(content, dict):
        for name, value in content.items():
            yield from _text(name, f"a key of {where or 'the record'}")
            yield from out_of_bounds(value, f"{where}.{name[:40]}" if where else name[:40], depth + 1)
    elif isinstance(content, list):
        for place, value in enumerate(content):
            yield from out_of_bounds(value, f"{where}[{place}]", depth + 1)
    elif isinstance(content, str):
        yield from _text(content, where)
    elif isinstance(content, float) and not math.isfinite(content):
        yield f"{where} is {content}, expected a finite number"
    elif isinstance(content, int) and abs(content) > _LARGEST:
        yield f"{where} is a number of {len(str(abs(content)))} digits, expected at most {_LARGEST}"


def refuse(problems: Iterator[str], where: str) -> None:
    """Raise RecordError for the first problem of what was read ``where``; nothing happens where there is none."""
    for problem in problems:
        raise RecordError(f"{where}: {problem}")


def _text(text: str, where: str) -> Iterator[str]:
    if len(text) > MOST_TEXT:
        yield f"{where} has {len(text)} characters, expected at most {MOST_TEXT}"
    plain = text.isascii() and text.isprintable()  # nearly all of a record is, and signs one by one take long
    odd = None if plain else next((sign for sign in text if unseen(sign) and sign not in _LINES), None)
    if odd is not None:
        yield f"{where} has the character U+{ord(odd):04X}, expected none that is invisible or steers a terminal"
