"""Templates of pages, and other texts that ship beside the code of a page."""

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core import MtpBenchError, require_folder, require_replaceable

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def text_of(folder: Path, name: str) -> str:
    """Read a text that ships with the library."""
    return (folder / name).read_text(encoding="utf-8")


def require_own_folder(folder: Path, mark: str, writer: str) -> None:
    """Raise MtpBenchError unless ``folder`` can be written.

    It may be new or empty. If it has the file ``mark``, an earlier ``writer`` wrote it.
    """
    require_folder(folder)
    require_replaceable(folder)
    if not folder.is_dir() or (folder / mark).is_file():
        return
    names = sorted(path.name for path in folder.iterdir())
    if names:
        raise MtpBenchError(
            f"{folder} contains {names[0]!r}, which {writer} did not write; "
            "choose another place with -o"
        )


def source_of(text: str) -> str:
    """Return the digest that allows a text in a content security policy.

    ``text``: a style or script.
    """
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def data_uri(content: bytes, media_type: str) -> str:
    """Return the address of a picture that stands in the page itself."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


def page_of(folder: Path, template: str, **content: Any) -> str:
    """Return a page that has no script and loads no other file.

    Its style is ``page.css`` in the ``folder`` of the ``template``.
    """
    style = text_of(folder, "page.css")
    policy = f"default-src 'none'; style-src {source_of(style)}; img-src data:"
    page = templates_of(folder).get_template(template)
    return f"{page.render(style=style, policy=policy, **content)}\n"


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
