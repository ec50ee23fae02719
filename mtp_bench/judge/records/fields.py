"""Types of fields of records: bounded numbers, and texts without invisible letters."""

import datetime
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import AfterValidator, Discriminator, Field, Tag
from typing_extensions import TypeAliasType  # pydantic brings it

from ...core import unseen

Level = Literal["scored", "re-scored", "re-run", "hidden"]
LEVELS: tuple[Level, ...] = get_args(Level)  # each includes those before it
MAX_LIST = 50  # items of a list of names or numbers
_MAX_NAME = 100  # characters
_MAX_TEXT = 2000  # characters of a description
# larger whole numbers are not the same in every reader of JSON
_LARGEST_WHOLE = 1 << 53


def _require_visible(text: str) -> str:
    if text.isascii() and text.isprintable():
        return text
    for letter in text:
        if letter not in "\n\t" and unseen(letter):
            raise ValueError(
                f"contains U+{ord(letter):04X}, expected no invisible and no control "
                "characters"
            )
    return text


def _require_date(text: str) -> str:
    return datetime.date.fromisoformat(text).isoformat()


_VISIBLE = AfterValidator(_require_visible)
Text = Annotated[str, Field(max_length=_MAX_TEXT), _VISIBLE]
Name = Annotated[str, Field(max_length=_MAX_NAME), _VISIBLE]
FileName = Annotated[
    str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=_MAX_NAME)
]
Url = Annotated[
    str, Field(pattern=r"^(https?://\S+)?$", max_length=_MAX_TEXT), _VISIBLE
]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
OptionalSha256 = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]
Date = Annotated[
    str, Field(pattern=r"^[0-9]{4}-[0-9]{2}-[0-9]{2}$"), AfterValidator(_require_date)
]
WholeNumber = Annotated[int, Field(ge=-_LARGEST_WHOLE, le=_LARGEST_WHOLE)]
Count = Annotated[int, Field(ge=0, le=_LARGEST_WHOLE)]
Share = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[float, Field(ge=0, le=1e9)]
if TYPE_CHECKING:
    Json = Any
else:  # however deep; chosen by type, so that errors name one type
    _KINDS = {
        "NoneType": None,
        "bool": bool,
        "int": WholeNumber,
        "float": float,
        "str": Text,
        "list": list["Json"],
        "dict": dict[Text, "Json"],
    }
    _any_kind = reduce(
        or_, (Annotated[kind, Tag(name)] for name, kind in _KINDS.items())
    )
    Json = TypeAliasType(
        "Json", Annotated[_any_kind, Discriminator(lambda value: type(value).__name__)]
    )
