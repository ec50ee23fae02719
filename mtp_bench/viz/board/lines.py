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
from ...scoring import NAMES, SUBSETS, PairedDifference, Row, Subset
from ...sources import package_of
from ..terminal.tables import parts_text
from .columns import COLUMN, PAGE, best_text, further_columns
from .drawings import WIDTH, bar_of, curve_chart, scale_of, scene_chart
from .entries import Entry, empty_error, has_map, is_simulated

_MAX_LETTERS = 120  # of a text in a row: all of it is in the details
# the clauses of a description after the first
_LATER_CLAUSES = re.compile(r"^(.{28}.*?)(?:; |: |, [a-z]| \().*")
_SIGNED = COLUMN["difference"]
_PARTS = {"localisation": "with forecast", "missed": "without forecast"}
Ids = Mapping[Entry, str]
Line = dict[str, Any]


def board_of(entries: Sequence[Entry], ids: Ids) -> dict[str, Any]:
    """Return the content of the template for one table."""
    env_id = entries[0].env
    compared = [entry for entry in entries if entry.compared]
    first = compared[0] if compared else entries[0]
    reference = next((entry for entry in compared if entry.name == STP), None)
    columns = [
        COLUMN[key]
        for key in PAGE
        if any(COLUMN[key].value(entry) is not None for entry in entries)
    ]
    groups = groupby(columns, lambda column: (column.group, PAGE[column.key]))
    scale = scale_of(entries)
    board: dict[str, Any] = {
        "id": env_id,
        "env": env_id,
        "name": short_name(env_id),
        "about": _about(env_id),
        "budgets": card_budget(env_id).text(first.record.env.truth_complete),
        "simulated": is_simulated(env_id),
        "map": has_map(env_id),
        "drive": first.driving is not None,
        "card": sorted({entry.record.env.card_digest for entry in entries} - {""}),
        "split": first.record.env.split,
        "total": len(entries),
        "ranked": sum(entry.place is not None for entry in entries),
        "size": first.row,
        "empty_error": empty_error(entries),
        "answer": answer_of(entries, ids),
        "few": {"turning", *_unranked_subsets(entries)},
        "columns": columns,
        "groups": [(group, list(members)) for (group, _), members in groups],
        "scale": scale,
        # place of a difference of 0
        "zero": WIDTH / 2 if scale is None else scale.x(0.0),
        "reference": reference,
    }
    best = {column.key: best_text(column, entries) for column in columns}
    board["lines"] = [
        _line(entry, board, best) | {"id": ids[entry]} for entry in entries
    ]
    return board


def _unranked_subsets(entries: Sequence[Entry]) -> list[Subset]:
    """Return the event subsets on which no entry has a place."""
    unranked = []
    for subset in SUBSETS[1:]:
        places = [entry.standing.places[subset].place for entry in entries]
        if all(place is None for place in places):
            unranked.append(subset)
    return unranked


def details_of(line: Line, board: Mapping[str, Any]) -> Line:
    """Return the content of the template for the details of an entry: its ``line``.

    With all cells, links, charts and tables.
    """
    entry: Entry = line["entry"]
    row = entry.row
    parts = [(name, text, getattr(row, name)) for name, text in _PARTS.items()]
    return line | {
        "cells": {key: column.shown(entry) for key, column in COLUMN.items()},
        "link": address_of(entry.link),
        "all_links": _links(entry),
        "chart": curve_chart(entry, board["reference"]),
        "subsets": subset_table(entry),
        "parts": [part for part in parts if part[2]],
        "costs": parts_text(row),
        "scenes": scene_chart(entry, board["reference"]),
    }


def subset_table(entry: Entry) -> Table:
    """Return the numbers of an entry on each subset, or of its drives."""
    if entry.driving is not None:
        return Table("driving", "How its forecasts drive", "", [entry.driving])
    standing = entry.standing
    column = {column.key: column for column in columns_of(Row)}

    def rank(row: Row) -> str | None:
        place = standing.places.get(row.subset)
        return None if place is None else place.rank

    def p_text(row: Row) -> str | None:
        difference = standing.differences.get(row.subset)
        return None if difference is None else p_value(difference.p)

    def of_difference(row: Row, name: str) -> Any:
        return getattr(standing.differences.get(row.subset), name, None)

    def own_gap(row: Row) -> float | None:
        return standing.own_gaps.get(row.subset)

    def association_gap(row: Row) -> float | None:
        return standing.association_gaps.get(row.subset)

    columns = [
        replace(column["subset"], read=lambda row: NAMES[row.subset]),
        Column(key="rank", read=rank),
        column["error"],
        column["interval"],
        replace(
            COLUMN["difference"],
            heading="to stp",
            read=lambda row: of_difference(row, "mean"),
        ),
        replace(
            COLUMN["difference_interval"],
            read=lambda row: of_difference(row, "interval"),
        ),
        replace(column["p"], unit="-", read=p_text),
        column["minADE"],
        column["minFDE"],
        column["coverage"],
        replace(COLUMN["same_gap"], optional=True, read=own_gap),
        replace(COLUMN["association_gap"], optional=True, read=association_gap),
        Column("events / objects / scenes", "-", key="sizes", read=_sizes),
    ]
    further = [c for c in further_columns([entry]) if not c.key.startswith("cost_")]
    rows = [entry.row_of(subset) for subset in entry.sums.subsets]
    return Table("subsets", "Errors in metres", "", rows, [*columns, *further])


def _sizes(row: Row) -> str:
    events = BLANK if row.events is None else f"{row.events:.0f}"
    return f"{events} / {row.objects} / {row.scenes}"


def difference_text(entry: Entry) -> str:
    """Return the difference to STP in words, for screen readers; empty without one."""
    difference = entry.difference()
    if difference is None:
        return ""
    mean = _SIGNED.text(difference.mean)
    p = p_value(difference.p)
    if difference.interval is None:
        return f"{mean} m, p {p}"
    return f"{mean} m, 95 % interval {_SIGNED.text(difference.interval)}, p {p}"


def address_of(link: str | None) -> str | None:
    """Return the relative address of a file: never of a script or another host."""
    if link is None:
        return None
    return "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")


def _line(
    entry: Entry, board: Mapping[str, Any], best: Mapping[str, str | None]
) -> Line:
    """Return the content of the template for one entry in the table ``board``."""
    record = entry.record
    submission = record.submission
    authors = ", ".join(submission.authors)
    all_authors = clean_text(authors, len(authors))
    reason = entry.why.removeprefix(f"{record.status}: ")
    is_explained = entry.compared or bool(entry.part)
    cells = {column.key: column.shown(entry) for column in board["columns"]}
    best_keys = {key for key, text in cells.items() if text == best[key]}
    return {
        "entry": entry,
        "record": record,
        "reference": entry is board["reference"],
        "authors": _short(authors),
        # for the search
        "all_authors": all_authors if len(authors) > _MAX_LETTERS else "",
        "links": [link for link in _links(entry) if len(link[1]) <= _MAX_LETTERS],
        "license": _short(submission.license),
        "trained": _short(entry.trained_on_scored),
        "why": "" if is_explained else _short(reason),
        "what": _short(_LATER_CLAUSES.sub(r"\1", submission.description)),
        "cells": cells,
        "best": best_keys if entry.compared else set(),
        "level": LEVELS.index(entry.level),
        "signer": entry.signed.signer if entry.signed else "",
        "bar": bar_of(board["scale"], entry.difference()),
        "difference": difference_text(entry),
        "old": why_scored_otherwise(record) is not None,
    }


def _short(text: str) -> str:
    return clean_text(text, _MAX_LETTERS)


def _links(entry: Entry) -> list[tuple[str, str]]:
    """Return addresses of code and paper; the code of a baseline is its folder."""
    submission = entry.record.submission
    code = submission.source or address_of(entry.code)
    links = (("code", code), ("paper", submission.paper))
    return [(label, address) for label, address in links if address]


def _about(env_id: str) -> dict[str, Any] | None:
    """Describe an environment by its card; None for one that does not ship."""
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    detections = "simulated" if card.detector is not None else "stored"
    if card.detector_name:
        detections = f"{detections} ({card.detector_name})"
    return {
        "summary": card.summary,
        "detections": detections,
        "data": package_of(card).dataset,
        "task": card.task,
    }


def answer_of(entries: Sequence[Entry], ids: Ids) -> dict[str, Any] | None:
    """Return the content of ``answer.html`` for one table.

    None where no entry compares with others. Without ranks the first one is that of the
    lowest bADE on the public scenes.
    """
    compared = [e for e in entries if e.compared and e.error is not None]
    if not compared:
        return None
    first = compared[0]
    ranked = [entry for entry in compared if entry.place is not None]
    worse = [entry for entry in ranked if not entry.among_best]
    span = first.standing.places["all"].span
    answer: dict[str, Any] = {
        "entry": first,
        "id": ids[first],
        "env": short_name(first.env),
        "equals": [(entry, ids[entry]) for entry in ranked[1:] if entry.among_best],
        "others": len(ranked) - 1,
        "worse": 0 if span is None else len(ranked) - span[1],
        "less_stp": _lead(first.difference()),
        "next": None,
        "less_next": None,
    }
    if worse:
        answer["next"] = (worse[0], ids[worse[0]])
        answer["less_next"] = _lead(first.minus(worse[0], "all"))
    return answer


def short_name(env_id: str) -> str:
    """Return a short id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")


def _lead(difference: PairedDifference | None) -> dict[str, str] | None:
    """Return a difference in words, with interval and p; None without an interval."""
    if difference is None or difference.interval is None:
        return None
    is_lower = difference.mean < 0
    sign = -1 if is_lower else 1
    low, high = sorted(sign * limit for limit in difference.interval)
    return {
        "by": f"{abs(difference.mean):.3f} m {'lower' if is_lower else 'higher'}",
        "interval": f"{low:.3f} to {high:.3f}".replace("-", "−"),
        "p": f"p {p_value(difference.p)}",
    }


def p_value(p: float) -> str:
    """Return a p-value as text: "= .034", or "< .001" for a smaller one."""
    return "< .001" if p < 0.001 else "= " + f"{p:.3f}".removeprefix("0")
