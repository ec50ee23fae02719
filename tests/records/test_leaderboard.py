"""The leaderboard as it is committed: records that hold together, and a page that was made of them."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from mtp_bench._bundle import baseline_names, card_ids
from mtp_bench.cards import changed_card, load_card
from mtp_bench.records import Record, load_record, record_paths
from mtp_bench.scoring import DEFINITIONS
from mtp_bench.submission.loader import load_submission
from tests.support.command_line import CommandLine


@pytest.fixture(scope="module")
def records(repository: Path) -> dict[Path, Record]:
    return {path: load_record(path) for path in record_paths(repository / "leaderboard" / "records")}


def test_records_fit_their_environments(records: dict[Path, Record]) -> None:
    for path, record in records.items():
        split = record.env.keywords.get("split")
        card = changed_card(load_card(record.env.id), split)
        assert path.parent.name == record.submission.name
        assert path.stem == record.env.id + (f"-{split}" if split else "")
        assert record.env.card_digest == card.digest
        assert record.scorer.definitions == DEFINITIONS
        assert record.status == ("partial" if split else "finished")
        assert record.env.scenes == record.env.scenes_of_split
        assert (record.missed.late, record.missed.malformed, record.missed.crashed_scenes) == (0, 0, 0)
        assert record.submission.digest == load_submission(record.submission.name).digest


def test_every_baseline_has_a_record_on_every_environment(records: dict[Path, Record]) -> None:
    found = {(record.submission.name, record.env.id) for record in records.values()}
    assert found == {(name, env_id) for name in baseline_names() for env_id in card_ids()}


def test_a_baseline_is_better_than_silence_wherever_false_forecasts_cost(records: dict[Path, Record]) -> None:
    for record in records.values():
        if record.submission.name == "mtp_selective" and record.env.truth_complete:
            error = record.row.missing_aware
            assert error is not None
            assert error < record.details["silence"], record.env.id


def test_the_page_is_made_of_the_records(repository: Path, tmp_path: Path, cli: CommandLine) -> None:
    """To mend it: mtp-bench board --records leaderboard/records -o leaderboard/index.html."""
    copy = tmp_path / "leaderboard"
    shutil.copytree(
        repository / "leaderboard" / "records", copy / "records", ignore=shutil.ignore_patterns("*.rollouts")
    )
    cli.ok("board", "--records", copy / "records", "-o", copy / "index.html")
    assert (copy / "index.html").read_bytes() == (repository / "leaderboard" / "index.html").read_bytes()
