"""Blocks of pages that are made from figures, and tables in Markdown."""

import re
from collections.abc import Callable, Sequence


def filled_blocks(page: str, kind: str, content: Callable[[str], str]) -> str:
    """Return ``page`` with new content between ``<!-- KIND: NAME -->`` and ``<!-- /KIND -->``, by NAME."""
    block = re.compile(
        rf"^<!-- {kind}: ([^>]+) -->\n.*?^<!-- /{kind} -->$", re.DOTALL | re.MULTILINE
    )

    def made(match: re.Match[str]) -> str:
        name = match[1]
        return f"<!-- {kind}: {name} -->\n\n{content(name)}\n\n<!-- /{kind} -->"

    return block.sub(made, page)


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; its first column is left-aligned."""
    rule = ["---", *["--:"] * (len(heads) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows))
