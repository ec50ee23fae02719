"""A metric as a stranger adds it: one declared field, shown on the board; rows without it have a blank."""

import csv
import io
from typing import Annotated

import pytest

from mtp_bench.core import Column, columns_of, to_csv
from mtp_bench.judge.records import results
from mtp_bench.scoring.rows import Row
from mtp_bench.viz.board import columns, lines
from mtp_bench.viz.board.columns import board_json, board_table
from mtp_bench.viz.board.entries import LinkedRecord, entries_of
from mtp_bench.viz.board.page import board_files
from tests.support.board_records import MAIN, made_up
from tests.support.report_rows import rows

SETTING = ("mine", 3, 20, "equal")


class FurtherRow(Row):
    """A row with one more metric."""

    jerk: Annotated[float | None, Column("jerk", "m/s³", "lower", optional=True)] = None


def test_the_board_shows_it_and_records_without_it_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "Row", FurtherRow)
    monkeypatch.setattr(results, "FACTS", results.FACTS | {"jerk"})
    optional = [column for column in columns_of(FurtherRow) if column.optional]
    for module in (columns, lines):
        monkeypatch.setattr(module, "OPTIONAL_COLUMNS", optional)
    plain = made_up("plain")
    entry_with = made_up("with_it", 0.5, numbers={"all": {"jerk": 4.321}})
    entries = entries_of([LinkedRecord(entry_with), LinkedRecord(plain)])
    assert [row.get("jerk") for row in board_json(entries)[MAIN]] == [4.321, None]
    assert [line["jerk [m/s³]"] for line in csv.DictReader(io.StringIO(to_csv(board_table(entries, MAIN))))] == [
        "4.321",
        "",
    ]
    with_it, without = board_files(entries).parts[f"{MAIN}.js"].splitlines()
    assert all(text in with_it for text in ("jerk", "4.321"))
    assert "jerk" not in without


def test_a_stored_row_without_the_metric_loads() -> None:
    stored = rows(SETTING)[0].model_dump(mode="json")
    assert FurtherRow.model_validate(stored).jerk is None
    optional = [column.key for column in columns_of(Row) if column.optional]
    older = Row.model_validate({key: value for key, value in stored.items() if key not in optional})
    assert {getattr(older, key) for key in optional} == {None}
    assert {*Row.model_fields} >= results.FACTS, "a record stores every field that sums do not give"
