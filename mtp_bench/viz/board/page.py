"""The leaderboard as a page and the parts beside it, without network and server.

The same records give the same bytes.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...core import (
    BLANK,
    Column,
    MtpBenchError,
    to_csv,
    to_json,
    whole_folder,
    write_text,
)
from ...judge import LEVELS, FileEntry
from ...scoring import DEFINITIONS, RANKED_OBJECTS, RANKED_UNITS
from ..pages import require_own_folder, source_of, templates_of, text_of
from .columns import COLUMN, PAGE, board_table
from .drawings import WIDTH
from .entries import LEVEL_TEXT, Entry, by_board, has_map
from .lines import address_of, board_of, details_of

if TYPE_CHECKING:
    from jinja2 import Environment

_FOLDER = Path(__file__).parent
SUFFIX = ".parts"  # of the folder beside a page
_MARK = "leaderboard.json"  # in every such folder
_RANK_TEXT = (
    "Place by bADE, with the ranks that tests leave open. Green: no other is "
    "significantly better."
)
_NAME_TEXT = "Its name opens its details. Below: authors, licence, code and paper."
_LEVELS_TEXT = " ".join(f"{name}: {LEVEL_TEXT[name]}." for name in LEVELS)
_CONVERTED_TEXT = (
    "Converted: the level of an earlier form of the record, not run again."
)
# heading and explanation of the columns of a table beside those of numbers
_OTHER_COLUMNS = {
    "rank": ("rank", _RANK_TEXT),
    "name": ("agent", _NAME_TEXT),
    "level": ("verified", f"{_LEVELS_TEXT} {_CONVERTED_TEXT}"),
}


@dataclass(frozen=True)
class Pages:
    """Relative addresses of pages that the page links to."""

    guide: str | None = None  # how to submit
    definition: str | None = None  # of bADE


@dataclass(frozen=True)
class BoardFiles:
    """A page, and by their paths the files of the folder beside it."""

    page: str
    parts: dict[str, str]


def board_files(
    entries: Sequence[Entry],
    folder: str = "index.parts",
    pages: Pages | None = None,
    file_entries: Sequence[FileEntry] = (),
) -> BoardFiles:
    """Return the page of ``entries`` (from `entries_of`) and its parts.

    An overview comes first, then a table per environment. Environments with a map
    follow with an overview of their own: their ranks do not compare with the others.
    ``folder``: name of the parts' folder beside the page. ``pages``: other pages that
    it links to. ``file_entries`` have a section of their own at the end. The files
    contain no date of today, path or random id.
    """
    by_env = by_board(entries)
    boards = [board_of(members) for members in by_env.values()]
    groups = []
    for with_map in (False, True):
        members = [entry for entry in entries if has_map(entry.env) == with_map]
        if members:
            shown = [board for board in boards if board["map"] == with_map]
            groups.append((overview_of(members), shown))
    content = {
        "parts": quote(folder),
        "boards": boards,
        "groups": groups,
        "ids": _ids(entries),
        "file_entries": file_entries,
    }
    parts = _table_files(entries, "leaderboard")
    for board in sorted(boards, key=lambda board: board["env"]):
        env_id = board["env"]
        parts |= _table_files(by_env[env_id], env_id)
        parts[f"{env_id}.js"] = _details_script(board, content)
    return BoardFiles(_page(entries, content, pages or Pages()), parts)


def overview_of(entries: Sequence[Entry]) -> list[tuple[str, list[Entry | None]]]:
    """Return agents, each with its entry per environment.

    The order of ``entries`` is that of `entries_of`. The best agent of the first
    environment comes first.
    """
    env_ids = list(by_board(entries))
    entries_by_name: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        # the first of several entries of one name
        entries_by_name.setdefault(entry.name, {}).setdefault(entry.env, entry)
    references = {entry.name for entry in entries if entry.saw_truth}
    rows = []
    for name, by_env in entries_by_name.items():
        rows.append((name, [by_env.get(env_id) for env_id in env_ids]))

    def sort_key(row: tuple[str, list[Entry | None]]) -> tuple[object, ...]:
        name, env_entries = row
        return name in references, list(map(_sort_key, env_entries)), name

    return sorted(rows, key=sort_key)


def _sort_key(entry: Entry | None) -> tuple[float, ...]:
    """Return a sort key in one environment: by place, then bADE.

    Partial and missing entries come last.
    """
    if entry is None or entry.part or entry.error is None:
        return math.inf, True, math.inf
    return entry.place or math.inf, not entry.compared, entry.error


def _table_files(entries: Sequence[Entry], name: str) -> dict[str, str]:
    table = board_table(entries, name)
    return {f"{name}.csv": to_csv(table), f"{name}.json": to_json(table)}


def _page(entries: Sequence[Entry], content: dict[str, Any], pages: Pages) -> str:
    style = text_of(_FOLDER, "board.css")
    script = text_of(_FOLDER, "board.js")
    # allowed are this style, this script and the parts that it loads, and pictures
    policy = (
        f"default-src 'none'; style-src {source_of(style)}; script-src "
        f"{source_of(script)} 'strict-dynamic'; img-src 'self' data:; base-uri 'none'; "
        "form-action 'none'"
    )
    shown_columns = set()
    for board in content["boards"]:
        shown_columns.update(board["columns"])
    latest = max((entry.record.measured.made for entry in entries), default="")
    return _render(
        "page.html",
        **content,
        columns=[COLUMN[key] for key in PAGE if COLUMN[key] in shown_columns],
        few_objects=RANKED_OBJECTS,
        few_units=RANKED_UNITS,
        latest=latest,
        guide=address_of(pages.guide),
        definition=address_of(pages.definition),
        icon=text_of(_FOLDER, "icon.svg").strip(),
        style=style,
        script=script,
        policy=policy,
    )


def _details_script(board: dict[str, Any], content: dict[str, Any]) -> str:
    """Return a script with the details of a table's entries.

    Its calls hand HTML to the page. They are ASCII without "</" and "<!", which would
    end a script early.
    """
    calls = []
    for line in board["lines"]:
        details = details_of(line)
        html = _render("entry.html", **content, board=board, line=details)
        address = content["ids"][line["entry"]]
        call = f"mtpBoard({json.dumps(address)}, {json.dumps(html)});\n"
        calls.append(call.replace("</", r"<\/").replace("<!", r"<\u0021"))
    return "".join(calls)


def _render(template: str, **content: Any) -> str:
    return f"{_templates().get_template(template).render(**content)}\n"


def _ids(entries: Sequence[Entry]) -> dict[Entry, str]:
    """Return the address of each entry in the page, "table/submission".

    A further one of the same name has its digest.
    """
    ids = {}
    names = set()
    for entry in entries:
        name = f"{entry.env}/{entry.name}"
        ids[entry] = name
        if name.lower() in names:
            ids[entry] = f"{name}~{entry.record.digest[:8]}"
        names.add(name.lower())
    return ids


def _number_text(value: float | None, digits: int) -> str:
    return Column(format=f".{digits}f").text(value)


def _thousands(number: int) -> str:
    return f"{number:,}".replace(",", " ")


@cache
def _templates() -> "Environment":
    environment = templates_of(_FOLDER)
    environment.globals.update(
        width=WIDTH,
        nothing=BLANK,
        level_text=LEVEL_TEXT,
        levels=LEVELS,
        other_columns=_OTHER_COLUMNS,
        page_class=PAGE,
        definitions=DEFINITIONS,
    )
    environment.filters.update(thousands=_thousands, number=_number_text)
    return environment


def parts_folder(page: Path) -> Path:
    """Return the folder of the parts of ``page``."""
    return page.with_name(page.stem + SUFFIX)


def require_parts(page: Path) -> None:
    """Raise MtpBenchError unless the folder of the parts can be written.

    It may hold earlier parts alone.
    """
    folder = parts_folder(page)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise MtpBenchError(f"cannot write {folder}: it is not a folder; remove it")
    require_own_folder(folder, _MARK, "a page")


def write_board(page: Path, files: BoardFiles) -> None:
    """Write a page and its parts in place of earlier ones.

    Raises MtpBenchError where that fails.
    """
    require_parts(page)
    with whole_folder(parts_folder(page)) as folder:
        for name, text in files.parts.items():
            (folder / name).write_text(text, encoding="utf-8")
    write_text(page, files.page)
