"""Content of the templates for one table of the page, and for each entry in it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any
from urllib.parse import quote

from ...cards import load_card
from ...core import BLANK, Column, Table, card_ids, clean_text, columns_of
from ...judge import LEVELS, STP, why_scored_otherwise
from ...running import card_budget
from ...scoring import NAMES, SUBSETS, PairedDifference, Row
from ...sources import package_of
from ..terminal.tables import parts_text
from .columns import COLUMN, PAGE, best_text, further_columns
from .drawings import WIDTH, bar_of, curve_chart, scale_of, scene_chart
from .entries import Entry, empty_error, has_map, simulated

_SHORT = 120  # letters of a text in a row: all of it is in the details
_LATER = re.compile(
    r"^(.{28}.*?)(?:; |: |, [a-z]| \().*"
)  # the clauses of a description after the first
_SIGNED = COLUMN["difference"]
_PARTS = {"localisation": "with forecast", "missed": "without forecast"}
Ids = Mapping[Entry, str]
Line = dict[str, Any]


def board_of(entries: Sequence[Entry], ids: Ids) -> dict[str, Any]:
    """Content of the template for one table."""
    env_id = entries[0].env
    compared = [entry for entry in entries if entry.compared]
    first = next(iter(compared), entries[0])
    reference = next((entry for entry in compared if entry.name == STP), None)
    shown = (COLUMN[key] for key in PAGE)
    columns = [
        column
        for column in shown
        if any(column.value(entry) is not None for entry in entries)
    ]
    scale = scale_of(entries)
    board: dict[str, Any] = {
        "id": env_id,
        "env": env_id,
        "name": short_name(env_id),
        "about": _about(env_id),
        "budgets": card_budget(env_id).text(first.record.env.truth_complete),
        "simulated": simulated(env_id),
        "map": has_map(env_id),
        "drive": first.driving is not None,
        "card": sorted({entry.record.env.card_digest for entry in entries} - {""}),
        "split": first.record.env.split,
        "total": len(entries),
        "ranked": sum(entry.place is not None for entry in entries),
        "size": first.row,
        "empty_error": empty_error(entries),
        "answer": answer_of(entries, ids),
        "few": {
            n
            for n in SUBSETS[1:]
            if all(each.standing.places[n].place is None for each in entries)
        }
        | {"turning"},
        "columns": columns,
        "groups": [
            (group, list(each))
            for (group, _), each in groupby(columns, lambda c: (c.group, PAGE[c.key]))
        ],
        "scale": scale,
        "zero": WIDTH / 2
        if scale is None
        else scale.x(0.0),  # place of a difference of 0
        "reference": reference,
    }
    best = {column.key: best_text(column, entries) for column in columns}
    board["lines"] = [
        _line(entry, board, best) | {"id": ids[entry]} for entry in entries
    ]
    return board


def details_of(line: Line, board: Mapping[str, Any]) -> Line:
    """Content of the template for the details of an entry: its ``line``, with all cells, links, charts and tables."""
    entry: Entry = line["entry"]
    reference = board["reference"]
    return line | {
        "cells": {key: column.shown(entry) for key, column in COLUMN.items()},
        "link": address_of(entry.link),
        "all_links": _links(entry),
        "chart": curve_chart(entry, reference),
        "subsets": subset_table(entry),
        "parts": [
            (*part, value)
            for part in _PARTS.items()
            if (value := getattr(entry.row, part[0]))
        ],
        "costs": parts_text(entry.row),
        "scenes": scene_chart(entry, reference),
    }


def subset_table(entry: Entry) -> Table:
    """The numbers of an entry on each subset, or of its drives."""
    if entry.driving is not None:
        return Table("driving", "How its forecasts drive", "", [entry.driving])
    standing, row = entry.standing, {column.key: column for column in columns_of(Row)}
    places, differences = standing.places, standing.differences

    def chance(row: Row) -> str | None:
        return p_value(differences[row.subset].p) if row.subset in differences else None

    columns = [
        replace(row["subset"], read=lambda row: NAMES[row.subset]),
        Column(
            key="rank",
            read=lambda row: places[row.subset].rank if row.subset in places else None,
        ),
        row["error"],
        row["interval"],
        replace(
            COLUMN["difference"],
            heading="to stp",
            read=lambda row: getattr(differences.get(row.subset), "mean", None),
        ),
        replace(
            COLUMN["difference_interval"],
            read=lambda row: getattr(differences.get(row.subset), "interval", None),
        ),
        replace(row["p"], unit="-", read=chance),
        *(row[key] for key in ("minADE", "minFDE", "coverage")),
        replace(
            COLUMN["same_gap"],
            optional=True,
            read=lambda row: entry.same_predictor_gap(row.subset),
        ),
        replace(
            COLUMN["association_gap"],
            optional=True,
            read=lambda row: standing.association_gaps.get(row.subset),
        ),
        Column("events / objects / scenes", "-", key="sizes", read=_sizes),
        *(
            column
            for column in further_columns([entry])
            if not column.key.startswith("cost_")
        ),
    ]
    return Table(
        "subsets",
        "Errors in metres",
        "",
        [entry.row_of(subset) for subset in entry.sums.subsets],
        columns,
    )


def _sizes(row: Row) -> str:
    return f"{BLANK if row.events is None else f'{row.events:.0f}'} / {row.objects} / {row.scenes}"


def difference_text(entry: Entry) -> str:
    """The difference to STP in words, for screen readers; empty without one."""
    found = entry.difference()
    if found is None:
        return ""
    within = f", 95 % interval {_SIGNED.text(found.interval)}" if found.interval else ""
    return f"{_SIGNED.text(found.mean)} m{within}, p {p_value(found.p)}"


def address_of(link: str | None) -> str | None:
    """The relative address of a file: never one of a script or of another host."""
    return (
        None
        if link is None
        else "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")
    )


def _line(
    entry: Entry, board: Mapping[str, Any], best: Mapping[str, str | None]
) -> Line:
    """Content of the template for one entry: a line of the table ``board``."""
    record = entry.record
    authors = ", ".join(record.submission.authors)
    cells = {column.key: column.shown(entry) for column in board["columns"]}
    return {
        "entry": entry,
        "record": record,
        "reference": entry is board["reference"],
        "authors": clean_text(authors, _SHORT),
        "all_authors": clean_text(authors, len(authors))
        if len(authors) > _SHORT
        else "",  # for the search
        "links": [
            (label, address)
            for label, address in _links(entry)
            if len(address) <= _SHORT
        ],
        "license": clean_text(record.submission.license, _SHORT),
        "trained": clean_text(entry.trained_on_scored, _SHORT),
        "why": ""
        if entry.compared or entry.part
        else clean_text(entry.why.removeprefix(f"{record.status}: "), _SHORT),
        "what": clean_text(_LATER.sub(r"\1", record.submission.description), _SHORT),
        "cells": cells,
        "best": {
            key for key, text in cells.items() if entry.compared and text == best[key]
        },
        "level": LEVELS.index(entry.level),
        "signer": entry.signed.signer if entry.signed else "",
        "bar": bar_of(board["scale"], entry.difference()),
        "difference": difference_text(entry),
        "old": why_scored_otherwise(record) is not None,
    }


def _links(entry: Entry) -> list[tuple[str, str]]:
    """Addresses of the code and the paper of an entry; the code of a baseline is its folder."""
    submission = entry.record.submission
    code = submission.source or address_of(entry.code)
    return [
        (label, address)
        for label, address in (("code", code), ("paper", submission.paper))
        if address
    ]


def _about(env_id: str) -> dict[str, Any] | None:
    """Description of an environment by its card; None for one that does not ship."""
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    kind = "simulated" if card.detector is not None else "stored"
    detections = f"{kind} ({card.detector_name})" if card.detector_name else kind
    return {
        "summary": card.summary,
        "detections": detections,
        "data": package_of(card).dataset,
        "task": card.task,
    }


def answer_of(
    entries: Sequence[Entry], ids: Mapping[Entry, str]
) -> dict[str, Any] | None:
    """Content of the template ``answer.html`` for one table; None where no entry compares with others.

    Without ranks the first one is that of the lowest bADE on the public scenes.
    """
    compared = [
        entry for entry in entries if entry.compared and entry.error is not None
    ]
    if not compared:
        return None
    ranked = [entry for entry in compared if entry.place is not None]
    first, span = compared[0], compared[0].standing.places["all"].span
    following = next((entry for entry in ranked if not entry.among_best), None)
    return {
        "entry": first,
        "id": ids[first],
        "env": short_name(first.env),
        "equals": [(entry, ids[entry]) for entry in ranked[1:] if entry.among_best],
        "others": len(ranked) - 1,
        "worse": 0 if span is None else len(ranked) - span[1],
        "less_stp": _lead(first.difference()),
        "next": None if following is None else (following, ids[following]),
        "less_next": None
        if following is None
        else _lead(first.minus(following, "all")),
    }


def short_name(env_id: str) -> str:
    """Short form of an id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")


def _lead(difference: PairedDifference | None) -> dict[str, str] | None:
    """Size and direction of a difference in words, with its interval and p; None without an interval."""
    if difference is None or difference.interval is None:
        return None
    sign = -1 if difference.mean < 0 else 1
    low, high = sorted(sign * end for end in difference.interval)
    return {
        "by": f"{abs(difference.mean):.3f} m {'lower' if difference.mean < 0 else 'higher'}",
        "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
        "p": f"p {p_value(difference.p)}",
    }


def p_value(p: float) -> str:
    """A p-value as text: "= .034", or "< .001" for a smaller one."""
    return "< .001" if p < 0.001 else "= " + f"{p:.3f}".removeprefix("0")
