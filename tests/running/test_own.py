"""Own scenes from a log to a score: in Python and on the command line, and from any working directory."""

from dataclasses import replace
from pathlib import Path

import pytest

import mtp_bench
from mtp_bench.cards import load_card, with_files, with_scenes
from mtp_bench.core import Scene
from mtp_bench.core.errors import DataError, MtpBenchError
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run
from tests.support.command_line import CommandLine
from tests.support.own_scenes import write_long_log

pytestmark = pytest.mark.usefixtures("few_event_runs")
ENV = "MTP-nuScenes-v0"


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    return write_long_log(tmp_path / "logs")


@pytest.fixture
def scene(logs: Path) -> Scene:
    (scene,) = mtp_bench.load_scenes(with_files(load_card(ENV), logs))
    return scene


def test_from_folder_to_score(cli: CommandLine, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cli.ok("run", "stp", "--env", ENV, "--files", "logs", "-o", "run", "--jobs", 1)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert cli.ok("score", tmp_path / "run").startswith("logs, own detections, 1 scene, 1 seed: m")
    assert "identity switches" in cli.ok("events", tmp_path / "run")
    video = tmp_path / "one.gif"
    cli.ok("video", tmp_path / "run", "-o", video)
    assert video.stat().st_size > 10_000
    write_long_log(logs, frames=29)
    assert "they are not those of MTP-nuScenes-v0, or changed" in cli("score", tmp_path / "run").error


def test_scenes_in_memory_play_run_compare_and_score(scene: Scene, logs: Path, tmp_path: Path) -> None:
    env = mtp_bench.MTPEnv(ENV, scenes=[scene, replace(scene, name="two")])
    assert env.scene_names == ("one", "two")
    env.reset(seed=0, options={"scene": "two"})
    assert env.scene.name == "two"
    card = with_scenes(load_card(ENV), [scene])
    mtp_bench.run("stp", card, tmp_path / "memory")
    mtp_bench.run("stp", with_files(load_card(ENV), logs), tmp_path / "files")
    first, second = (load_run(tmp_path / name) for name in ("memory", "files"))
    assert first.rollouts[0].forecast.tobytes() == second.rollouts[0].forecast.tobytes()
    assert first.info.card_digest != second.info.card_digest
    with pytest.raises(DataError, match="its scenes were objects in memory, which are not stored; give them again"):
        mtp_bench.score(tmp_path / "memory")
    scored = mtp_bench.score(tmp_path / "memory", card=card).report.rows[0]
    assert scored.error == mtp_bench.score(tmp_path / "files").report.rows[0].error
    compared = mtp_bench.compare(["mtp"], card, RunOptions(seeds=[0])).report.rows
    assert next(row for row in compared if row.agent == "stp").error == scored.error


def test_a_simulated_detector_on_own_truth(logs: Path, cli: CommandLine, tmp_path: Path) -> None:
    (logs / "one" / "detections.csv").unlink()
    error = cli("run", "stp", "--env", ENV, "--files", logs, "-o", tmp_path / "run", "--jobs", 1).error
    assert "without them a simulated detector runs at once: --detector nuscenes_megvii" in error
    given = ("--files", logs, "--detector", "nuscenes_megvii")
    cli.ok("run", "stp", "--env", ENV, *given, "-o", tmp_path / "run", "--jobs", 1)
    assert "nuscenes_megvii, simulated detections (1 scene)" in " ".join(cli.ok("score", tmp_path / "run").split())


def test_a_record_is_not_of_own_scenes(logs: Path) -> None:
    from mtp_bench.judge.records.running import plan_run

    with pytest.raises(MtpBenchError, match="a record uses the scenes of its env"):
        plan_run(mtp_bench.load_submission("stp"), ENV, RunOptions(files=str(logs)))
