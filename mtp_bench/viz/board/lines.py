"""What the templates show of one environment and of each entry in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Any
from urllib.parse import quote

from ..._bundle import card_ids
from ...cards import load_card
from ...files import clean_text
from ...records.attestation import LEVELS
from ...records.ranking import STP
from ...scoring.definitions import DEFINITIONS
from ...scoring.subsets import SUBSETS
from ...sources import about
from .columns import COLUMNS, best_texts, columns_of, shown, signed
from .curves import Frame, curve_chart, curve_of, small_frame
from .entries import Entry, silence_of
from .order import simulated
from .scale import bar_of, scale_of, scene_chart, zero_of

_SHORT = 120  # letters of a text in a row: all of it is in the details

Ids = Mapping[Entry, str]
Line = dict[str, Any]


def board_of(env_id: str, entries: Sequence[Entry], ids: Ids) -> dict[str, Any]:
    """What the template of a table shows of one environment."""
    compared = [entry for entry in entries if entry.compared]
    scored = next(iter(compared), entries[0])
    reference = next((entry for entry in compared if entry.name == STP), None)
    columns, scale, frame = columns_of(entries), scale_of(entries), small_frame(entries)
    ranks = [entry.rank for entry in entries if entry.rank is not None]
    found: dict[str, Any] = {
        "id": env_id,
        "about": _about(env_id),
        "simulated": simulated(env_id),
        "card": sorted({entry.record.env.card_digest for entry in entries} - {""}),
        "split": scored.record.env.split,
        "total": len(entries),
        "ranked": len(ranks),
        "nobody": scored.why if compared and not ranks else "",
        "sizes": {row.subset: row for row in scored.rows},
        "silence": silence_of(entries),
        "few": {name for name in SUBSETS[1:] if all(each.standing.places[name].rank is None for each in entries)},
        "columns": columns,
        "groups": [(group, list(each)) for (group, _), each in groupby(columns, key=lambda c: (c.group, c.kind))],
        "scale": scale,
        "zero": zero_of(scale),
        "reference": reference,
        "curves": frame is not None,
        "stp_curve": "" if frame is None or reference is None else frame.line(curve_of(reference)),
    }
    best = {column.key: best_texts(column, entries) for column in columns}
    shared = {rank for rank in ranks if ranks.count(rank) > 1}
    found["lines"] = [_line(entry, found, best, shared, frame) | {"id": ids[entry]} for entry in entries]
    return found


def details_of(line: Line, board: Mapping[str, Any]) -> Line:
    """What the template of an entry shows beyond its line."""
    entry: Entry = line["entry"]
    standing, reference = entry.standing, board["reference"]
    return line | {
        "cells": {column.key: shown(column, entry) for column in COLUMNS},
        "link": address_of(entry.link),
        "all_links": _links(entry),
        "clip": address_of(entry.clip) if board["simulated"] else None,
        "chart": curve_chart(entry, reference),
        "subsets": [
            (
                row,
                standing.places[row.subset],
                entry.difference(row.subset),
                standing.gaps.get(row.subset),
                entry.same_predictor_gap(row.subset),
            )
            for row in entry.rows
        ],
        "parts": [(name, value) for name in ("localisation", "missed") if (value := getattr(entry.row, name))],
        "scenes": scene_chart(entry, reference),
    }


def difference_text(entry: Entry) -> str:
    """The difference to STP in words, for those who listen; empty without one."""
    found = entry.difference()
    if found is None:
        return ""
    within = f", 95 % interval {signed(found.interval[0])} to {signed(found.interval[1])}" if found.interval else ""
    return f"{signed(found.mean)} m{within}, p {p_value(found.p)}"


def p_value(p: float) -> str:
    """A p value with the sign of its relation."""
    return "< .001" if p < 0.001 else f"= {p:.3f}".replace("0.", ".", 1)


def address_of(link: str | None) -> str | None:
    """A way to a file as a relative address: it is never taken for a script or another host, whatever it is called."""
    return None if link is None else "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")


def _line(
    entry: Entry, board: Mapping[str, Any], best: Mapping[str, str | None], shared: set[int], frame: Frame | None
) -> Line:
    """What the template shows of one entry in its table."""
    record, curve = entry.record, curve_of(entry)
    authors = ", ".join(record.submission.authors)
    cells = {column.key: shown(column, entry) for column in board["columns"]}
    return {
        "entry": entry,
        "record": record,
        "reference": entry is board["reference"],
        "authors": clean_text(authors, _SHORT),
        "all_authors": clean_text(authors, len(authors)) if len(authors) > _SHORT else "",  # for the search
        "links": [(label, address) for label, address in _links(entry) if len(address) <= _SHORT],
        "trained": clean_text(entry.trained_on_scored, _SHORT),
        "why": "" if entry.compared else clean_text(entry.why.removeprefix(f"{record.status}: "), _SHORT),
        "shared": entry.rank in shared,
        "cells": cells,
        "best": {key for key, text in cells.items() if entry.compared and text == best[key]},
        "level": LEVELS.index(entry.level),
        "signer": entry.signed.signer if entry.signed else "",
        "bar": bar_of(board["scale"], entry.difference()),
        "difference": difference_text(entry),
        "curve": frame.line(curve) if frame is not None and curve else "",
        "curve_label": f"error from {curve[0][1]:.2f} m to {curve[-1][1]:.2f} m" if curve else "",
        "old": record.scorer.definitions != DEFINITIONS,
    }


def _links(entry: Entry) -> list[tuple[str, str]]:
    """Where the code and the paper of an entry are; the code of a baseline is that which ships."""
    submission = entry.record.submission
    code = submission.source or address_of(entry.code)
    return [(label, address) for label, address in (("code", code), ("paper", submission.paper)) if address]


def _about(env_id: str) -> dict[str, str] | None:
    """What a card that ships says of its environment; None for another."""
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    data = about(card)
    how = "simulated" if card.detector is not None else "stored"
    detections = f"{how} ({card.detector_name})" if card.detector_name else how
    return {"summary": card.summary, "detections": detections, "dataset": data.name, "licence": data.licence}
