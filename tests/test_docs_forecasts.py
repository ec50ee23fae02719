"""The page on stored forecasts says what the code does: its table is that of the code, its blocks and commands run."""

import shlex
from pathlib import Path

import pytest

from mtp_bench import MTPEnv, import_forecasts, load_scenes
from mtp_bench.running import RunOptions
from mtp_bench.sources.stored_forecasts import FORECASTS
from tests.support.command_line import CommandLine
from tests.test_bring_pages import names_of
from tests.test_readme import blocks

PAGE = "docs/data/stored_forecasts.md"


def commands_with(repository: Path, words: str) -> list[list[str]]:
    """The commands of the block in which ``words`` stand."""
    block = next(each for each in blocks(repository / PAGE, "sh") if words in each)
    return [shlex.split(line)[1:] for line in block.replace("\\\n", "").splitlines()]


def test_the_columns_are_those_of_the_code(repository: Path) -> None:
    lines = [f"| `{one.name}` | {one.meaning} | {one.without or 'an error'} |" for one in FORECASTS]
    assert "\n".join(lines) in (repository / PAGE).read_text(encoding="utf-8")


def test_the_lines_of_pandas_write_a_table_that_is_read(repository: Path, tmp_path: Path) -> None:
    env = "MTP-Intersection-v0"
    (scene,) = load_scenes(env, names=MTPEnv(env).scene_names[:1])
    forecasts = [
        (t, number, "car", x, y, 0.9 - number / 100, weight, [(x + step, y) for step in range(1, 13)])
        for t in range(scene.frames)
        for number, (x, y) in enumerate(scene.truth.box[scene.truth.rows(t), :2].tolist()[:3])
        for weight in (0.7, 0.3)
    ]
    names_of(repository / PAGE)["write_table"](tmp_path / f"{scene.name}.csv", forecasts)
    lines = import_forecasts(tmp_path, env, "table", None, RunOptions(scenes=1))
    assert any(line.startswith(f"{len(forecasts) // 2} objects in {scene.frames} frames") for line in lines)


@pytest.mark.data
def test_the_example_runs_from_file_to_picture(
    repository: Path, data_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MTP_BENCH_DATA", str(data_root))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "weights"))
    (train, *written) = commands_with(repository, "mtp-bench train predictor modes")
    outputs = [cli(*train, "--epochs", 1, "--scenes", 1)]
    read = commands_with(repository, "mtp-bench import forecasts stp_modes.json")
    assert len(read) == 5
    outputs += [cli(*command) for command in [*written, *read]]
    assert [output.status for output in outputs] == [0] * 8, [output.err for output in outputs]
    assert "UniAD EPA, car, from 0.3" in outputs[4].out
    assert "identity switches" in outputs[5].out
    assert "All targets of 2 scenes" in outputs[6].out
    assert (tmp_path / "fault.png").stat().st_size > 10_000
