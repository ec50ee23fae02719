"""The leaderboard as it is committed: records that hold together, and a page that was made of them."""

import itertools
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from docs.generate import driving, honesty
from docs.generate.results import PAGES, filled
from mtp_bench.cards import load_card
from mtp_bench.commands.board import read_board
from mtp_bench.core.notice import NO_PROGRESS
from mtp_bench.judge import Record, load_record, record_paths, trusted
from mtp_bench.judge.records.eligibility import why_not_comparable
from mtp_bench.judge.records.shipped import baseline_digest, earlier_cards
from mtp_bench.scoring import SUBSETS
from mtp_bench.scoring.definitions import SIGNIFICANT
from mtp_bench.viz.board.entries import Entry, by_board
from tests.support.command_line import CommandLine
from tests.support.programs import require_program

LEAST = 20  # records


@pytest.fixture(scope="module")
def records(repository: Path) -> dict[Path, Record]:
    """As they are read: whether they hold together is asked where the pages are made of them."""
    return {path: load_record(path) for path in record_paths(repository / "leaderboard" / "records")}


@pytest.fixture(scope="module")
def copy(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the leaderboard without what is made of its records."""
    folder = tmp_path_factory.mktemp("copy")
    made = shutil.ignore_patterns("index.*", "*.rollouts", "*.part")
    shutil.copytree(repository / "leaderboard", folder / "leaderboard", ignore=made)
    for linked in ("baselines", "docs"):  # by the page
        (folder / linked).symlink_to(repository / linked)
    return folder / "leaderboard"


@pytest.fixture(scope="module")
def read(copy: Path) -> Callable[..., tuple[list[Entry], list[str], list[str]]]:
    """`read_board` as the command calls it for the page, done once: to rank all records is most of its time."""
    require_program("ssh-keygen")  # without it no signed level is read
    call = copy / "records", (), None, copy / "index.html", trusted(None)
    result = read_board(*call, NO_PROGRESS)

    def again(*arguments: object) -> tuple[list[Entry], list[str], list[str]]:
        assert (arguments[:5], arguments[6]) == (call, SUBSETS)
        return result

    return again


@pytest.fixture(scope="module")
def entries(copy: Path, read: Callable[..., tuple[list[Entry], list[str], list[str]]]) -> list[Entry]:
    """Of all records."""
    return read(copy / "records", (), None, copy / "index.html", trusted(None), NO_PROGRESS, SUBSETS)[0]


def test_records_fit_their_environments(records: dict[Path, Record]) -> None:
    for path, record in records.items():
        assert (path.parent.name, path.stem, record.status) == (record.submission.name, record.env.id, "finished")
        assert (record.missed.malformed, record.missed.crashed_scenes) == (0, 0)
    assert len(records) >= LEAST
    for record in records.values():  # what ships today made them, but for cards that are listed with what has changed
        change = earlier_cards().get(record.env.card_digest)
        assert (record.env.card_digest == load_card(record.env.id).digest) == (change is None)
        assert record.submission.digest == baseline_digest(record.submission.name, record.submission.networks)
        assert why_not_comparable(record) == change


def test_no_place_contradicts_its_number_and_no_interval_its_test(entries: list[Entry]) -> None:
    placed = 0
    for board, subset in itertools.product(by_board(entries).values(), SUBSETS):
        places = [(each.standing.places[subset], each.row_of(subset).error or 0.0) for each in board]
        errors = np.array([error for place, error in places if place.place is not None])
        for place, error in places:
            if place.place is not None and place.span is not None:
                placed += 1
                assert place.place == 1 + int((errors < error * (1 - 1e-9)).sum())
                assert place.span[0] <= place.place <= place.span[1]
        for entry in board:
            difference = entry.standing.differences.get(subset)
            interval = difference and difference.interval
            apart = interval is not None and not interval[0] <= 0 <= interval[1]
            assert apart == (difference is not None and difference.p < SIGNIFICANT)
    assert placed > LEAST


def test_pages_are_made_of_records(
    repository: Path, copy: Path, cli: CommandLine, entries: list[Entry], read: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The board, and the tables of RESULTS.md and the README. To mend it: make pages."""
    monkeypatch.setattr(sys.modules[read_board.__module__], "read_board", read)
    cli.ok("board", "--records", copy / "records", "-o", copy / "index.html")
    assert _files(copy) == _files(repository / "leaderboard")
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert filled(text, entries, page.name) == text, page.name
    text, figures = (path.read_text(encoding="utf-8") for path in (driving.PAGE, driving.FIGURES))
    assert driving.filled(text, json.loads(figures)) == text
    stated = json.loads(honesty.FIGURES.read_text(encoding="utf-8"))
    assert honesty.filled(text, stated) == text
    assert honesty.curve(stated) == honesty.PICTURE.read_text(encoding="utf-8")


def _files(leaderboard: Path) -> dict[str, bytes]:
    paths = [leaderboard / "index.html", *sorted((leaderboard / "index.parts").rglob("*"))]
    return {path.relative_to(leaderboard).as_posix(): path.read_bytes() for path in paths if path.is_file()}
