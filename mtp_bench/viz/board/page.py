"""The leaderboard as a page and the parts beside it: no network, no server, the same records give the same bytes."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...records.attestation import LEVELS
from ...records.history import OldResult
from ...scoring.definitions import DEFINITIONS, RANKED_OBJECTS, RANKED_UNITS
from ..pages import source_of, templates_of, text_of
from ..terminal.output import NOTHING, number
from .columns import COLUMNS, percent, signed
from .entries import LEVEL_TEXT, Entry, by_env
from .leader import leader_of
from .lines import Ids, address_of, board_of, details_of, p_value
from .overview import overview_of
from .preview import preview_rows
from .scale import WIDTH
from .tables import overview_files, table_files

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE = Path(__file__).parent
MOST_ENTRIES, MOST_ROWS = 25, 266  # of a table, and of all tables, before more are asked for
MOST_AGENTS = 60  # of the overview
_FURTHER = {
    "rank": ("#", "1 + the number of entries that are significantly better: sign-flip test over units, p below .05."),
    "name": ("submission", "Open it for its details. Below its name: authors, code and paper."),
    "curve": (
        "curve",
        "The error on public scenes over how many false forecasts are allowed, from none on; dashed: stp.",
    ),
    "level": ("verified", " ".join(f"{name}: {LEVEL_TEXT[name]}." for name in LEVELS)),
}  # what stands in a table beside the columns of numbers


@dataclass(frozen=True)
class BoardFiles:
    """A page, and by their paths the files of the folder beside it."""

    page: str
    parts: dict[str, str]


def board_files(
    entries: Sequence[Entry],
    history: Sequence[tuple[OldResult, str | None]] = (),
    folder: str = "index.parts",
    guide: str | None = None,
) -> BoardFiles:
    """The page of ``entries`` (from `entries_of`): an overview, then a table per environment.

    ``history``: results under earlier definitions with the links to them. ``folder``: name of the folder of the parts,
    beside the page. ``guide``: relative address of what says how to submit. No date, path or random id is added.
    """
    ids = _ids(entries)
    boards = [board_of(env_id, listed, ids) for env_id, listed in by_env(entries).items()]
    overview = overview_of(entries)
    known = {
        "parts": quote(folder),
        "boards": boards,
        "overview": overview,
        "ids": ids,
        "history": [(old, address_of(link)) for old, link in history],
        "levels": LEVELS,
        "most": _most([len(board["lines"]) for board in boards]),
    }
    parts = {f"overview.{suffix}": text for suffix, text in overview_files(overview).items()}
    parts["preview.svg"] = _render("preview.svg", **preview_rows(entries))
    if len(overview.rows) > MOST_AGENTS:
        parts["overview.js"] = _part("overview", "overview_rows.html", known, agents=overview.rows[MOST_AGENTS:])
    if history:
        parts["history.js"] = _part("history", "history.html", known)
    for board, (env_id, listed) in zip(boards, by_env(entries).items(), strict=True):
        parts |= {f"tables/{env_id}.{suffix}": text for suffix, text in table_files(env_id, listed).items()}
        parts |= _scripts(board, known)
    return BoardFiles(_page(entries, known, address_of(guide)), parts)


def _most(lines: Sequence[int]) -> int:
    """How many lines of each table are shown before more are asked for, of tables of so many ``lines``."""
    fitting = (most for most in range(1, MOST_ENTRIES + 1) if sum(min(count, most) for count in lines) <= MOST_ROWS)
    return max(fitting, default=1)


def _page(entries: Sequence[Entry], known: dict[str, Any], guide: str | None) -> str:
    style, script = text_of(_HERE, "board.css"), text_of(_HERE, "board.js")
    overview = known["overview"]
    return _render(
        "page.html",
        **known,
        agents=overview.rows[:MOST_AGENTS],
        leader=leader_of(entries, known["ids"]),
        columns=[column for column in COLUMNS if any(column in board["columns"] for board in known["boards"])],
        further=_FURTHER,
        few_objects=RANKED_OBJECTS,
        few_units=RANKED_UNITS,
        most_agents=MOST_AGENTS,
        definitions=DEFINITIONS,
        latest=max((entry.record.measured.made for entry in entries), default=""),
        guide=guide,
        icon=text_of(_HERE, "icon.svg").strip(),
        style=style,
        script=script,
        policy=_policy(style, script),
    )


def _scripts(board: dict[str, Any], known: dict[str, Any]) -> dict[str, str]:
    """What is loaded on demand of one environment: the details of each entry, and the entries that come later."""
    found = {}
    later = board["lines"][known["most"] :]
    if later:
        key = f"tables/{board['id']}"
        found[f"{key}.js"] = _part(key, "rows.html", known, board=board, lines=later)
    for line in board["lines"]:
        key = f"entries/{line['id']}"
        found[f"{key}.js"] = _part(key, "entry.html", known, board=board, line=details_of(line, board))
    return found


def _part(key: str, template: str, known: dict[str, Any], **more: Any) -> str:
    """A script that hands a piece of HTML to the page. JSON in ASCII without "<" ends no script early."""
    html = _render(template, **known, **more)
    return f"mtpBoard({json.dumps(key)}, {json.dumps(html)});\n".replace("<", "\\u003c")


def _render(template: str, **content: Any) -> str:
    return f"{_templates().get_template(template).render(**content)}\n"


def _ids(entries: Sequence[Entry]) -> Ids:
    """The place of each entry in addresses: "env/submission"; of several of one name the first."""
    ids, seen = dict[Entry, str](), Counter[str]()
    for entry in entries:
        name = f"{entry.env}/{entry.name}"
        ids[entry] = f"{name}~{entry.record.digest[:8]}" if seen[name.lower()] else name
        seen[name.lower()] += 1
    return ids


def _policy(style: str, script: str) -> str:
    """A content security policy: this style, this script and what it loads itself, pictures beside the page."""
    return (
        f"default-src 'none'; style-src {source_of(style)}; script-src {source_of(script)} 'strict-dynamic'; "
        "img-src 'self' data:; base-uri 'none'; form-action 'none'"
    )


@cache
def _templates() -> Environment:
    environment = templates_of(_HERE)
    environment.globals.update(width=WIDTH, nothing=NOTHING, level_text=LEVEL_TEXT)
    environment.filters.update(
        number=number,
        signed=signed,
        p_value=p_value,
        percent=lambda share: NOTHING if share is None else percent(share),
    )
    return environment
