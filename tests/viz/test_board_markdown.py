"""Tables of the leaderboard in Markdown pages."""

import json

import pytest

from docs.generate.results import PARTS_FILE, STORY, filled
from mtp_bench.cards import load_card
from mtp_bench.scoring.definitions import DEFINITIONS
from mtp_bench.scoring.parts import PARTS
from mtp_bench.viz.board.entries import Entry
from tests.support.board_records import FEW, MAIN, board_of, made_up, made_up_board


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    return board_of(*made_up_board())


def marked(name: str) -> str:
    return f"before\n<!-- table: {name} -->\nold\n<!-- /table -->\nafter\n"


def rows_of(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]


def test_an_environment_has_a_row_per_entry(entries: list[Entry]) -> None:
    text = filled(marked(f"env {MAIN}"), entries, "page.md")
    assert text.startswith(f"before\n<!-- table: env {MAIN} -->\n\n| agent |")
    assert text.endswith("\n\n<!-- /table -->\nafter\n")
    headings, _, first, *_ = rows_of(text)
    assert headings[:4] == ["agent", "rank", "bADE (m) all targets ↓", "to stp (m) difference ↓"]
    assert (first[0], first[1]) == ("`braided_paths`", "1 (1–2)")
    assert first[2].startswith("0.742 [0.")
    assert [row[0] for row in rows_of(text)[2:]] == [f"`{entry.name}`" for entry in entries if entry.env == MAIN]
    assert filled(text, entries, "page.md") == text


def test_agents_stand_side_by_side_on_the_environments_that_all_of_them_have(entries: list[Entry]) -> None:
    rows = rows_of(filled(marked("all of stp calm_hedge"), entries, "page.md"))
    assert rows[0] == ["environment", "`stp` (m) ↓", "`calm_hedge` (m) ↓", "effective objects", "effective units"]
    assert [row[0] for row in rows[2:]] == [FEW, MAIN]
    (only,) = rows_of(filled(marked("ids of stp straight_on"), entries, "page.md"))[2:]
    assert only[0] == MAIN


def test_the_story_has_its_agents_in_order_with_their_ranks() -> None:
    rows = rows_of(filled(marked(f"story {MAIN}"), board_of(*(made_up(name) for name in STORY)), "page.md"))
    assert [row[0] for row in rows[2:]] == [f"`{name}`" for name in STORY]
    assert rows[0][1:5] == ["all targets (m) ↓", "rank (range)", "identity switch (m) ↓", "rank (range)"]


def test_costs_are_differences_of_controls_and_references() -> None:
    agents = {"stp": 1.2, "truth_past": 0.5, "stp_same_budget": 1.1, "perfect_association_same_samples": 0.9}
    entries = board_of(*(made_up(name, error) for name, error in agents.items()))
    rows = rows_of(filled(marked("costs"), entries, "page.md"))[2:]
    assert [row[1] for row in rows] == ["all", "ids", "reacquired"]
    assert (rows[0][2][:6], rows[0][3][:6]) == ("+0.700", "+0.200")


def test_shares_of_the_error_by_cause_are_those_of_the_file_and_add_up() -> None:
    measured = json.loads(PARTS_FILE.read_text(encoding="utf-8"))
    for row in measured:
        assert (list(row["parts"]), sum(row["parts"].values())) == (list(PARTS), pytest.approx(row["error"], abs=1e-9))
        assert (row["definitions"], row["card"]) == (DEFINITIONS, load_card(row["env"]).digest)
    headings, _, *rows = rows_of(filled(marked("parts"), [], "page.md"))
    assert headings == ["environment", "agent", "scenes; seeds", "bADE (m) ↓", *PARTS.values()]
    assert [row[:2] for row in rows] == [[row["env"], f"`{row['agent']}`"] for row in measured]
    for row in rows:
        shares = [float(cell.removesuffix(" %").replace("−", "-")) for cell in row[4:]]
        assert sum(shares) == pytest.approx(100, abs=0.05 * len(PARTS))


def test_records_of_earlier_definitions_fill_a_table_that_has_no_others() -> None:
    old = made_up("old", 0.5, scorer={"definitions": "2.0"})
    headings, _, only = rows_of(filled(marked(f"env {MAIN}"), board_of(old), "page.md"))
    assert (headings[0], only[0]) == ("agent (definitions 2.0)", "`old`")
    assert rows_of(filled(marked("all of old"), board_of(old), "page.md"))[2][0] == f"{MAIN} (definitions 2.0)"
    new = filled(marked(f"env {MAIN}"), board_of(old, made_up("new")), "page.md")
    assert [row[0] for row in rows_of(new)[2:]] == ["`new`"]
