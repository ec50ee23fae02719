"""Strict TOML: every key is known, every value has its type, and a typo is answered with the nearest key."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

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
    where, _ = _follow(model, first["loc"])
    if first["type"] == "extra_forbidden":
        known = _follow(model, first["loc"][:-1])[1]
        return f"unknown key {where!r}{nearest(str(first['loc'][-1]), known)}"
    if first["type"] == "missing":
        return f"key {where!r} is missing"
    if first["type"].startswith("union_tag"):
        tags = [tag for member in get_args(_annotation(model, first["loc"])) for tag in _tags(member)[:-1]]
        return f"{where}.name: got {_tag(first['input'])!r}, expected one of {', '.join(map(repr, tags))}"
    expected = (
        "expected a table"
        if first["type"] in ("model_type", "model_attributes_type")
        else first["msg"].replace("tuple", "list")
    )
    return f"{where}: got {_short(first['input'])}: {expected.removeprefix('Value error, ')}"


def _follow(model: type[BaseModel], loc: tuple[int | str, ...]) -> tuple[str, list[str]]:
    """``loc`` as the user wrote it, without the tags of unions; and the keys that the section there knows."""
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
    at = _only_section(at)
    return ".".join(path), list(at.model_fields) if _is_section(at) else []


def _annotation(model: type[BaseModel], loc: tuple[int | str, ...]) -> Any:
    for part in loc[:-1]:
        model = _only_section(model.model_fields[str(part)].annotation)
    return model.model_fields[str(loc[-1])].annotation


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
    return "a table" if isinstance(value, BaseModel) or (isinstance(value, dict) and len(value) > 1) else repr(value)


def _tag(content: Any) -> Any:
    return content.get("name") if isinstance(content, dict) else content
