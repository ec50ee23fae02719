"""One declaration of a column, and the table in each format."""

import csv
import io
import json
from dataclasses import dataclass
from typing import Annotated

import pytest

from mtp_bench.core import Column, Table, columns_of, tables_text, to_csv, to_html, to_json, to_markdown, to_text

Metres = Annotated[float | None, Column(unit="m", better="lower")]


@dataclass(frozen=True)
class Cost:
    """A row whose fields declare every kind of column."""

    agent: Annotated[str, Column()]
    targets: Annotated[int, Column(group="size", help="Number of targets.")]
    error: Metres
    interval: Annotated[tuple[float, float] | None, Column(interval=True)]
    coverage: Annotated[float | None, Column("covered", "share", "higher")]
    note: str = "a field without a column"
    energy_score: Annotated[float | None, Column(optional=True)] = None


FULL = Cost("stp_a|b", 12, 0.7312, (0.5, 12.345), 0.5)
EMPTY = Cost("=1+1", 0, None, None, None)
TABLE = Table("costs", "Costs & gains", "What an agent costs.", [FULL, EMPTY])


def test_the_fields_declare_the_columns_and_their_keys() -> None:
    columns = columns_of(Cost)
    assert [column.key for column in columns] == [
        "agent", "targets", "error", "interval", "coverage", "energy_score",
    ]  # fmt: skip
    assert [column.title for column in columns[-2:]] == ["covered", "energy score"]
    assert [column.arrow for column in columns[2:5]] == ["↓", "", "↑"]


@pytest.mark.parametrize(("column", "value", "text"), [
    (Column(), None, "–"), (Column(), "x", "x"), (Column(), 12345, "12345"), (Column(), 0.73125, "0.731"),
    (Column(), 9.9996, "10.00"), (Column(), -123.46, "−123.5"), (Column(), (0.5, 12.345), "0.500 to 12.35"),
    (Column(format="+.3f"), -0.0001, "0.000"), (Column(format="+.3f"), 0.25, "+0.250"),
    (Column(unit="share"), 0.456, "46 %"), (Column(unit="share", format=".1%"), -0.456, "−45.6 %"),
])  # fmt: skip
def test_text_of_a_value(column: Column, value: str | float | None, text: str) -> None:
    assert column.text(value) == text


def test_csv_has_units_two_columns_per_interval_and_no_formula() -> None:
    lines = list(csv.reader(io.StringIO(to_csv(TABLE))))
    assert lines == [
        ["agent", "targets", "error [m]", "interval_low", "interval_high", "coverage [share]", "energy_score"],
        ["stp_a|b", "12", "0.7312", "0.5", "12.345", "0.5", ""],
        ["'=1+1", "0", "", "", "", "", ""],
    ]


def test_json_holds_every_column_and_null_where_a_value_is_missing() -> None:
    content = json.loads(to_json(TABLE))
    assert content["rows"][1] == {
        "agent": "=1+1", "targets": 0, "error": None, "interval": None, "coverage": None, "energy_score": None,
    }  # fmt: skip
    assert content["columns"][2] == {"key": "error", "heading": "error", "unit": "m", "better": "lower", "help": ""}
    with pytest.raises(ValueError, match="JSON"):
        to_json(Table("costs", "", "", [Cost("x", 1, float("nan"), None, None)]))


def test_markdown_joins_an_interval_to_its_number_and_leaves_an_empty_optional_column_out() -> None:
    assert to_markdown(TABLE).splitlines() == [
        "| agent | size targets | error (m) ↓ | covered ↑ |",
        "| --- | --: | --: | --: |",
        "| stp_a\\|b | 12 | 0.731 [0.500, 12.35] | 50 % |",
        "| =1+1 | 0 | – | – |",
    ]


def test_latex_escapes_and_groups() -> None:
    lines = tables_text(".tex", [TABLE], TABLE).splitlines()
    assert all(text in lines for text in (r"\caption{Costs \& gains}", r"\begin{tabular}{lrrr}"))
    assert r"\multicolumn{1}{c}{} & \multicolumn{1}{c}{size} & \multicolumn{2}{c}{} \\" in lines
    assert all(text in lines for text in (r"\cmidrule(lr){2-2}", r"stp\_a|b & 12 & 0.731 [0.500, 12.35] & 50 \% \\"))


def test_a_row_older_than_a_column_has_a_blank() -> None:
    table = Table("costs", "", "", [FULL], [*columns_of(Cost), Column("speed", "m/s", key="speed")])
    assert to_markdown(table).splitlines()[-1].endswith("| – |")
    assert to_csv(table).splitlines()[1].endswith(",")


@pytest.mark.parametrize(("suffix", "start"), [(".csv", "agent"), (".json", "{"), (".md", "**C"), (".tex", "\\begin")])
def test_the_suffix_chooses_the_format(suffix: str, start: str) -> None:
    assert tables_text(suffix, [TABLE], TABLE).startswith(start)


@pytest.mark.parametrize("text", ["=1+1", "+a", "-a", "@x", "\t=x", "\r=1", "'=1"])
def test_no_text_of_a_csv_is_a_formula(text: str) -> None:
    (row,) = csv.DictReader(io.StringIO(to_csv(Table("x", "", "", [Cost(text, 1, -1.5, None, None)]))))
    assert (row["agent"], row["error [m]"]) == (f"'{text.strip()}", "-1.5")


def test_plain_text_fits_and_stands_intervals_below_their_numbers() -> None:
    long = Cost("a_quite_long_name_of_an_agent", 12, 0.7312, (-0.5, 12.345), 0.5)
    assert to_text(Table("costs", "Costs", "What an agent costs.", [FULL, long]), 50).splitlines() == [
        "Costs",
        "                       size",
        "agent                targets        error covered",
        "─" * 49,
        "stp_a|b                   12        0.731    50 %",
        "                              0.500 12.35",
        "a_quite_long_name_of      12        0.731    50 %",
        "_an_agent                    −0.500 12.35",
        "What an agent costs.",
    ]
    html = to_html(TABLE)
    assert "<caption>Costs &amp; gains</caption>" in html
    assert "<td>0.731 [0.500, 12.35]</td><td>50 %</td>" in html
