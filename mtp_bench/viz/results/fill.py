"""Pages of results, filled in from records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...errors import MtpBenchError
from ...files import read_bounded, require_file, write_text
from .blocks import filled
from .known import Known
from .templates import SUFFIX, functions_of, render

BLOCKS = "blocks"  # folder of the templates of blocks
_MOST_BYTES = 1 << 20


def fill(pages: Sequence[Path], known: Known, leaderboard: Path) -> list[str]:
    """Fill in pages from records, all of them or none; what was done, and which records were not used.

    A page PAGE.md with a template PAGE.md.jinja beside it is made of that. Of any other page the marked blocks are
    filled, each NAME from the template blocks/NAME.md.jinja of the ``leaderboard``.
    Raises MtpBenchError in one line where a template, a mark or a claim is wrong, or a record is missing.
    """
    for page in pages:
        require_file(page)
    functions = functions_of(known)
    texts = {page: _text(page, functions, leaderboard) for page in pages}
    for page, text in texts.items():
        write_text(page, text)
    done = [f"{page}: filled in, {len(known)} records can be told of" for page in pages]
    return [*(f"not told of: {text}" for text in known.unused), *done]


def _text(page: Path, functions: Mapping[str, Any], leaderboard: Path) -> str:
    template = page.with_name(page.name + SUFFIX)
    if template.is_file():
        return render(template, functions)
    content = read_bounded(page, _MOST_BYTES, MtpBenchError)
    blocks = leaderboard / BLOCKS
    return filled(content, str(page), lambda name: render(blocks / f"{name}.md{SUFFIX}", functions))
