"""Templates of pages, and other texts that ship beside the code of a page."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def text_of(folder: Path, name: str) -> str:
    """Read a text that ships with the library."""
    return (folder / name).read_text(encoding="utf-8")


def source_of(text: str) -> str:
    """Name a style or script in a content security policy."""
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def templates_of(folder: Path) -> "Environment":
    """Load the templates in a folder.

    Values are escaped, and a name without a value is an error.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
