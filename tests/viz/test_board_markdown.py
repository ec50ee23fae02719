"""Tables of the leaderboard in Markdown pages."""

import json
from collections.abc import Callable

import pytest

from docs.generate.driving import FIGURES
from docs.generate.paper import RELATIONS
from docs.generate.results import DRIVERS, PARTS_FILE, STORY, SUBSET_TEXT, filled
from mtp_bench.cards import load_card
from mtp_bench.core.errors import MtpBenchError
from mtp_bench.judge.records.shipped import earlier_cards
from mtp_bench.scoring.definitions import DEFINITIONS
from mtp_bench.scoring.parts import PART_NAMES, STAGE_NAMES
from mtp_bench.viz.board.entries import Entry
from tests.support.board_records import FEW, MAIN, board_of, made_up, made_up_board


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    return board_of(*made_up_board())


def marked(name: str) -> str:
    return f"before\n<!-- table: {name} -->\nold\n<!-- /table -->\nafter\n"


def rows_of(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]


def test_a_pair_has_a_row_per_environment_that_has_both_agents(entries: list[Entry]) -> None:
    text = filled(marked("pairs * of stp-calm_hedge"), entries, "page.md")
    assert text.startswith("before\n<!-- table: pairs * of stp-calm_hedge -->\n\n| environment |")
    assert text.endswith("\n\n<!-- /table -->\nafter\n")
    rows = rows_of(text)
    assert rows[0] == ["environment", "all targets (m)", "identity switch (m)", "reacquired (m)"]
    assert [row[0] for row in rows[2:]] == [FEW, MAIN]
    one, other = (next(e for e in entries if (e.name, e.env) == (name, MAIN)) for name in ("stp", "calm_hedge"))
    assert float(rows[3][1].split()[0].replace("−", "-")) == pytest.approx(
        (one.error or 0) - (other.error or 0), abs=6e-4
    )
    assert filled(text, entries, "page.md") == text
    two = rows_of(filled(marked(f"pairs {MAIN} of stp-calm_hedge,calm_hedge-straight_on"), entries, "page.md"))
    assert [row[:2] for row in two[2:]] == [
        [MAIN, "`stp` − `calm_hedge`"], [MAIN, "`calm_hedge` − `straight_on`"]
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["pairs * of stp-nobody", "pairs MTP-X-v0 of stp-calm_hedge", "pairs *", "env X"])
def test_a_name_that_cannot_be_filled_in_is_refused(name: str, entries: list[Entry]) -> None:
    with pytest.raises(MtpBenchError, match=r"nobody|MTP-X-v0|expected `story"):
        filled(marked(name), entries, "page.md")


def test_the_story_has_its_agents_in_order_with_ranks_energy_and_brier_scores() -> None:
    """The Brier score is that of another environment, whose truth is complete."""
    records = [made_up(name) for name in STORY]
    records += [made_up(name, env_id=FEW, brier=0.05) for name in STORY]
    rows = rows_of(filled(marked(f"story {MAIN} with {FEW}"), board_of(*records), "page.md"))
    assert [row[0] for row in rows[2:]] == [f"`{name}`" for name in STORY]
    assert rows[0][1:6] == [
        "all targets (m) ↓", "place (range)", "identity switch (m) ↓", "energy score (m) ↓", "Brier score, WILDTRACK ↓",
    ]  # fmt: skip
    assert {row[4] for row in rows[2:]} == {"1.00"}
    assert {row[5] for row in rows[2:]} == {"0.050"}
    with pytest.raises(MtpBenchError, match=f"agent of {FEW}"):
        filled(marked(f"story {MAIN} with {FEW}"), board_of(*records[: len(STORY)]), "page.md")


def test_costs_are_differences_of_controls_and_references() -> None:
    agents = {"stp": 1.2, "gt_tracks": 0.5, "stp_same_samples": 1.1, "perfect_association_same_samples": 0.9}
    entries = board_of(*(made_up(name, error) for name, error in agents.items()))
    headings, _, row = rows_of(filled(marked("costs *"), entries, "page.md"))
    assert [heading.partition(", ")[2] for heading in headings[2:]] == [f"{text} (m)" for text in SUBSET_TEXT.values()]
    assert (row[1][:6], row[2][:6]) == ("+0.700", "+0.200")


def test_shares_of_the_error_by_part_of_the_stack_add_up() -> None:
    measured = json.loads(PARTS_FILE.read_text(encoding="utf-8"))
    for row in measured:
        assert (list(row["parts"]), sum(row["parts"].values())) == (
            list(PART_NAMES),
            pytest.approx(row["error"], abs=1e-9),
        )
        assert row["definitions"] in {"3.0", DEFINITIONS}  # full splits: the same numbers
        assert row["card"] == load_card(row["env"]).digest
    headings, _, *rows = rows_of(filled(marked("faults"), [], "page.md"))
    assert headings == ["environment", "agent", "scenes; seeds", "bADE (m) ↓", *STAGE_NAMES.values()]
    assert [row[:2] for row in rows] == [[row["env"], f"`{row['agent']}`"] for row in measured]
    for row in rows:
        shares = [float(cell.removesuffix(" %").replace("−", "-")) for cell in row[4:]]
        assert sum(shares) == pytest.approx(100, abs=0.05 * len(STAGE_NAMES))


def test_agreement_is_kendalls_tau_of_the_orders() -> None:
    """The second environment has the order turned round; the last has too few units to rank."""
    errors, one, other = {"stp": 1.0, "mtp": 1.3, "stp_modes": 1.7}, MAIN, "MTP-nuScenes-mini-v0"
    worlds: dict[str, Callable[[float], float]] = {one: float, other: lambda each: 3 - each, FEW: float}
    entries = board_of(*(made_up(n, of(e), env) for env, of in worlds.items() for n, e in errors.items()))
    _, _, *rows = rows_of(filled(marked(f"agreement {one} with {','.join(worlds)}"), entries, "page.md"))
    taus = {env: [cell.split(" ")[0] for cell in row] for env, *row in rows}
    assert (taus[one][:2], taus[other][:2], taus[FEW][1]) == (["3", "1.00"], ["3", "−1.00"], "–")


def test_relations_of_the_paper_stand_beside_those_of_records() -> None:
    agents = {"stp": 1.2, "mtp": 0.9, "gt_tracks": 0.5, "stp_same_samples": 1.1}
    entries = board_of(*(made_up(name, error, "MTP-nuScenes-v0") for name, error in agents.items()))
    headings, _, *rows = rows_of(filled(marked("paper"), entries, "page.md"))
    assert [row[:4] for row in rows] == [
        [each.table, "MTP-nuScenes-v0", {"paper_ids": "IDS", "paper_frag": "FRAG", "all": "all"}[each.subset],
         f"`{each.agents[1]}`"] for each in RELATIONS if each.data == "nuScenes"
    ]  # fmt: skip
    everything = dict(zip(headings, rows[-1], strict=True))
    assert (everything["paper"], everything["bADE to `stp` (m)"][:5]) == ("−32 %", "−0.30")
    assert everything["bADE beyond the samples (m)"][:5] == "−0.20"


def test_drive_scores_stand_beside_their_agreement_with_bade() -> None:
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    headings, _, *rows = rows_of(filled(marked("driving"), [], "page.md"))
    assert headings[2:-2] == [f"`{agent}` ↑" for agent in DRIVERS]
    assert [row[0] for row in rows] == list(figures)
    for row, figure in zip(rows, figures.values(), strict=True):
        assert row[1] == earlier_cards().get(figure["card"], "today's planner")
        assert row[3].startswith(f"{figure['rows']['stp']['drive_score']:.2f} [")
        assert row[-2].startswith(f"{figure['tau']['all']['measures']['bADE']['tau']:.2f} [")
