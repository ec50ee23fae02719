"""Clips of the costliest events: of simulated scenes alone, small, and of what costs most."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from mtp_bench.errors import MtpBenchError, RecordError
from mtp_bench.running.stored import open_run
from mtp_bench.viz.board import Found, board_files, entries_of
from mtp_bench.viz.board.clips import MOST_BYTES, SIZE, can_have_clip, draw_clip, worst_event, write_clip
from mtp_bench.viz.replay import Replay, replay
from tests.support.board_records import MAIN, made_up
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
    paths = [tmp_path / "a.webp", tmp_path / "b.webp"]
    for path in paths:
        draw_clip(path, *worst)
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert paths[0].stat().st_size <= MOST_BYTES
    with Image.open(paths[0]) as image:
        assert image.size == SIZE
        assert image.n_frames > 1  # type: ignore[attr-defined]


def test_no_clip_is_ever_made_or_shown_of_recorded_scenes(tmp_path: Path) -> None:
    record = made_up("a")
    path = tmp_path / "records" / "a" / f"{MAIN}.json"
    (path.with_suffix(".rollouts") / "seed-0").mkdir(parents=True)
    assert not can_have_clip(path, record)
    with pytest.raises(RecordError, match="no picture of them may be published"):
        write_clip(tmp_path / "clip.webp", path, record)
    parts = board_files(entries_of([Found(record, clip="r/a.webp")])).parts
    assert ".webp" not in parts[f"{MAIN}.js"]


def test_a_simulated_entry_shows_its_clip() -> None:
    found = [Found(made_up(name, env_id=SIMULATED), clip=clip) for name, clip in (("a", "r/a.webp"), ("b", None))]
    script = board_files(entries_of(found)).parts[f"{SIMULATED}.js"]
    assert script.count('src=\\"./r/a.webp\\"') == script.count("img src") == 1


def test_a_clip_needs_the_rollouts_of_its_record(tmp_path: Path) -> None:
    record = made_up("a", 0.1, env_id=SIMULATED)
    path = tmp_path / "records" / "a" / f"{SIMULATED}.json"
    assert not can_have_clip(path, record)
    (path.with_suffix(".rollouts") / "seed-0").mkdir(parents=True)
    assert can_have_clip(path, record)
    with pytest.raises(MtpBenchError, match="seed-0"):  # there is no run in the folder
        write_clip(tmp_path / "clip.webp", path, record)
