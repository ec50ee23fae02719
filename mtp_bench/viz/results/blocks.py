"""Marked blocks of a page: ``<!-- results: NAME -->``, lines that are filled in, ``<!-- end of NAME -->``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from ...errors import MtpBenchError

_BEGIN = re.compile(r"<!-- results: ([a-z0-9-]+) -->")
_END = re.compile(r"<!-- end of ([a-z0-9-]+) -->")
_ALIKE = re.compile(r"<!--\s*(results\b|end\s+of\b)", flags=re.IGNORECASE)


def filled(text: str, where: str, content_of: Callable[[str], str]) -> str:
    """``text`` with the content of its blocks replaced; ``content_of`` gives it by name.

    Raises MtpBenchError, with ``where`` and the line, for a mark that is misspelt, without its pair, inside another
    block, or of a name that occurs twice, and where there is no block.
    """
    lines = list(_filled(text, where, content_of))
    return "\n".join(lines)


def _filled(text: str, where: str, content_of: Callable[[str], str]) -> Iterator[str]:
    begun, seen = "", set[str]()
    for number, line in enumerate(text.split("\n"), 1):
        begin, end = (mark.fullmatch(line) for mark in (_BEGIN, _END))
        place = f"{where}, line {number}"
        if begin:
            name = begin[1]
            if begun or name in seen:
                why = f"inside the block {begun!r}" if begun else "a second one of that name"
                raise MtpBenchError(f"{place}: the block {name!r} begins {why}")
            begun = name
            seen.add(name)
            yield line
            content = content_of(name).strip("\n")
            yield f"\n{content}\n"  # blank lines: the end of a table, and of a comment, for every reader of Markdown
        elif end:
            if end[1] != begun:
                expected = f"expected the end of {begun!r}" if begun else "which was not begun"
                raise MtpBenchError(f"{place}: end of the block {end[1]!r}, {expected}")
            begun = ""
            yield line
        elif _ALIKE.search(line):
            raise MtpBenchError(
                f"{place}: {line.strip()!r} is no mark of a block, expected a line `<!-- results: NAME -->` or "
                "`<!-- end of NAME -->`"
            )
        elif not begun:
            yield line
    if begun:
        raise MtpBenchError(f"{where}: the block {begun!r} has no end; write `<!-- end of {begun} -->` below it")
    if not seen:
        raise MtpBenchError(
            f"{where}: no template {where}.jinja beside it, and no block to fill; mark one by lines "
            "`<!-- results: NAME -->` and `<!-- end of NAME -->`"
        )
