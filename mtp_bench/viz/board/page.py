"""The leaderboard as one HTML file that needs nothing else: no network, no server."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...records.attestation import LEVELS
from ...records.history import OldResult
from ...records.ranking import STP
from ...scoring.definitions import DEFINITIONS, RANKED_OBJECTS, RANKED_UNITS
from ...scoring.subsets import SUBSETS
from ..pages import templates_of, text_of
from ..terminal.output import NOTHING, number
from .columns import COLUMNS, best_texts, percent, shown
from .entries import LEVEL_TEXT, Entry, by_env, silence_of
from .scale import PAD, WIDTH, Scale, bar_of, scale_of, scene_chart

if TYPE_CHECKING:
    from jinja2 import Environment

_HERE = Path(__file__).parent


def board_page(entries: Sequence[Entry], history: Sequence[tuple[OldResult, str | None]] = ()) -> str:
    """HTML of the leaderboards of ``entries`` (from `entries_of`), a table per environment.

    ``history``: results under earlier definitions with the links to them, in a plain table below. Equal entries give
    equal bytes: no date, no path, no random id is added.
    """
    style, script = text_of(_HERE, "board.css"), text_of(_HERE, "board.js")
    page = _templates().get_template("page.html")
    content = page.render(
        boards=[_board(env_id, listed) for env_id, listed in by_env(entries).items()],
        history=[(old, _address(link)) for old, link in history],
        columns=COLUMNS,
        levels=LEVELS,
        level_text=LEVEL_TEXT,
        few_objects=RANKED_OBJECTS,
        few_units=RANKED_UNITS,
        definitions=DEFINITIONS,
        latest=max((entry.record.measured.made for entry in entries), default=""),
        style=style,
        script=script,
        policy=_policy(style, script),
    )
    return f"{content}\n"


def _board(env_id: str, entries: Sequence[Entry]) -> dict[str, Any]:
    """What the template shows of one environment."""
    compared = [entry for entry in entries if entry.compared]
    scored = next(iter(compared), entries[0])
    reference = next((entry for entry in compared if entry.name == STP), None)
    scale = scale_of(entries, reference.error if reference else None)
    best = {column.key: best_texts(column, entries) for column in COLUMNS}
    ranks = [entry.rank for entry in entries if entry.rank is not None]
    return {
        "id": env_id,
        "about": _about(env_id),
        "card": sorted({entry.record.env.card_digest for entry in entries} - {""}),
        "split": scored.record.env.split,
        "ranked": len(ranks),
        "nobody": scored.why if compared and not ranks else "",
        "leaders": ranks.count(1),
        "sizes": {row.subset: row for row in scored.rows},
        "silence": silence_of(entries),
        "few": {name for name in SUBSETS[1:] if all(each.standing.places[name].rank is None for each in entries)},
        "scale": scale,
        "reference": reference,
        "reference_x": scale.x(reference.error) if scale and reference and reference.error is not None else None,
        "lines": [_line(entry, entries, scale, best, reference) for entry in entries],
    }


def _line(
    entry: Entry,
    entries: Sequence[Entry],
    scale: Scale | None,
    best: dict[str, str | None],
    reference: Entry | None,
) -> dict[str, Any]:
    """What the template shows of one entry: texts by column, and what each column is sorted by."""
    record, standing = entry.record, entry.standing
    cells = {column.key: shown(column, entry) for column in COLUMNS}
    return {
        "entry": entry,
        "record": record,
        "why": "" if entry.compared else entry.why.removeprefix(f"{record.status}: "),
        "shared": entry.rank is not None and sum(other.rank == entry.rank for other in entries) > 1,
        "cells": cells,
        "sorting": {column.key: _key(column.value(entry)) for column in COLUMNS},
        "best": {key for key, text in cells.items() if entry.compared and text == best[key]},
        "level": LEVELS.index(entry.level),
        "bar": bar_of(scale, entry.error, entry.interval),
        "link": _address(entry.link),
        "old": record.scorer.definitions != DEFINITIONS,
        "subsets": [
            (row, standing.places[row.subset], standing.gaps.get(row.subset), entry.same_predictor_gap(row.subset))
            for row in entry.rows
        ],
        "parts": [(name, value) for name in ("localisation", "missed") if (value := getattr(entry.row, name))],
        "scenes": scene_chart(entry, reference),
        "search": " ".join((entry.name, ", ".join(record.submission.authors), record.submission.description)).lower(),
    }


def _about(env_id: str) -> dict[str, str] | None:
    """What a card that ships says of its environment; None for another."""
    from ..._bundle import card_ids
    from ...cards import load_card
    from ...sources import describe

    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    data = describe(card).about
    how = "simulated" if card.detector is not None else "stored"
    detections = f"{how} ({card.detector_name})" if card.detector_name else how
    return {"summary": card.summary, "detections": detections, "dataset": data.name, "licence": data.licence}


def _address(link: str | None) -> str | None:
    """A way to a file as a relative address: it is never taken for a script or another host, whatever it is called."""
    return None if link is None else "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")


def _key(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"


def _policy(style: str, script: str) -> str:
    """A content security policy: this style, this script, nothing from anywhere."""
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (style, script)]
    return (
        f"default-src 'none'; style-src 'sha256-{digests[0]}'; script-src 'sha256-{digests[1]}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def _templates() -> Environment:
    environment = templates_of(_HERE)
    environment.globals.update(width=WIDTH, pad=PAD, nothing=NOTHING)
    environment.filters.update(number=number, percent=lambda share: NOTHING if share is None else percent(share))
    return environment
