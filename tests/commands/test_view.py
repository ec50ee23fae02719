"""`mtp-bench view`: what it writes, what it refuses, and that windows and pages open on the event."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from rerun.experimental import ViewerClient

from mtp_bench.cards import load_card
from mtp_bench.commands.view import _replays
from mtp_bench.running import stored
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run, save_run
from mtp_bench.viz.framing import AROUND_SECONDS
from tests.support.command_line import CommandLine, write_submission
from tests.support.headless_viewer import until, windows_without_a_screen
from tests.support.recordings import read


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, card: str, kitti: str) -> Path:
    folder = tmp_path_factory.mktemp("stored")
    stored.run(str(write_submission(folder / "echo")), card, folder / "run", RunOptions(kitti))
    return folder / "run"


def test_a_recording_is_written(cli: CommandLine, folder: Path, tmp_path: Path, kitti: str) -> None:
    file = tmp_path / "a.rrd"
    out = cli.ok("view", folder, "--data", kitti, "--save", file)
    assert "scene 0001; open it with `rerun" in " ".join(out.split())
    assert {"world/gt", "world/det", "world/forecast", "world/hyp/00/box"} <= set(read(file))
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]  # nothing half written beside it
    shutil.copytree(folder, tmp_path / "copy")
    out = cli.ok("view", folder, tmp_path / "copy", "--data", kitti, "--scene", "0006", "--save", file)
    assert "scene 0006" in out
    entities = set(read(file))
    assert "world/hyp/00/box" in entities
    assert any(name.startswith("agents/2-") and name.endswith("/world/hyp/00/box") for name in entities)


def test_runs_of_other_cards(cli: CommandLine, folder: Path, card: str, kitti: str, tmp_path: Path) -> None:
    run = load_run(folder)
    save_run(tmp_path / "other", run.info.model_copy(update={"card_digest": "0" * 16}), run.rollouts)
    error = cli("view", folder, tmp_path / "other", "--data", kitti, "--save", tmp_path / "a.rrd").error
    assert all(each in error for each in (load_card(card).digest, "0" * 16))


def test_each_run_shows_its_input(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    for agent in ("gt_tracks", "stp"):
        stored.run(agent, card, tmp_path / agent, RunOptions(kitti))
    shown = [_replays(stored.open_runs([tmp_path / name for name in order], kitti), None, False, True)
             for order in (("gt_tracks", "stp"), ("stp",))]  # fmt: skip
    together, alone = shown[0][1], shown[1][0]
    np.testing.assert_array_equal(together.scene.detections.box, alone.scene.detections.box)


@pytest.mark.needs("Vulkan driver")
def test_a_window_plays(cli: CommandLine, folder: Path, monkeypatch: pytest.MonkeyPatch, kitti: str) -> None:
    with windows_without_a_screen(monkeypatch) as address:
        cli.ok("view", folder, "--data", kitti, "--at", "lost-0")
        viewer = ViewerClient.connect(address)

        def opened() -> float:
            viewer.take_screenshot()
            recordings = viewer.get_state().recordings
            times = [each.current_time for each in recordings if each.current_timeline == "event"]
            if times == [] or times[0] is None:
                raise RuntimeError(f"{recordings}, expected one at the timeline of the event")
            return times[0] / 1e9

        times = [until(opened), until(opened)]
        assert times[1] != times[0], "it plays"
        assert all(0.0 <= time <= 0.3 + AROUND_SECONDS for time in times)
        views = {view.name: view.reports for view in viewer.get_state().views}
        assert "lost-0 at 0.3 s" in views
        assert not any(views.values()), "every view is drawn without a report"
