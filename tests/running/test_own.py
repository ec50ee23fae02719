"""Own scenes from a log to a score: in Python and on the command line, and from any working directory."""

from __future__ import annotations

import ast
import re
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import mtp_bench
from mtp_bench.cards import load_card, with_files, with_scenes
from mtp_bench.errors import CardError, DataError, MtpBenchError
from mtp_bench.running.options import RunOptions
from mtp_bench.running.rollout_files import load_run
from mtp_bench.types import Scene
from tests.support.command_line import CommandLine
from tests.support.own_scenes import write_long_log
from tests.test_readme import blocks

ENV = "MTP-nuScenes-v0"


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    return write_long_log(tmp_path / "logs")


@pytest.fixture
def scene(logs: Path) -> Scene:
    (scene,) = mtp_bench.load_scenes(with_files(load_card(ENV), logs))
    return scene


def test_the_example_is_short_and_shows_something(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = repository / "examples" / "own_csv.py"
    _, *statements = ast.parse(path.read_text(encoding="utf-8")).body  # without the docstring
    assert sum((one.end_lineno or 0) - one.lineno + 1 for one in statements) <= 15
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path))
    assert re.search(r"error \d+\.\d\d m", capsys.readouterr().out)
    with Image.open(tmp_path / "failure.png") as picture:
        pixels, sentence = np.asarray(picture), picture.info["Description"]
    assert "lost-0: at 6.5 s car 0 loses track" in str(sentence)
    (block,) = blocks(repository / "docs" / "visualization" / "why.md", "python")  # the same from Python
    page: dict[str, Any] = {}
    exec(compile(block, "why.md", "exec"), page)
    assert page["picture_of"]("runs/two_cars", "one", "lost-0", "same.png") == sentence
    assert (tmp_path / "same.png").read_bytes() == (tmp_path / "failure.png").read_bytes()
    view = pixels[:, : pixels.shape[1] * 3 // 4].reshape(-1, 3)
    assert len(np.unique(view, axis=0)) > 20
    assert (view != view[0]).any(axis=1).mean() > 0.01


def test_from_a_folder_to_a_score_in_any_working_directory(
    cli: CommandLine, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cli.ok("run", "stp", "--env", ENV, "--files", "logs", "-o", "run", "--jobs", 1)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert "2 objects in 1 scene" in cli.ok("score", tmp_path / "run")
    assert "identity switches" in cli.ok("events", tmp_path / "run")
    video = tmp_path / "one.gif"
    cli.ok("video", tmp_path / "run", "-o", video)
    assert video.stat().st_size > 10_000
    compared = cli.ok("compare", "mtp", "--env", ENV, "--files", logs, "--seeds", 1, "--jobs", 1)
    assert "mtp" in compared
    write_long_log(logs, frames=29)
    assert "they are not those of MTP-nuScenes-v0, or were changed" in cli("score", tmp_path / "run").error


def test_a_card_file_in_any_working_directory(
    cli: CommandLine, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = mtp_bench.cards.card_text(with_files(load_card(ENV), logs))
    (tmp_path / "mine.toml").write_text(text.replace(ENV, "mine").replace(str(logs), "logs"))
    monkeypatch.chdir(tmp_path)
    cli.ok("run", "stp", "--env", "mine.toml", "-o", "run", "--jobs", 1)
    assert "complete" in cli.ok("data", "--env", "mine.toml")
    (tmp_path / "mine.toml").unlink()
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    assert "mine" in cli.ok("score", "../run")


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
    scored = mtp_bench.score(tmp_path / "memory", env_id=card).report.rows[0]
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


def test_wrong_scenes_of_an_env(scene: Scene, logs: Path) -> None:
    with pytest.raises(MtpBenchError, match=r"scenes is the scene 'one', expected a list: scenes=\[scene\]"):
        mtp_bench.MTPEnv(ENV, scenes=scene)  # type: ignore[arg-type]
    with pytest.raises(CardError, match="scenes holds str, expected Scene objects only, or names only"):
        mtp_bench.MTPEnv(ENV, scenes=[scene, "two"])  # type: ignore[arg-type]
    with pytest.raises(
        MtpBenchError, match="scenes holds Scene objects and files names a folder, expected one of them"
    ):
        mtp_bench.MTPEnv(ENV, scenes=[scene], files=str(logs))
    with pytest.raises(MtpBenchError, match="files is 3, expected a text"):
        mtp_bench.MTPEnv(ENV, files=3)  # type: ignore[arg-type]


def test_a_record_is_not_of_own_scenes(logs: Path) -> None:
    from mtp_bench.records.running import plan_run

    with pytest.raises(MtpBenchError, match="a record is of the scenes that its env names: no files can take their"):
        plan_run(mtp_bench.load_submission("stp"), ENV, RunOptions(files=str(logs)))


def test_own_scenes_stand_beside_no_figures_of_the_paper(logs: Path, cli: CommandLine, tmp_path: Path) -> None:
    cli.ok("run", "stp", "--env", ENV, "--files", logs, "-o", tmp_path / "run", "--jobs", 1)
    shown = cli.ok("score", tmp_path / "run")
    assert "MTP-nuScenes-v0, changed: m, less is better" in shown
    assert "the paper's" not in shown
    assert "8.345" not in shown
