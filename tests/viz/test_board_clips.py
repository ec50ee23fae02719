"""Clips of the costliest events: of simulated scenes alone, small, and of what costs most."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from mtp_bench.errors import RecordError
from mtp_bench.records import load_record, save_record
from mtp_bench.running.opened import open_run
from mtp_bench.viz.board import Found, board_files, entries_of
from mtp_bench.viz.board.clips import MOST_BYTES, SIZE, can_have_clip, clip_path, draw_clip, worst_event, write_clip
from mtp_bench.viz.replay import Replay, replay
from tests.support.board_records import MAIN, made_up
from tests.support.command_line import CommandLine
from tests.support.stored_records import SIMULATED

SWITCHED = "0001"  # the scene in which track 8 takes over from track 7


@pytest.fixture(scope="module")
def replays(card: str, kitti: str, events_run: Path) -> list[Replay]:
    opened = open_run(events_run, kitti, card)
    return [replay(opened.scene(said.scene), said, opened.card, "drawn") for said in opened.rollouts()]


def test_the_costliest_identity_event_is_found(replays: list[Replay]) -> None:
    worst = worst_event(replays)
    assert worst is not None
    played, incident = worst
    assert played.scene.name == SWITCHED
    costs = [each.error for each in played.incidents if each.kind != "spurious" and each.error is not None]
    assert incident.error == max(costs)
    assert worst_event([each for each in replays if each.scene.name != SWITCHED]) is None


def test_a_clip_is_small_moves_and_is_the_same_again(replays: list[Replay], tmp_path: Path) -> None:
    worst = worst_event(replays)
    assert worst is not None
    paths = [tmp_path / "a.clip.webp", tmp_path / "b.clip.webp"]
    for path in paths:
        draw_clip(path, *worst)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size <= MOST_BYTES
    with Image.open(paths[0]) as image:
        assert image.size == SIZE
        assert image.n_frames > 1  # type: ignore[attr-defined]


def test_no_clip_is_ever_made_or_shown_of_recorded_scenes(tmp_path: Path, cli: CommandLine) -> None:
    record = made_up("a")
    path = tmp_path / "records" / "a" / f"{MAIN}.json"
    save_record(record, path)
    (path.with_suffix(".rollouts") / "seed-0").mkdir(parents=True)
    assert not can_have_clip(path, record)
    with pytest.raises(RecordError, match="no picture of them may be published"):
        write_clip(path, record)
    assert "clip" not in cli.ok("board", "--records", path.parents[1], "--clips")
    clip = clip_path(path, load_record(path))
    assert not clip.exists()
    clip.touch()
    page = tmp_path / "x.html"
    cli.ok("board", "--records", path.parents[1], "-o", page)
    assert ".webp" not in (tmp_path / "x.parts" / "entries" / MAIN / "a.js").read_text()


def test_a_simulated_entry_shows_the_clip_beside_its_record() -> None:
    found = [Found(made_up(name, env_id=SIMULATED), clip=clip) for name, clip in (("a", "r/a.clip.webp"), ("b", None))]
    parts = board_files(entries_of(found)).parts
    assert 'src=\\"./r/a.clip.webp\\"' in parts[f"entries/{SIMULATED}/a.js"]
    assert "<img" not in parts[f"entries/{SIMULATED}/b.js"].replace("\\u003c", "<")


def test_rollouts_are_needed_and_those_of_the_record(tmp_path: Path, cli: CommandLine) -> None:
    record = made_up("a", 0.1, env_id=SIMULATED)
    path = tmp_path / "records" / "a" / f"{SIMULATED}.json"
    save_record(record, path)
    assert not can_have_clip(path, record)
    (path.with_suffix(".rollouts") / "seed-0").mkdir(parents=True)
    assert can_have_clip(path, record)
    no_run = "no clip: " + str(path.with_suffix(".rollouts"))  # there is no run in the folder
    assert no_run in cli.ok("board", "--records", path.parents[1], "--clips").replace("\n", "")
    clip_path(path, load_record(path)).touch()  # of this record: kept
    assert "no clip: " not in cli.ok("board", "--records", path.parents[1], "--clips")
    page = tmp_path / "x.html"
    entry = tmp_path / "x.parts" / "entries" / SIMULATED / "a.js"
    cli.ok("board", "--records", path.parents[1], "-o", page)
    assert ".webp" in entry.read_text()
    save_record(made_up("a", 0.2, env_id=SIMULATED), path)  # another record: its clip is another one
    cli.ok("board", "--records", path.parents[1], "-o", page)
    assert ".webp" not in entry.read_text()
    assert no_run in cli.ok("board", "--records", path.parents[1], "--clips").replace("\n", "")
