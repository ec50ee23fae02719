"""The leaderboard as it is committed: records that hold together, and a page that was made of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mtp_bench.cards import load_card
from mtp_bench.records import Record, record_paths
from mtp_bench.records.shipped import baseline_digest
from mtp_bench.records.storage import read_as
from mtp_bench.scoring import DEFINITIONS
from tests.support.command_line import CommandLine


@pytest.fixture(scope="module")
def records(repository: Path) -> dict[Path, Record]:
    """As they are read: whether they hold together is asked where the pages are made of them."""
    return {path: read_as(Record, path) for path in record_paths(repository / "leaderboard" / "records")}


def test_records_fit_their_environments(records: dict[Path, Record]) -> None:
    for path, record in records.items():
        assert (path.parent.name, path.stem) == (record.submission.name, record.env.id)
        assert record.status == "finished"
        assert record.env.scenes == record.env.scenes_of_split
        assert (record.missed.malformed, record.missed.crashed_scenes) == (0, 0)
        if not record.earlier_version:  # what ships today made it
            assert record.env.card_digest == load_card(record.env.id).digest
            assert record.scorer.definitions == DEFINITIONS
            assert record.submission.digest == baseline_digest(record.submission.name, record.submission.networks)


def test_the_pages_are_made_of_the_records(repository: Path, tmp_path: Path, cli: CommandLine) -> None:
    """The board, and the tables of RESULTS.md and the README. To mend it: make pages."""
    committed, copy = repository / "leaderboard", tmp_path / "leaderboard"
    made = ("index.*", "*.rollouts", "*.part")
    shutil.copytree(committed, copy, ignore=shutil.ignore_patterns(*made))
    (tmp_path / "baselines").symlink_to(repository / "baselines")  # the page links to them
    shutil.copy(repository / "README.md", tmp_path)
    pages = [copy / "RESULTS.md", tmp_path / "README.md"]
    filled = [word for page in pages for word in ("--fill", page)]
    cli.ok("board", "--records", copy / "records", "-o", copy / "index.html", *filled)
    assert _files(copy) == _files(committed)
    for page in pages:
        assert page.read_bytes() == (repository / page.relative_to(tmp_path)).read_bytes(), page.name


def _files(leaderboard: Path) -> dict[str, bytes]:
    """The page and its parts."""
    paths = [leaderboard / "index.html", *sorted((leaderboard / "index.parts").rglob("*"))]
    return {path.relative_to(leaderboard).as_posix(): path.read_bytes() for path in paths if path.is_file()}
