"""The leaderboard as a page and the parts beside it: no network, no server, the same records give the same bytes."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...core import (
    BLANK,
    Column,
    MtpBenchError,
    require_folder,
    to_csv,
    to_json,
    whole_folder,
    write_text,
)
from ...judge import LEVELS
from ...scoring import DEFINITIONS, RANKED_OBJECTS, RANKED_UNITS
from ..pages import source_of, templates_of, text_of
from .columns import COLUMN, PAGE, board_table
from .drawings import WIDTH
from .entries import LEVEL_TEXT, Entry, by_board, has_map, simulated
from .lines import Ids, address_of, board_of, details_of, short_name

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE = Path(__file__).parent
SUFFIX = ".parts"  # of the folder beside a page
_MARK = "leaderboard.json"  # in every such folder
_FURTHER = {
    "rank": (
        "rank",
        "Place by bADE, with the ranks that tests leave open. Green: no other is significantly better.",
    ),
    "name": (
        "agent",
        "Its name opens its details. Below: authors, licence, code and paper.",
    ),
    "level": (
        "verified",
        " ".join(f"{name}: {LEVEL_TEXT[name]}." for name in LEVELS)
        + " Converted: the level of an earlier form of the record, not run again.",
    ),
}  # columns of a table beside those of numbers


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
    entries: Sequence[Entry], folder: str = "index.parts", pages: Pages | None = None
) -> BoardFiles:
    """The page of ``entries`` (from `entries_of`): an overview, then a table per environment.

    Environments with a map follow with an overview of their own: they are in no order with the others.
    ``folder``: name of the parts' folder beside the page. ``pages``: addresses of others. No date, path or random id.
    """
    ids = _ids(entries)
    boards = [board_of(listed, ids) for listed in by_board(entries).values()]
    groups = [
        (
            overview_of(list(listed)),
            [board for board in boards if board["map"] == lanes],
        )
        for lanes, listed in groupby(entries, lambda entry: has_map(entry.env))
    ]
    known = {
        "parts": quote(folder),
        "boards": boards,
        "groups": groups,
        "ids": ids,
        "levels": LEVELS,
    }
    parts = _table_files(entries, "leaderboard")
    for env_id in sorted({entry.env for entry in entries}):
        parts |= _table_files(
            [entry for entry in entries if entry.env == env_id], env_id
        )
        parts[f"{env_id}.js"] = "".join(
            _pieces(board, known) for board in boards if board["env"] == env_id
        )
    return BoardFiles(_page(entries, known, pages or Pages()), parts)


@dataclass(frozen=True)
class Overview:
    """Agents by environments."""

    map: bool  # agents see lanes in all of the environments; else in none
    heads: list[tuple[str, str, bool]]  # id of the table, name, whether it is simulated
    rows: list[
        tuple[str, list[Entry | None]]
    ]  # name of an agent, its entry per environment

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Headings above the columns, with their number."""
        made = sum(simulated for _, _, simulated in self.heads)
        counts = [("recorded", len(self.heads) - made), ("simulated", made)]
        return [(name, count) for name, count in counts if count]


def overview_of(entries: Sequence[Entry]) -> Overview:
    """The overview of ``entries`` (`entries_of`), the best of the first env first.

    They are all of environments with a map, or all of others.
    """
    envs = by_board(entries)
    agents: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        agents.setdefault(entry.name, {}).setdefault(
            entry.env, entry
        )  # of several of one name the first
    seen = {entry.name for entry in entries if entry.saw_truth}
    names = sorted(
        agents,
        key=lambda name: (
            name in seen,
            [_place(agents[name].get(env)) for env in envs],
            name,
        ),
    )
    rows = [(name, [agents[name].get(env) for env in envs]) for name in names]
    heads = [(env, short_name(env), simulated(env)) for env in envs]
    return Overview(any(map(has_map, envs)), heads, rows)


def _place(entry: Entry | None) -> tuple[float, ...]:
    """Sort key in one environment: by place, then bADE; partial and missing entries come last."""
    if entry is None or entry.part or entry.error is None:
        return math.inf, True, math.inf
    return entry.place or math.inf, not entry.compared, entry.error


def _table_files(entries: Sequence[Entry], name: str) -> dict[str, str]:
    table = board_table(entries, name)
    return {f"{name}.csv": to_csv(table), f"{name}.json": to_json(table)}


def _page(entries: Sequence[Entry], known: dict[str, Any], pages: Pages) -> str:
    style, script = text_of(_HERE, "board.css"), text_of(_HERE, "board.js")
    policy = (  # this style, this script and its own parts, pictures beside the page
        f"default-src 'none'; style-src {source_of(style)}; script-src {source_of(script)} 'strict-dynamic'; "
        "img-src 'self' data:; base-uri 'none'; form-action 'none'"
    )
    return _render(
        "page.html",
        **known,
        columns=[
            COLUMN[key]
            for key in PAGE
            if any(COLUMN[key] in board["columns"] for board in known["boards"])
        ],
        further=_FURTHER,
        few_objects=RANKED_OBJECTS,
        few_units=RANKED_UNITS,
        latest=max((entry.record.measured.made for entry in entries), default=""),
        guide=address_of(pages.guide),
        definition=address_of(pages.definition),
        icon=text_of(_HERE, "icon.svg").strip(),
        style=style,
        script=script,
        policy=policy,
    )


def _pieces(board: dict[str, Any], known: dict[str, Any]) -> str:
    """The details of a table's entries as calls that hand HTML to the page, in ASCII; "</" ends no script early."""
    pieces = []
    for line in board["lines"]:
        html = _render("entry.html", **known, board=board, line=details_of(line, board))
        call = f"mtpBoard({json.dumps(line['id'])}, {json.dumps(html)});\n"
        pieces.append(call.replace("</", r"<\/").replace("<!", r"<\u0021"))
    return "".join(pieces)


def _render(template: str, **content: Any) -> str:
    return f"{_templates().get_template(template).render(**content)}\n"


def _ids(entries: Sequence[Entry]) -> Ids:
    """The address of each entry in the page, "table/submission"; a further one of the same name has its digest."""
    ids, seen = dict[Entry, str](), Counter[str]()
    for entry in entries:
        name = f"{entry.env}/{entry.name}"
        ids[entry] = f"{name}~{entry.record.digest[:8]}" if seen[name.lower()] else name
        seen[name.lower()] += 1
    return ids


@cache
def _templates() -> "Environment":
    environment = templates_of(_HERE)
    environment.globals.update(
        width=WIDTH,
        nothing=BLANK,
        level_text=LEVEL_TEXT,
        page_class=PAGE,
        definitions=DEFINITIONS,
    )
    environment.filters["thousands"] = lambda number: f"{number:,}".replace(",", " ")
    environment.filters["number"] = lambda value, digits=3: Column(
        format=f".{digits}f"
    ).text(value)
    return environment


def parts_folder(page: Path) -> Path:
    """The folder of the parts of ``page``."""
    return page.with_name(page.stem + SUFFIX)


def require_parts(page: Path) -> None:
    """Raise MtpBenchError unless the folder of the parts can be written, and holds earlier parts alone."""
    folder = parts_folder(page)
    require_folder(folder)
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise MtpBenchError(f"cannot write {folder}: it is not a folder; remove it")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / _MARK).is_file():
        raise MtpBenchError(
            f"cannot write {folder}: it holds other files than parts of a page; write it elsewhere"
        )


def write_board(page: Path, files: BoardFiles) -> None:
    """Write a page and its parts in place of earlier ones. Raises MtpBenchError where that fails."""
    require_parts(page)
    with whole_folder(parts_folder(page)) as folder:
        for name, text in files.parts.items():
            (folder / name).write_text(text, encoding="utf-8")
    write_text(page, files.page)
