"""Strict TOML and JSON: known keys, typed values, and the nearest key for a typo.

Input is bounded: the size of the file, the depth of its tables, and the size of its
numbers.
"""

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import MtpBenchError, nearest
from .files import ABSENT, clean_text, read_bounded

_MAX_TOML_BYTES = 1 << 20
_MAX_JSON_BYTES = 8 << 20
_MAX_DEPTH = 64  # nested tables and lists
_MAX_SHOWN = 200  # characters of a value in an error text
# a number alone, not within a key
_NUMBER = re.compile(r"(?<![\w.+-])[+-]?\d+\.\d+(?:[eE][+-]?\d+)?(?![\w.])")
_SURROGATE = re.compile("[\ud800-\udfff]")
_MAX_DIGITS = 19  # of an integer: it fits 64 bits
_FIELDS_SHOWN = 6  # of a section in an interpreter


class Section(BaseModel):
    """A table of a TOML file.

    Values are not converted: ``"10"``, ``10.0`` and ``true`` are not the integer 10.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False
    )

    def __repr__(self) -> str:
        known = [(name, value) for name, value in self if value is not None]
        shown = [f"{name}={value!r}" for name, value in known[:_FIELDS_SHOWN]]
        more = ", ..." if len(known) > _FIELDS_SHOWN else ""
        return f"{type(self).__name__}({', '.join(shown)}{more})"


SectionT = TypeVar("SectionT", bound=Section)


def rule(holds: Callable[[Any], bool], expected: str) -> AfterValidator:
    """Make a rule for the values of a field.

    Its error says ``expected``.
    """

    def check(value: Any) -> Any:
        if not holds(value):
            raise ValueError(expected)
        return value

    return AfterValidator(check)


def read_toml(path: Path, error: type[MtpBenchError]) -> dict[str, Any]:
    """Read a TOML file of at most 1 MiB.

    Raises ``error`` if it cannot be read.
    """
    text = read_bounded(path, _MAX_TOML_BYTES, error)
    text = text.removeprefix("\ufeff")  # some editors write a byte order mark
    try:
        _require_short_keys(text)
        content = tomllib.loads(text)
        _require_plain(content)
    except (ValueError, RecursionError) as cause:
        raise error(f"{path}: not valid TOML: {_reason(cause)}") from None
    return content


def read_json(
    path: Path,
    error: type[MtpBenchError],
    absent: str = ABSENT,
    most: int = _MAX_JSON_BYTES,
) -> dict[str, Any]:
    """Read the object in a JSON file of at most ``most`` bytes.

    Raises ``error`` if it cannot be read. ``absent``: the reason given if there is no
    such file.
    """
    return parse_json(read_bounded(path, most, error, absent), str(path), error)


def parse_json(text: str, where: str, error: type[MtpBenchError]) -> dict[str, Any]:
    """Read the object in a JSON text.

    Raises ``error`` naming ``where`` the text is from.
    """
    try:
        content = json.loads(
            text, parse_constant=_refuse_constant, object_pairs_hook=_unique_keys
        )
        _require_plain(content)
    except (ValueError, RecursionError) as cause:
        raise error(f"{where}: not valid JSON: {_reason(cause)}") from None
    if not isinstance(content, dict):
        raise error(f"{where}: holds {type(content).__name__}, expected a table")
    return content


def validate(
    model: type[SectionT],
    content: dict[str, Any],
    where: str,
    error: type[MtpBenchError],
) -> SectionT:
    """Return ``content`` as ``model``.

    Raises ``error`` naming ``where``, the key, what was got and what was expected.
    """
    try:
        return model.model_validate(content)
    except ValidationError as cause:
        raise error(f"{where}: {explain(cause.errors(), model)}") from None


def validate_json(
    model: type[SectionT], text: str, where: str, error: type[MtpBenchError]
) -> SectionT:
    """Return a JSON text as ``model``.

    Raises as `validate`.
    """
    try:
        return model.model_validate_json(text)
    except ValidationError as cause:
        # a text that is not JSON has no key before "got"
        why = explain(cause.errors(), model).removeprefix(": got ")
        raise error(f"{where}: {why}") from None


def require_part(
    model: type[Section],
    content: dict[str, Any],
    where: str,
    error: type[MtpBenchError],
) -> None:
    """Raise ``error`` as `validate` does, but allow missing keys.

    ``content`` is a part of a ``model``.
    """
    try:
        model.model_validate(content)
    except ValidationError as cause:
        wrong = [detail for detail in cause.errors() if detail["type"] != "missing"]
        if wrong:
            raise error(f"{where}: {explain(wrong, model)}") from None


def explain(errors: Sequence[ErrorDetails], model: type[BaseModel]) -> str:
    """Describe the first of pydantic's ``errors`` on a ``model`` in one sentence.

    It names the key, what was got and what was expected.
    """
    # a misspelt required key is both missing and unknown: the unknown one says what to
    # do
    first = min(errors, key=lambda detail: detail["type"] != "extra_forbidden")
    where, section = _locate(model, first["loc"])
    if first["type"] == "extra_forbidden":
        hint = nearest(str(first["loc"][-1]), section.model_fields)
        return f"unknown key {where!r}{hint}"
    if first["type"] == "missing":
        return f"key {where!r} is missing"
    expected = first["msg"].replace("tuple", "list").removeprefix("Value error, ")
    if first["type"] in ("model_type", "model_attributes_type"):
        expected = "expected a table"
    return f"{where}: got {_short(first['input'])}: {expected}"


def _require_short_keys(text: str) -> None:
    """Raise ValueError for a line with very many dots.

    tomllib needs memory quadratic in the parts of a dotted key.
    """
    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") <= _MAX_DEPTH:
            continue
        dots = _NUMBER.sub("", line).count(".")
        if dots > _MAX_DEPTH:
            raise ValueError(
                f"line {number} has {dots} dots outside of numbers, "
                f"expected at most {_MAX_DEPTH}"
            )


def _refuse_constant(text: str) -> None:
    raise ValueError(f"{text} is not allowed in JSON")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a table from pairs.

    Raise ValueError for a repeated key.
    Readers disagree on which of its values counts.
    """
    table = dict(pairs)
    if len(table) < len(pairs):
        repeated = Counter(key for key, _ in pairs).most_common(1)[0][0]
        raise ValueError(f"key {repeated[:80]!r} comes twice")
    return table


def _require_plain(value: Any, depth: int = 0) -> None:
    """Raise ValueError for values that UTF-8 JSON cannot hold.

    Raises RecursionError for tables nested too deeply.
    """
    if depth > _MAX_DEPTH:
        raise RecursionError
    if isinstance(value, dict):
        for key, inner in value.items():
            if not key.isascii():
                _require_plain(key)
            _require_plain(inner, depth + 1)
    elif isinstance(value, list):
        # long lists of numbers are checked at once, by their sum
        all_numbers = {*map(type, value)} <= {float, bool}
        if not (all_numbers and math.isfinite(sum(value))):
            for inner in value:
                _require_plain(inner, depth + 1)
    else:
        _require_plain_value(value)


def _require_plain_value(value: Any) -> None:
    """Raise ValueError unless ``value`` is a text, a number or None that JSON holds."""
    if isinstance(value, str):
        if not value.isascii() and _SURROGATE.search(value):
            raise ValueError(
                f"the text {value[:40]!a} contains a lone surrogate, "
                "expected valid Unicode"
            )
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise ValueError(
                "a number is too large, infinite or NaN, expected finite numbers"
            )
    elif isinstance(value, int):
        if abs(value) >= 2**63:
            raise ValueError(
                f"a number of {len(str(abs(value)))} digits, "
                f"expected at most {_MAX_DIGITS}"
            )
    elif value is not None:
        raise ValueError(
            f"a {type(value).__name__} ({value}), "
            "expected texts, numbers, lists and tables"
        )


def _reason(cause: ValueError | RecursionError) -> str:
    if isinstance(cause, RecursionError):
        return f"tables and lists are nested deeper than {_MAX_DEPTH} levels"
    if "set_int_max_str_digits" in str(cause):
        return "a number has thousands of digits"
    return str(cause)


def _locate(
    model: type[BaseModel], loc: tuple[int | str, ...]
) -> tuple[str, type[BaseModel]]:
    """Return the key of ``loc``, and the section that it stands in."""
    section = model
    for part in loc[:-1]:
        field = section.model_fields.get(str(part))
        if field is not None:
            section = next(_sections_in(field.annotation), section)
    # pydantic marks the key of a table, in place of its value, by [key]
    key = ".".join(map(str, loc)).removesuffix(".[key]")
    return clean_text(key, _MAX_SHOWN), section


def _sections_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _sections_in(inner)


def _short(value: Any) -> str:
    """Shorten the value as it was written.

    A whole table would bury the message.
    """
    if isinstance(value, BaseModel) or (isinstance(value, dict) and len(value) > 1):
        return "a table"
    return clean_text(repr(value), _MAX_SHOWN)
