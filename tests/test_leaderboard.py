"""The leaderboard as it is committed: records that hold together, and a page that was made of them."""

from __future__ import annotations

import shutil
from pathlib import Path

from mtp_bench.cards import load_card
from mtp_bench.scoring import DEFINITIONS
from mtp_bench.submission.records import load_record, record_paths
from tests.command_line import CommandLine


def test_records_fit_their_environments(repository: Path) -> None:
    paths = record_paths(repository / "leaderboard" / "records")
    assert paths
    for path in paths:
        record = load_record(path)
        assert (path.parent.name, path.stem) == (record.submission.name, record.env.id)
        assert record.env.card_digest == load_card(record.env.id).digest
        assert record.scorer.definitions == DEFINITIONS
        assert record.status == "finished"


def test_the_page_is_made_of_the_records(repository: Path, tmp_path: Path, cli: CommandLine) -> None:
    """To mend it: mtp-bench board --records leaderboard/records -o leaderboard/index.html."""
    copy = tmp_path / "leaderboard"
    shutil.copytree(
        repository / "leaderboard" / "records", copy / "records", ignore=shutil.ignore_patterns("*.rollouts")
    )
    cli.ok("board", "--records", copy / "records", "-o", copy / "index.html")
    assert (copy / "index.html").read_bytes() == (repository / "leaderboard" / "index.html").read_bytes()
