"""The leaderboard as it is committed: records that hold together, and a page that was made of them."""

import itertools
import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from docs.generate import driving
from docs.generate.results import PAGES, filled
from mtp_bench.cards import load_card
from mtp_bench.commands.board import read_board
from mtp_bench.core.parallel import NO_PROGRESS
from mtp_bench.judge import Record, load_record, record_paths, trusted
from mtp_bench.judge.records.eligibility import why_not_comparable
from mtp_bench.judge.records.shipped import baseline_digest
from mtp_bench.scoring import SUBSETS
from mtp_bench.scoring.definitions import SIGNIFICANT, Subset
from mtp_bench.scoring.statistics import PairedDifference
from mtp_bench.viz.board.entries import Entry, by_board
from tests.support.command_line import CommandLine
from tests.support.programs import require_program

LEAST = 20  # records
ROADS = ("Intersection", "Roundabout", "Merge")
INTERVAL = re.compile(r"\[([-+]?[\d.]+), ([-+]?[\d.]+)\]")


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
    for record in records.values():  # what ships today made them
        assert record.env.card_digest == load_card(record.env.id).digest
        assert record.submission.digest == baseline_digest(record.submission.name, record.submission.networks)
        assert why_not_comparable(record) is None


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
            difference = entry.difference(subset)
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


def test_intervals_in_sentences_on_driving_stand_in_its_tables() -> None:
    """Rounded, and with either sign: a sentence may turn a difference round."""
    lines = driving.PAGE.read_text(encoding="utf-8").replace("−", "-").splitlines()
    found = [[INTERVAL.findall(line) for line in lines if line.startswith("|") == table] for table in (True, False)]
    tables, sentences = (list(itertools.chain(*each)) for each in found)
    cells = np.array(tables, dtype=float)
    cells = np.concatenate([cells, -cells[:, ::-1]])
    assert sentences
    for ends in sentences:
        off = np.abs(cells - np.array(ends, dtype=float)).max(axis=1).min()
        assert off <= 0.5 / 10 ** len(ends[0].partition(".")[2]) + 1e-9, ends


def _files(leaderboard: Path) -> dict[str, bytes]:
    paths = [leaderboard / "index.html", *sorted((leaderboard / "index.parts").rglob("*"))]
    return {path.relative_to(leaderboard).as_posix(): path.read_bytes() for path in paths if path.is_file()}


def test_counts_in_texts_are_those_of_the_records(entries: list[Entry], repository: Path) -> None:
    listed = {entry.name: entry for entry in entries if entry.env == "MTP-nuScenes-v0"}
    ranked = [entry for entry in listed.values() if entry.place is not None]
    text = (repository / "README.md").read_text()
    assert f"\nTen of {len(listed)} rows of `MTP-nuScenes-v0`: vehicles of {listed['stp'].record.env.scenes} " in text
    assert f"; place among {len(ranked)}, " in text
    assert f" is better still: {listed['gt_tracks_modes'].row_of('ids').error:.2f} m.\n" in text
    figures = json.loads((repository / "leaderboard" / "driving.json").read_text())
    taus = [
        f"{figures[f'MTP-Drive-{road}-v0']['tau']['without references']['measures']['bADE']['tau']:.2f} at the {where}"
        for road, where in (("Intersection", "intersection"), ("Roundabout", "roundabout"), ("Merge", "merge"))
    ]
    said = " ".join((repository / "leaderboard" / "RESULTS.md").read_text().split())
    assert f" it is {taus[0]}, {taus[1]} and {taus[2]}." in said


def test_costs_and_gains_in_the_readme_are_differences_of_records(entries: list[Entry], repository: Path) -> None:
    listed = {entry.name: entry for entry in entries if entry.env == "MTP-nuScenes-v0"}
    text = " ".join((repository / "README.md").read_text().split())
    weights = " ".join((repository / "envs" / "reference" / "README.md").read_text().split())

    def gain(one: str, other: str, subset: Subset) -> PairedDifference:
        difference = listed[one].minus(listed[other], subset)
        assert difference is not None
        return difference

    cost = gain("stp_same_samples", "perfect_association_same_samples", "ids")
    assert cost.interval is not None
    cost_text = "{:.2f} m [{:.2f}, {:.2f}]".format(cost.mean, *cost.interval)
    everywhere = gain("stp_same_samples", "perfect_association_same_samples", "all")
    assert f"gains {cost_text} on identity switches" in text
    assert f", and {everywhere.mean:.2f} m over all targets, where missed" in text
    assert f"With Megvii's detections it is {cost_text} on the validation scenes" in weights
    won = gain("stp_same_samples", "mtp", "ids")
    assert won.interval is not None
    assert "`mtp` gains {:.2f} m [{:.2f}, {:.2f}] on `stp_same_samples`".format(won.mean, *won.interval) in text
    assert not gain("stp_same_samples", "mtp", "all").significant, "over all targets nothing significant"


def test_records_of_closed_loops_as_the_page_on_driving_has_them(entries: list[Entry]) -> None:
    figures = json.loads(driving.FIGURES.read_text())
    page, envs = " ".join(driving.PAGE.read_text().split()), [f"MTP-Drive-{road}-v0" for road in ROADS]
    scores = {(each.env, each.name): each.record.driving.drive_score for each in entries if each.record.driving}
    learned = ["affinity", "mtp_modes_tracklets", "stp_modes_tracklets", "tracking_free"]
    gaps = {(env, name): score - figures[env]["rows"][name]["drive_score"] for (env, name), score in scores.items()}
    apart = max(map(abs, gaps.values()))
    assert len(scores) == 12 * len(envs)
    assert " records of 12 agents at each of the three," in page
    assert f" differ by at most {apart:.3f} from those here," in page
    names = ", ".join(f"`{name}`" for name in learned[:-1])
    assert f" roundabout are those with learned weights: {names} and `{learned[-1]}`." in page
    control = {"stp_same_samples", "mtp"}
    merge = {*learned, *control}, {*learned, *control} - {"tracking_free"}
    expected = ({*learned}, {*learned, *control}), ({*learned}, {*learned}), merge
    for env, (first, better) in zip(envs, expected, strict=True):
        ranked = {entry.name: entry for entry in entries if entry.env == env and entry.place is not None}
        assert {name for name, entry in ranked.items() if (entry.place or 9) <= len(first)} == first, env
        spans = {name: entry.standing.places["all"].span for name, entry in ranked.items()}
        assert "Merge" not in env or all(span and span[0] == 1 for name, span in spans.items() if name in first)
        found = {name: entry.standing.differences.get("all") for name, entry in ranked.items()}
        assert {name for name, each in found.items() if each and each.significant and each.mean < 0} == better, env


def test_findings_that_stand_in_no_table(entries: list[Entry], repository: Path) -> None:
    """The others are in `test_findings.py`."""
    said = " ".join((repository / "leaderboard" / "RESULTS.md").read_text().split())
    by_env = {env: {entry.name: entry for entry in board} for env, board in by_board(entries).items()}

    def apart(env: str, one: str, other: str) -> bool:
        first, second = (by_env[env][name].standing.places["all"].span for name in (one, other))
        assert first is not None
        assert second is not None
        return first[1] < second[0]

    few = ("MTP-KITTI-v0", "MTP-KITTI-noego-v0", "MTP-KITTI-5Hz-v0", "MTP-Highway-v0", "MTP-Merge-v0")
    objects = [by_env[env]["stp"].row_of("ids").effective_objects for env in few]
    assert f"KITTI, Highway and Merge have only {min(objects):.0f} to {max(objects):.0f} effective objects" in said
    left = by_env["MTP-Roundabout-v0"]["stp"].row_of("ids").effective_objects
    assert f"nothing significant on switches ({left:.0f} effective objects)." in said
    assert "Not shown: Highway, Merge and KITTI-5Hz, where it costs at most 0.01 m over all targets" in said
    for env in few[2:]:
        one, other = (
            by_env[env][f"{name}_same_samples"].row_of("all").error for name in ("stp", "perfect_association")
        )
        assert one is not None
        assert other is not None
        assert 0 <= one - other < 0.01
    assert "`tracking_free` is significantly better than it at both, without lanes; `mtp_modes_tracklets`" in said
    lanes = {
        (env, name): apart(env, name, "mtp_modes_lanes")
        for env in ("MTP-Intersection-Lanes-v0", "MTP-Roundabout-Lanes-v0")
        for name in ("tracking_free", "mtp_modes_tracklets")
    }
    assert list(lanes.values()) == [True, True, True, False]
