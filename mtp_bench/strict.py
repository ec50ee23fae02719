"""Strict TOML and JSON: every key is known, every value has its type, and a typo is answered with the nearest key.

What is read has bounds: the size of the file, the depth of its tables, and numbers that a computer holds.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import MtpBenchError, nearest
from .files import ABSENT, clean_text, read_bounded

MOST_TOML = 1 << 20  # bytes of a file
MOST_JSON = 8 << 20
MOST_DEPTH = 64  # of tables and lists in each other
_MOST_SHOWN = 200  # characters of what was got
_NUMBER = re.compile(r"(?<![\w.+-])[+-]?\d+\.\d+(?:[eE][+-]?\d+)?(?![\w.])")  # by itself, no part of a key
_MOST_DIGITS = 19  # of a whole number: it fits 64 bits


class Section(BaseModel):
    """A table of a TOML file. Nothing is converted: ``"10"``, ``10.0`` and ``true`` are not the integer 10."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


SectionT = TypeVar("SectionT", bound=Section)


def read_toml(path: Path, error: type[MtpBenchError]) -> dict[str, Any]:
    """Content of a TOML file of at most `MOST_TOML` bytes; raises ``error`` where it cannot be read."""
    text = read_bounded(path, MOST_TOML, error).removeprefix("\ufeff")  # some editors write a mark first
    try:
        _require_short_keys(text)
        content = tomllib.loads(text)
        _require_plain(content)
    except (ValueError, RecursionError) as cause:
        raise error(f"{path}: not valid TOML: {_reason(cause)}") from None
    return content


def read_json(path: Path, error: type[MtpBenchError], absent: str = ABSENT, most: int = MOST_JSON) -> dict[str, Any]:
    """The table in a JSON file of at most ``most`` bytes; raises ``error`` where it cannot be read, or is none.

    ``absent``: what is said where there is no file.
    """
    return parse_json(read_bounded(path, most, error, absent), str(path), error)


def parse_json(text: str, where: str, error: type[MtpBenchError]) -> dict[str, Any]:
    """The table in a text of JSON; raises ``error`` naming ``where`` it is from."""
    try:
        content = json.loads(text, parse_constant=_refuse, parse_int=_whole, object_pairs_hook=_once)
        _require_plain(content)
    except (ValueError, RecursionError) as cause:
        raise error(f"{where}: not valid JSON: {_reason(cause)}") from None
    if not isinstance(content, dict):
        raise error(f"{where}: holds {type(content).__name__}, expected a table")
    return content


def _require_short_keys(text: str) -> None:
    """ValueError for a line of very many dots: a dotted key costs its reader the square of its parts in memory."""
    for number, line in enumerate(text.split("\n"), 1):
        dots = line.count(".")
        if dots > MOST_DEPTH and (dots := _NUMBER.sub("", line).count(".")) > MOST_DEPTH:
            raise ValueError(f"line {number} has {dots} dots outside of numbers, expected at most {MOST_DEPTH}")


def _refuse(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A table whose keys come once: of two, one reader would take the first and another the last."""
    table = dict(pairs)
    if len(table) < len(pairs):
        twice = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"key {twice[:80]!r} comes twice")
    return table


def _whole(digits: str) -> int:
    """A whole number; one of thousands of digits is not worth the time of reading it."""
    if (count := len(digits.lstrip("-"))) > _MOST_DIGITS:
        raise ValueError(f"a number of {count} digits, expected at most {_MOST_DIGITS}")
    return int(digits)


def _require_plain(content: Any) -> None:
    """Raise ValueError for what is deeper than MOST_DEPTH, and for what no JSON in UTF-8 can hold."""
    level = [content]
    for _ in range(MOST_DEPTH):
        inner = []
        for value in level:
            if isinstance(value, dict):
                inner += [*value, *value.values()]
            elif isinstance(value, list):
                inner += value
            else:
                _require_plain_value(value)
        level = inner
    if level:
        raise ValueError(f"tables and lists are nested deeper than {MOST_DEPTH} levels")


def _require_plain_value(value: Any) -> None:
    if isinstance(value, str):
        if not value.isascii() and any("\ud800" <= letter <= "\udfff" for letter in value):
            raise ValueError(f"the text {value[:40]!a} holds half of a character (a surrogate), which is no text")
    elif isinstance(value, float) and not math.isfinite(value):
        raise ValueError("a number is too large, infinite or none (NaN), expected finite numbers")
    elif isinstance(value, int) and abs(value) >= 2**63:
        raise ValueError(f"a number of {len(str(abs(value)))} digits, expected at most {_MOST_DIGITS}")
    elif value is not None and not isinstance(value, bool | int | float):
        raise ValueError(f"a {type(value).__name__} ({value}), expected texts, numbers, lists and tables")


def _reason(cause: ValueError | RecursionError) -> str:
    if isinstance(cause, RecursionError):
        return f"tables and lists are nested deeper than {MOST_DEPTH} levels"
    return "a number has thousands of digits" if "set_int_max_str_digits" in str(cause) else str(cause)


def validate(model: type[SectionT], content: dict[str, Any], where: str, error: type[MtpBenchError]) -> SectionT:
    """``content`` as ``model``; raises ``error`` naming ``where``, the key, what was got and what was expected."""
    try:
        return model.model_validate(content)
    except ValidationError as cause:
        raise error(f"{where}: {_explain(cause.errors(), model)}") from None


def require_part(model: type[Section], content: dict[str, Any], where: str, error: type[MtpBenchError]) -> None:
    """Raise ``error`` as `validate` does, but for keys that are missing: ``content`` is a part of a ``model``."""
    try:
        model.model_validate(content)
    except ValidationError as cause:
        wrong = [detail for detail in cause.errors() if detail["type"] != "missing"]
        if wrong:
            raise error(f"{where}: {_explain(wrong, model)}") from None


def _explain(errors: Sequence[ErrorDetails], model: type[BaseModel]) -> str:
    # A misspelt required key is both missing and unknown: the unknown one tells what to do.
    first = min(errors, key=lambda detail: detail["type"] != "extra_forbidden")
    where, annotation = _follow(model, first["loc"])
    if first["type"] == "extra_forbidden":
        section = _only_section(_follow(model, first["loc"][:-1])[1])
        known = section.model_fields if _is_section(section) else ()
        return f"unknown key {where!r}{nearest(str(first['loc'][-1]), known)}"
    if first["type"] == "missing":
        return f"key {where!r} is missing"
    if first["type"].startswith("union_tag"):
        tags = [tag for member in get_args(annotation) for tag in _tags(member)[:-1]]
        return f"{where}.name: got {_tag(first['input'])!r}, expected one of {', '.join(map(repr, tags))}"
    expected = (
        "expected a table"
        if first["type"] in ("model_type", "model_attributes_type")
        else first["msg"].replace("tuple", "list")
    )
    return f"{where}: got {_short(first['input'])}: {expected.removeprefix('Value error, ')}"


def _follow(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[str, Any]:
    """``loc`` as the user wrote it, without the tags of unions; and the annotation of what belongs there."""
    path: list[str] = []
    at: Any = model
    for part in loc:
        at = _only_section(at)
        if get_origin(at) in (Union, UnionType):  # pydantic names the member by its tag
            at = next((member for member in map(_bare, get_args(at)) if str(part) in _tags(member)), None)
            continue
        path.append(str(part))
        if _is_section(at):
            field = at.model_fields.get(str(part))
            at = None if field is None else field.annotation
        elif get_origin(at) is dict:
            at = get_args(at)[1]
    return clean_text(".".join(path), _MOST_SHOWN), at


def _only_section(annotation: Any) -> Any:
    """The section of an optional one; anything else as it is."""
    if get_origin(annotation) not in (Union, UnionType):
        return annotation
    sections = [member for member in get_args(annotation) if _is_section(member)]
    return sections[0] if len(sections) == 1 else annotation


def _is_section(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _tags(member: Any) -> tuple[str, ...]:
    """What chooses this member of a union of sections: values of ``name``, or the name of its class."""
    return (*get_args(member.model_fields["name"].annotation), member.__name__) if _is_section(member) else ()


def _bare(annotation: Any) -> Any:
    """What is annotated."""
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _short(value: Any) -> str:
    """The value as it was written; a whole table would bury the message."""
    table = isinstance(value, BaseModel) or (isinstance(value, dict) and len(value) > 1)
    return "a table" if table else clean_text(repr(value), _MOST_SHOWN)


def _tag(content: Any) -> Any:
    return content.get("name") if isinstance(content, dict) else content
