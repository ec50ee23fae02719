"""For mkdocstrings: the comment behind a field, or above it, is what the reference says of it.

In this library shapes and units stand there: `box: Floats  # [R, 7]`. The fields of a class become one table.
"""

from __future__ import annotations

import io
import tokenize
from typing import Any

import griffe

SECTION = "Attributes:"


class FieldComments(griffe.Extension):
    """Adds the fields of a class to its docstring; names of modules get their comment as a docstring."""

    def on_attribute_instance(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Called for every attribute that is found."""
        if attr.docstring is None and attr.parent is not None and attr.parent.is_module:
            comment = _comment(attr)
            if comment:
                attr.docstring = griffe.Docstring(
                    comment[0].upper() + comment[1:] + ".", parent=attr
                )

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """Called for every class, once its members are known."""
        fields = [
            field
            for field in cls.attributes.values()
            if field.docstring is None and _is_field(field)
        ]
        if not fields or cls.docstring is None or SECTION in cls.docstring.value:
            return
        lines = [f"    {field.name}: {_comment(field) or '–'}" for field in fields]
        cls.docstring.value = "\n".join(
            [cls.docstring.value.rstrip(), "", SECTION, *lines]
        )


def _is_field(attribute: griffe.Attribute) -> bool:
    return not attribute.name.startswith("_") and attribute.annotation is not None


def _comment(attribute: griffe.Attribute) -> str:
    """Return the comment behind an attribute, or above it, without marks for tools."""
    try:
        tokens = list(tokenize.generate_tokens(io.StringIO(attribute.source).readline))
    except (tokenize.TokenError, IndentationError):
        return ""
    behind = [token.string for token in tokens if token.type == tokenize.COMMENT]
    texts = [text.lstrip("# ") for text in behind or _lines_above(attribute)]
    return " ".join(
        text for text in texts if not text.startswith(("noqa", "type:", "pyright:"))
    )


def _lines_above(attribute: griffe.Attribute) -> list[str]:
    """Return the lines of the comment that ends above an attribute."""
    path = attribute.filepath
    lines = attribute.lines_collection[path[0] if isinstance(path, list) else path]
    end = (attribute.lineno or 1) - 1
    begin = end
    while begin and lines[begin - 1].lstrip().startswith("#"):
        begin -= 1
    return [line.strip() for line in lines[begin:end]]
