"""The leaderboard as one HTML file that needs nothing else: no network, no server."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from ...errors import MtpBenchError
from ...scoring.definitions import DEFINITIONS, RANKED_OBJECTS
from .columns import COLUMNS, NOTHING, best_texts, level, percent, shown
from .entries import LEVEL_TEXT, LEVELS, SUBSETS, Entry, Row, by_env, finite, interval_of, silence_of
from .gaps import STP
from .scale import PAD, WIDTH, bar_of, scale_of
from .scenes import scene_chart

if TYPE_CHECKING:
    from jinja2 import Environment


def board_page(entries: Sequence[Entry]) -> str:
    """HTML of the leaderboards of ``entries`` (from ``entries_of``), a table per environment.

    Equal entries give equal bytes: no date, no path, no random id is added.
    """
    boards = [_board(env_id, listed) for env_id, listed in by_env(entries).items()]
    style, script = _text("board.css"), _text("board.js")
    return (
        _templates()
        .get_template("page.html")
        .render(
            boards=boards,
            columns=COLUMNS,
            entries=entries,
            levels=LEVELS,
            level_text=LEVEL_TEXT,
            definitions=sorted({str(entry.record["scorer"]["definitions"]) for entry in entries}) or [DEFINITIONS],
            latest=max((str(entry.record.get("made") or "")[:10] for entry in entries), default=""),
            style=style,
            script=script,
            policy=_policy(style, script),
        )
        + "\n"
    )


def _board(env_id: str, entries: Sequence[Entry]) -> dict[str, Any]:
    """What the template shows of one environment."""
    reference = next((entry for entry in entries if entry.name == STP and entry.rank is not None), None)
    scale = scale_of(entries, reference.error if reference else None)
    best = {column.key: best_texts(column, entries) for column in COLUMNS}
    ranks = [entry.rank for entry in entries if entry.rank is not None]
    scored = next((entry for entry in entries if entry.rank is not None), entries[0])
    return {
        "id": env_id,
        "about": about(env_id),
        "card": sorted({str(entry.record["env"].get("card_digest") or "") for entry in entries} - {""}),
        "split": scored.record["env"].get("split"),
        "size": scored.row(),
        "ranked": len(ranks),
        "leaders": ranks.count(1),
        "sizes": {subset: scored.row(subset) for subset in SUBSETS},
        "silence": silence_of(entries),
        "few": {name for name in SUBSETS if (scored.row(name).get("objects") or 0) < RANKED_OBJECTS},
        "few_objects": RANKED_OBJECTS,
        "scale": scale,
        "reference": reference,
        "reference_x": scale.x(reference.error) if scale and reference and reference.error is not None else None,
        "lines": [_line(entry, entries, scale, best, reference) for entry in entries],
    }


def _line(
    entry: Entry, entries: Sequence[Entry], scale: Any, best: dict[str, str | None], reference: Entry | None
) -> dict[str, Any]:
    record = entry.record
    cells = {column.key: shown(column, entry) for column in COLUMNS}
    return {
        "entry": entry,
        "record": record,
        "why": entry.why.removeprefix(f"{record['status']}: "),
        "authors": _listed(record["submission"].get("authors")),
        "training": _listed(record.get("training_data"), ", "),
        "shared": entry.rank is not None and sum(other.rank == entry.rank for other in entries) > 1,
        "cells": cells,
        "keys": {column.key: _key(column.value(entry)) for column in COLUMNS},
        "best": {key for key, text in cells.items() if entry.rank is not None and text == best[key]},
        "level": level(entry),
        "level_name": record.get("verification") or NOTHING,
        "bar": bar_of(scale, entry.error, entry.interval),
        "link": address(entry.link),
        "old": str(record["scorer"]["definitions"]) != DEFINITIONS,
        "subsets": [(name, entry.row(name), interval_of(entry.row(name))) for name in ("all", *SUBSETS)],
        "parts": _parts(record),
        "scenes": scene_chart(entry, reference),
        "search": " ".join((entry.name, _listed(record["submission"].get("authors")),
                            str(record["submission"].get("description") or ""))).lower(),
    }  # fmt: skip


def _parts(record: Row) -> list[tuple[str, float]]:
    """The parts that the error adds up from, metres; empty where they are not known."""
    parts = (record.get("details") or {}).get("parts") or {}
    return [(name, value) for name in ("localisation", "missed", "false") if (value := finite(parts.get(name)))]


def about(env_id: str) -> dict[str, str]:
    """What a card that ships says of its environment: summary, detections, dataset and licence; empty for others."""
    from ..._bundle import card_ids
    from ...cards import load_card
    from ...sources import describe

    if env_id not in card_ids():
        return {}
    card = load_card(env_id)
    data = describe(card)
    how = "simulated" if card.detector is not None else "stored"
    detections = f"{how} ({card.detector_name})" if card.detector_name else how
    return {"summary": card.summary, "detections": detections, "dataset": data.dataset, "licence": data.licence}


def address(link: str | None) -> str | None:
    """A way to a file as a relative address: it is never taken for a script or another host, whatever it is called."""
    return None if link is None else "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")


def _key(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"


def _listed(value: Any, between: str = ", ") -> str:
    return value if isinstance(value, str) else between.join(str(item) for item in value or ())


def _policy(style: str, script: str) -> str:
    """A content security policy: this style, this script, nothing from anywhere."""
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (style, script)]
    return (
        f"default-src 'none'; style-src 'sha256-{digests[0]}'; script-src 'sha256-{digests[1]}'; img-src data:; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def _text(name: str) -> str:
    path = Path(__file__).with_name(name)
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise MtpBenchError(f"cannot read {path}, a part of mtp-bench: {error.strerror}; install it again") from None


@cache
def _templates() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    environment = Environment(
        loader=FunctionLoader(_text), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals.update(width=WIDTH, pad=PAD, nothing=NOTHING)
    environment.filters.update(number=number, signed=signed, percent=_percent)
    return environment


def number(value: Any, digits: int = 2) -> str:
    """A number with ``digits`` digits after the point; a dash where there is none."""
    known = finite(value)
    return NOTHING if known is None else f"{known:.{digits}f}"


def signed(value: Any, digits: int = 2) -> str:
    """A difference with its sign; a dash where there is none."""
    known = finite(value)
    return NOTHING if known is None else f"{known:+.{digits}f}".replace("-", "−")


def _percent(value: Any) -> str:
    known = finite(value)
    return NOTHING if known is None else percent(known)
