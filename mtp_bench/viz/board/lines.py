"""Content of the templates for one table of the page, and for each entry in it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any
from urllib.parse import quote

from ...cards import load_card
from ...core import Column, Table, card_ids, clean_text
from ...judge import LEVELS, STP, why_scored_otherwise
from ...running import card_budget
from ...scoring import SUBSET_NAMES, SUBSETS, Subset
from ...sources import package_of
from ..terminal.settings_table import ROW_COLUMNS
from ..terminal.tables import parts_text
from .columns import COLUMN, OPTIONAL_COLUMNS, PAGE, best_text
from .drawings import WIDTH, Scale, bar_of, scale_of
from .entries import Entry, empty_error, has_map, is_simulated

_MAX_LETTERS = 120  # of a text in a row: the details show all of it
# the clauses of a description after the first, which has at least 28 letters
_LATER_CLAUSES = re.compile(r"^(.{28}.*?)(?:; |: |, [a-z]| \().*")
_SIGNED = COLUMN["difference"]
_PARTS = {"localisation": "with forecast", "missed": "without forecast"}
Line = dict[str, Any]


def board_of(entries: Sequence[Entry]) -> dict[str, Any]:
    """Return the content of the template for one table."""
    env_id = entries[0].env
    compared = [entry for entry in entries if entry.compared]
    # its record states the conditions of the table: those of the main ranking, if any
    first_entry = compared[0] if compared else entries[0]
    record = first_entry.record
    reference = next((entry for entry in compared if entry.name == STP), None)
    columns = _shown_columns(entries)
    scale = scale_of(entries)
    card_digests = {entry.record.env.card_digest for entry in entries}
    board: dict[str, Any] = {
        "env": env_id,
        "name": short_name(env_id),
        "about": _about(env_id),
        "budgets": card_budget(env_id).text(record.env.truth_complete),
        "simulated": is_simulated(env_id),
        "map": has_map(env_id),
        "drive": first_entry.driving is not None,
        "card_digests": sorted(card_digests - {""}),
        "split": record.env.split,
        "ranked_count": sum(entry.place is not None for entry in entries),
        "first_row": first_entry.row,
        "empty_error": empty_error(entries),
        "answer": answer_of(compared),
        # agents are never ranked on turning targets
        "faint_columns": {"turning", *_unranked_subsets(entries)},
        "columns": columns,
        "groups": _groups(columns),
        "scale": scale,
        "zero_x": _zero_x(scale),
        "reference": reference,
    }
    best = {}
    for column in columns:
        best[column.key] = best_text(column, entries)
    board["lines"] = [_line(entry, board, best) for entry in entries]
    return board


def _zero_x(scale: Scale | None) -> float:
    """Return where a difference of 0 is drawn, in user units."""
    return WIDTH / 2 if scale is None else scale.x(0.0)


def _shown_columns(entries: Sequence[Entry]) -> list[Column]:
    """Return the columns in which an entry has a value."""
    columns = []
    for key in PAGE:
        column = COLUMN[key]
        if any(column.value(entry) is not None for entry in entries):
            columns.append(column)
    return columns


def _groups(columns: Sequence[Column]) -> list[tuple[str, list[Column]]]:
    """Return groups of columns under one heading, which have one class.

    Screens show or leave out all columns of a class.
    """
    groups = []
    by_heading = groupby(columns, lambda column: (column.group, PAGE[column.key]))
    for (heading, _), members in by_heading:
        groups.append((heading, list(members)))
    return groups


def _unranked_subsets(entries: Sequence[Entry]) -> list[Subset]:
    """Return the event subsets on which no entry has a place."""
    unranked = []
    for subset in SUBSETS[1:]:
        places = {entry.standing.places[subset].place for entry in entries}
        if places == {None}:
            unranked.append(subset)
    return unranked


def details_of(line: Line) -> Line:
    """Return the content of the template for an entry's details.

    It is the ``line`` of the entry with all cells, links and tables.
    """
    entry: Entry = line["entry"]
    row = entry.row
    error_parts = []
    for name, part_name in _PARTS.items():
        if part_m := getattr(row, name):
            error_parts.append((name, part_name, part_m))
    return line | {
        "cells": {key: column.shown(entry) for key, column in COLUMN.items()},
        "link": address_of(entry.link),
        "all_links": _links(entry),
        "subsets": subset_table(entry),
        "parts": error_parts,
        "costs": parts_text(row),
    }


def subset_table(entry: Entry) -> Table:
    """Return the numbers of an entry by subset, or its drives."""
    if entry.driving is not None:
        return Table("driving", "How its forecasts drive", "", [entry.driving])
    # read=None: values are those of `_subset_row` by key, not of an entry
    columns = [
        ROW_COLUMNS["subset"],
        Column(key="rank"),
        ROW_COLUMNS["error"],
        ROW_COLUMNS["interval"],
        replace(_SIGNED, heading="to stp", read=None),
        replace(COLUMN["difference_interval"], read=None),
        replace(ROW_COLUMNS["p"], unit="-"),
        ROW_COLUMNS["minADE"],
        ROW_COLUMNS["minFDE"],
        ROW_COLUMNS["coverage"],
        replace(COLUMN["same_gap"], optional=True, read=None),
        replace(COLUMN["association_gap"], optional=True, read=None),
        Column("events / objects / scenes", "-", key="sizes"),
    ]
    for metric in OPTIONAL_COLUMNS:
        if not metric.key.startswith("cost_"):  # the parts of bADE have a drawing
            columns.append(metric)
    rows = [_subset_row(entry, subset) for subset in entry.sums.subsets]
    return Table("subsets", "Errors in metres", "", rows, columns)


def _subset_row(entry: Entry, subset: Subset) -> dict[str, Any]:
    """Return the cells of one subset by the keys of columns."""
    row = entry.row_of(subset)
    standing = entry.standing
    events = Column(format=".0f").text(row.events)
    cells: dict[str, Any] = dict(row)
    # ranks and tests depend on other records: the row of a record lacks them
    cells |= {
        "subset": SUBSET_NAMES[subset],
        "sizes": f"{events} / {row.objects} / {row.scenes}",
        "same_gap": standing.own_gaps.get(subset),
        "association_gap": standing.association_gaps.get(subset),
    }
    if subset in standing.places:
        cells["rank"] = standing.places[subset].rank
    if subset in standing.differences:
        difference = standing.differences[subset]
        cells["difference"] = difference.mean
        cells["difference_interval"] = difference.interval
        cells["p"] = p_value(difference.p)
    return cells


def difference_text(entry: Entry) -> str:
    """Return the difference to STP in words, for screen readers.

    Empty without one.
    """
    difference = entry.difference
    if difference is None:
        return ""
    text = f"{_SIGNED.text(difference.mean)} m"
    if difference.interval is not None:
        text += f", 95 % interval {_SIGNED.text(difference.interval)}"
    return f"{text}, p {p_value(difference.p)}"


def address_of(link: str | None) -> str | None:
    """Return the relative address of a file.

    It is never that of a script or of another host.
    """
    if link is None:
        return None
    return "./" + quote(link.lstrip("/"), safe="/", errors="surrogateescape")


def _line(
    entry: Entry, board: Mapping[str, Any], best: Mapping[str, str | None]
) -> Line:
    """Return the content of the template for an entry's row.

    ``board``: the content for its table.
    """
    record = entry.record
    submission = record.submission
    authors = ", ".join(submission.authors)
    cells = {}
    best_keys = set()
    for column in board["columns"]:
        cells[column.key] = column.shown(entry)
        if entry.compared and cells[column.key] == best[column.key]:
            best_keys.add(column.key)
    line = {
        "entry": entry,
        "record": record,
        "is_reference": entry is board["reference"],
        "authors": _short(authors),
        "links": [link for link in _links(entry) if len(link[1]) <= _MAX_LETTERS],
        "license": _short(submission.license),
        "trained_on_scored": _short(entry.trained_on_scored),
        "summary": _short(_LATER_CLAUSES.sub(r"\1", submission.description)),
        "cells": cells,
        "best_keys": best_keys,
        "level_index": LEVELS.index(entry.level),
        "bar": bar_of(board["scale"], entry.difference),
        "difference_text": difference_text(entry),
        "has_old_scorer": why_scored_otherwise(record) is not None,
        "all_authors": "",
        "why_unranked": "",
    }
    if len(authors) > _MAX_LETTERS:
        # for the search
        line["all_authors"] = clean_text(authors, len(authors))
    # above the table it is said once for the compared, and a tag names a partial record
    if not (entry.compared or entry.part):
        line["why_unranked"] = _short(entry.why.removeprefix(f"{record.status}: "))
    return line


def _short(text: str) -> str:
    return clean_text(text, _MAX_LETTERS)


def _links(entry: Entry) -> list[tuple[str, str]]:
    """Return addresses of code and paper.

    The code of a baseline is its folder.
    """
    submission = entry.record.submission
    links = []
    if code := submission.source or address_of(entry.code):
        links.append(("code", code))
    if submission.paper:
        links.append(("paper", submission.paper))
    return links


def _about(env_id: str) -> dict[str, Any] | None:
    """Describe an environment by its card.

    None for one that does not ship.
    """
    if env_id not in card_ids():
        return None
    card = load_card(env_id)
    detections = "stored"
    if card.detector is not None:
        detections = "simulated"
    if card.detector_name:
        detections = f"{detections} ({card.detector_name})"
    return {
        "summary": card.summary,
        "detections": detections,
        "data": package_of(card).dataset,
        "task": card.task,
    }


def answer_of(compared: Sequence[Entry]) -> dict[str, Any] | None:
    """Return the content of ``answer.html`` for the ``compared`` entries of a table.

    It names the best entry, those that are not significantly worse, and the next one.
    None without entries. Without ranks the best has the lowest bADE on the public
    scenes.
    """
    if not compared:
        return None
    best = compared[0]
    ranked = [entry for entry in compared if entry.place is not None]
    answer: dict[str, Any] = {
        "entry": best,
        "equals": [],
        "others": len(ranked) - 1,
        "worse": 0,
    }
    for entry in ranked:
        if entry is not best and entry.among_best:
            answer["equals"].append(entry)
    span = best.standing.places["all"].span
    if span is not None:  # its end is the last rank that tests leave open to the best
        answer["worse"] = len(ranked) - span[1]
    return answer


def short_name(env_id: str) -> str:
    """Return a short id for headings: "nuScenes mini" for MTP-nuScenes-mini-v0."""
    return env_id.removeprefix("MTP-").removesuffix("-v0").replace("-", " ")


def p_value(p: float) -> str:
    """Return a p-value as text: "= .034", or "< .001"."""
    return "< .001" if p < 0.001 else "= " + f"{p:.3f}".removeprefix("0")
