"""`mtp-bench compare` and `score`: the verdict, one table of 80 columns, the rest when asked."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.support.command_line import CommandLine, read_json, write_submission


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An agent that answers with the detections."""
    return write_submission(tmp_path_factory.mktemp("agents") / "mine", "mine")


def test_a_comparison(mine: Path, cli: CommandLine, known: list[str], tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    printed = cli.ok("compare", mine, *known, "--seeds", 1, "--jobs", 1, "--full", "--json", file)
    assert [line for line in printed.splitlines() if len(line.rstrip()) > 80] == []
    verdict, table, *further = printed.split("\n\n")

    assert verdict.startswith("- Over all targets detection and tracking together cost ")
    text = " ".join(verdict.split())
    assert "- mine (H = 2) against stp over all targets: " in text
    assert "- mine (H = 2) against stp_same_budget, one hypothesis with 20 times k samples: " in text
    assert "- No agent is ranked over all targets (" in text
    assert "mtp (H" not in text

    assert table.startswith("MTP-Small-v0: m, less is better")
    agents = [line.split()[0] for line in table.splitlines() if line.count("/") == 3]
    known = ["truth_past", "truth_past", "stp", "stp_same_budget", "stp_hedged", "perfect_associa", "perfect_associa"]
    assert sorted(agents) == sorted([*known, "mine"])
    errors = [line.split()[-4] for line in table.splitlines() if line.count("/") == 3]
    assert errors == sorted(errors)  # agents are listed by bADE
    assert "event weights of 48 runs of 'stp' on these scenes" in " ".join(table.split())

    titles = [part.split()[0] for part in further]
    assert titles[:4] == ["Subsets", "Error", "minADE/minFDE", "Differences"]

    content = read_json(file)
    assert list(content) == [
        "env", "definitions", "rows", "condition", "paired", "details", "skipped",
    ]  # fmt: skip


def test_a_stored_run_has_the_same_table(mine: Path, cli: CommandLine, known: list[str], tmp_path: Path) -> None:
    cli.ok("run", mine, *known, "-o", tmp_path / "run", "--jobs", 1)
    printed = cli.ok("score", tmp_path / "run", *known, "--full")
    assert printed.startswith("MTP-Small-v0: m, less is better")
    of_mine = [line.split()[:2] for line in printed.split("\n\n")[0].splitlines() if line.startswith("mine")]
    assert of_mine == [["mine", "2"], ["mine", "(H"]]  # its numbers, and the parts of its bADE
    assert "\nSubsets" in printed
    latex = tmp_path / "table.tex"
    content = json.loads(cli.ok("score", tmp_path / "run", *known, "--json", "-", "--table", latex))
    assert latex.read_text().startswith("\\begin{table}\n\\caption{MTP-Small-v0: m, less is better}")
    assert list(content) == ["env", "definitions", "rows", "condition", "details", "skipped"]
