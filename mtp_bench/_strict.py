"""Strict TOML: every key is known, every value has its type, and a typo is answered with the nearest key."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from .errors import MtpBenchError, nearest


class Section(BaseModel):
    """A table of a TOML file. Nothing is converted: ``"10"``, ``10.0`` and ``true`` are not the integer 10."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


SectionT = TypeVar("SectionT", bound=Section)


def read_toml(path: Path, error: type[MtpBenchError]) -> dict[str, Any]:
    """Content of a TOML file; raises ``error`` where it cannot be read."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as cause:
        raise error(f"{path}: not valid TOML: {cause}") from None
    except OSError as cause:
        raise error(f"{path}: cannot be read: {cause.strerror}") from None


def validate(model: type[SectionT], content: dict[str, Any], where: str, error: type[MtpBenchError]) -> SectionT:
    """``content`` as ``model``; raises ``error`` naming ``where``, the key, what was got and what was expected."""
    try:
        return model.model_validate(content)
    except ValidationError as cause:
        raise error(f"{where}: {_explain(cause.errors(), model)}") from None


def _explain(errors: Sequence[ErrorDetails], model: type[BaseModel]) -> str:
    # A misspelt required key is both missing and unknown: the unknown one tells what to do.
    first = min(errors, key=lambda detail: detail["type"] != "extra_forbidden")
    where = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return f"unknown key {where!r}{nearest(str(first['loc'][-1]), _keys_at(model, first['loc'][:-1]))}"
    if first["type"] == "missing":
        return f"key {where!r} is missing"
    expected = "expected a table" if first["type"] == "model_type" else first["msg"]
    return f"{where}: got {first['input']!r}: {expected}"


def _keys_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> list[str]:
    """Keys that the section at ``loc`` knows."""
    for part in loc:
        field = model.model_fields.get(str(part))
        if field is not None and isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            model = field.annotation
    return list(model.model_fields)
