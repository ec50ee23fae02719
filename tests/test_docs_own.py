"""The page on own scenes says what the code does: its tables are those of the code, its blocks run."""

from pathlib import Path

import pytest

from mtp_bench.cards import load_card
from mtp_bench.sources.files.columns import COLUMNS, LABELS, PICTURES, TABLES
from tests.support.own_scenes import write_long_log
from tests.test_readme import blocks

pytestmark = pytest.mark.usefixtures("few_event_runs")
PAGE = "docs/data/own.md"


def columns_table(name: str) -> str:
    """The columns of a table, as the page shows them."""
    lines = ["| column | what it is | left out |", "|---|---|---|"]
    lines += [f"| `{one.name}` | {one.meaning} | {one.without or 'an error'} |" for one in COLUMNS[name]]
    return "\n".join(lines)


def page(repository: Path) -> str:
    return (repository / PAGE).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [*TABLES, *LABELS, *PICTURES])
def test_the_columns_are_those_of_the_code(repository: Path, name: str) -> None:
    assert columns_table(name) in page(repository)


def test_the_columns_of_tracks_are_those_of_the_code(repository: Path) -> None:
    assert columns_table("tracks") in (repository / "docs/data/stored_tracks.md").read_text(encoding="utf-8")


def test_the_blocks_run(repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_long_log(tmp_path / "logs")
    monkeypatch.chdir(tmp_path)
    for block in blocks(repository / PAGE, "python"):
        exec(compile(block, PAGE, "exec"), {})
    assert (tmp_path / "runs" / "from_python" / "run.json").is_file()


def test_the_card_is_one(repository: Path, tmp_path: Path) -> None:
    (block,) = blocks(repository / PAGE, "toml")
    (tmp_path / "MTP-logs-v0.toml").write_text(block)
    card = load_card(tmp_path / "MTP-logs-v0.toml")
    assert (card.detector_name, card.stored()["source"]["folder"]) == ("pointrcnn-ours", str(tmp_path / "logs"))
