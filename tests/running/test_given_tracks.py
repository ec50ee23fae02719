"""Stored tracks scored as an agent: what it is shown, how its row is marked."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from mtp_bench import DataError, MTPEnv
from mtp_bench.core.errors import MtpBenchError, RolloutError
from mtp_bench.judge import submit
from mtp_bench.running import stored
from mtp_bench.running.comparison import compare
from mtp_bench.running.options import RunOptions
from mtp_bench.running.stored import open_run
from mtp_bench.running.track_export import export_tracks
from tests.support.command_line import CommandLine, write_submission
from tests.support.small_scenes import CARD_ID

pytestmark = pytest.mark.usefixtures("remembered_weights")
NOT_CAUSAL = "not causal: stored tracks, which may have seen the future"


@pytest.fixture(scope="module")
def tracks(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> str:
    """STP's tracks of the small scenes, as KITTI results, whose ids begin at 2000."""
    folder = tmp_path_factory.mktemp("stp")
    stored.run("stp", card, folder / "run", RunOptions(kitti))
    export_tracks(open_run(folder / "run", kitti), folder / "tracks")
    for path in (folder / "tracks").glob("*.txt"):
        path.write_text(re.sub(r"(?m)^(\d+) (\d+)", lambda line: f"{line[1]} {2000 + int(line[2])}", path.read_text()))
    return str(folder / "tracks")


def test_stored_boxes_come_as_detections_with_ids(card: str, kitti: str, tracks: str) -> None:
    env = MTPEnv(card, kitti, observe="tracks", tracks=tracks)
    observation, _ = env.reset(options={"scene": "0001"})
    assert env.observation_space.contains(observation)
    valid = observation["detection_valid"] == 1
    assert (valid.sum(), len(set(observation["detection_id"][valid].tolist()))) == (3, 3)
    assert (observation["detection_id"][~valid] == -1).all()
    found = np.sort(observation["detection_score"][valid])
    np.testing.assert_allclose(found, [-2.0, 1.0, 3.0])  # of the detections that the tracks took


def test_stored_tracks_do_not_show_other_errors(card: str, kitti: str, tracks: str) -> None:
    """They would win at every level: their tracker saw the detections as recorded."""
    with pytest.raises(DataError, match="stored tracks are of the detections as recorded"):
        MTPEnv(card, kitti, observe="tracks", tracks=tracks, perturb={"noise": 2.0})


def test_a_stored_run(cli: CommandLine, card: str, kitti: str, known: list[str], tracks: str, tmp_path: Path) -> None:
    cli.ok("run", "given_tracks", *known, "--tracks", tracks, "-o", tmp_path / "run", "--jobs", 1)
    info = json.loads((tmp_path / "run/run.json").read_text())["info"]
    assert (info["observe"], info["keywords"]["tracks"]) == ("tracks", tracks)
    report = stored.score(tmp_path / "run", RunOptions(kitti)).report
    assert report.to_json()["rows"][0]["unranked_because"] == NOT_CAUSAL
    shown = open_run(tmp_path / "run", kitti).scene("0001").detections
    assert shown.counts[3] == 3  # coasted boxes, where nothing is detected
    events = json.loads(cli.ok("events", tmp_path / "run", "--data", kitti, "--json", "-"))
    stp = json.loads(cli.ok("events", Path(tracks).parent / "run", "--data", kitti, "--json", "-"))
    assert events["counts"] == stp["counts"]
    lost = next(event for event in events["events"] if event["kind"] == "lost")
    assert int(lost["old_id_in_file"]) >= 2000
    at = ("--scene", lost["scene"], "--at", lost["event"])
    told = cli.ok("view", tmp_path / "run", "--data", kitti, *at, "--png", tmp_path / "a.png")
    assert f"track {lost['old_id']} ({lost['old_id_in_file']} in its file)" in " ".join(told.split())


def test_tracks_without_scores_are_counted_for_the_user(
    cli: CommandLine, card: str, kitti: str, known: list[str], tracks: str, tmp_path: Path
) -> None:
    for path in Path(tracks).glob("*.txt"):
        lines = [" ".join(line.split()[:-1]) for line in path.read_text().splitlines()]
        (tmp_path / path.name).write_text("\n".join(lines))
    said = cli.ok("run", "given_tracks", *known, "--tracks", tmp_path, "-o", tmp_path / "run", "--jobs", 1)
    told = "36 rows of the data skipped or completed: track without a score, taken as 1"
    assert " ".join(said.split()).count(told) == 1
    options = RunOptions(kitti, tracks=str(tmp_path))
    assert compare(["stp", "given_tracks"], card, options).skipped == {"track without a score, taken as 1": 36}


def test_the_run_tells_where_its_tracks_were(card: str, kitti: str, tracks: str, tmp_path: Path) -> None:
    moved = Path(tracks).rename(tmp_path / "tracks")
    try:
        stored.run("given_tracks", card, tmp_path / "run", RunOptions(kitti, scenes=1, tracks=str(moved)))
    finally:
        moved.rename(tracks)
    assert stored.score(tmp_path / "run", RunOptions(kitti))  # what was said is enough for that
    with pytest.raises(MtpBenchError, match=r"no file or folder .*tracks, expected stored tracks"):
        open_run(tmp_path / "run", kitti).scene("0001")
    run = tmp_path / "run/run.json"
    content = json.loads(run.read_text())
    del content["info"]["keywords"]["tracks"]
    run.write_text(json.dumps(content))
    with pytest.raises(RolloutError, match="tracks is None, expected the path"):
        open_run(tmp_path / "run", kitti).scene("0001")


def test_the_command_exports_readable_tracks(
    cli: CommandLine, known: list[str], tracks: str, tmp_path: Path, kitti: str
) -> None:
    run = Path(tracks).parent / "run"
    said = cli.ok("export", run, "--data", kitti, "--form", "table", "-o", tmp_path / "tables")
    assert said == f"{tmp_path / 'tables'}: 36 tracked positions\n"
    text = (tmp_path / "tables/0001.csv").read_text().replace('"', "")
    assert text.startswith("frame,id,class,x,y,z,yaw,l,w,h,score\n0,0,car,")
    arguments = ("run", "given_tracks", *known, "--jobs", 1)
    cli.ok(*arguments, "--tracks", tmp_path / "tables", "-o", tmp_path / "by_table")
    cli.ok(*arguments, "--tracks", tracks, "-o", tmp_path / "by_result")
    by_table, by_result = (
        json.loads(cli.ok("score", tmp_path / name, "--data", kitti, "--json", "-"))["rows"][0]
        for name in ("by_table", "by_result")
    )
    assert by_table["error"] == pytest.approx(by_result["error"], abs=1e-4)
    again = cli("export", run, "--data", kitti, "--form", "table", "-o", tmp_path / "tables").error
    assert again == f"{tmp_path / 'tables'} is not empty: choose another folder"
    for more, what in (((), "KITTI's results"), (("--form", "table"), "tables")):
        said = cli("export", run, "--data", kitti, *more, "-o", tmp_path / "t.json").error
        assert said == f"{tmp_path / 't.json'}: {CARD_ID} is written as {what}: name a folder, not a .json file"
    assert not (tmp_path / "t.json").exists()


def test_stored_tracks_have_no_record(card: str, kitti: str, tracks: str, tmp_path: Path) -> None:
    options = RunOptions(kitti, seeds=(0,), tracks=tracks)
    for name, message in (("given_tracks", "it has no record"), ("stp", "which are not shown to stp")):
        with pytest.raises(MtpBenchError, match=message):
            submit(name, card, options, tmp_path)
    labels = write_submission(tmp_path / "echo", tables='[compare]\nobserve = "associated"\n')
    with pytest.raises(MtpBenchError, match=r"echo: observe = .* records of it are of baselines alone"):
        submit(labels, card, RunOptions(kitti, seeds=(0,)), tmp_path)
