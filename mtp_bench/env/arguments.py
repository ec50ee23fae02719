"""Checks of the arguments of the env: JSON values, each with one clear error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..errors import MtpBenchError, UnknownNameError


def size(name: str, value: int | None, default: int) -> int:
    """A size of the spaces: the given one or the card's; raises MtpBenchError for what is none."""
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise MtpBenchError(f"{name} is {value!r}, expected a whole number of at least 1 (the card has {default})")
    return value


def flag(name: str, value: bool) -> bool:
    """The flag itself; raises MtpBenchError for what is none."""
    if not isinstance(value, bool):
        raise MtpBenchError(f"{name} is {value!r}, expected true or false")
    return value


def text(name: str, value: str | None) -> str | None:
    """The text itself, or None; raises MtpBenchError for what is neither."""
    if value is not None and not isinstance(value, str):
        raise MtpBenchError(f"{name} is {value!r}, expected a text")
    return value


def choose(known: tuple[str, ...], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Scenes to draw from: all, or those named."""
    if wanted is None:
        chosen = known
    elif isinstance(wanted, str):
        raise MtpBenchError(f"scenes is {wanted!r}, expected a list of names")
    else:
        for name in wanted:
            if name not in known:
                raise UnknownNameError("scene", str(name), known)
        chosen = tuple(dict.fromkeys(wanted))
    if not chosen:
        raise MtpBenchError("no scene to choose from: expected at least one name in scenes")
    return chosen


def wanted(options: dict[str, Any], known: tuple[str, ...], drawn: str) -> str:
    """The scene that the options of reset name, else the one ``drawn``; raises UnknownNameError."""
    for key in options:
        if key != "scene":
            raise UnknownNameError("reset option", str(key), ["scene"])
    name = options.get("scene", drawn)
    if name not in known:
        raise UnknownNameError("scene", str(name), known)
    return str(name)
