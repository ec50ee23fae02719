"""`mtp-bench new`: a submission to start from that loads, keeps the contract and is no worse than nothing."""

import ast
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench import load_submission
from mtp_bench.agent.submission_files import FILES, TEMPLATE, new_submission
from tests.support.command_line import CommandLine
from tests.support.runs import run_scenes
from tests.support.tracking_scenes import frame, kitti_task, observation


def test_the_command_writes_a_submission_and_says_what_to_do_next(tmp_path: Path, cli: CommandLine) -> None:
    out = cli.ok("new", "mine", "--folder", tmp_path)
    folder = tmp_path / "mine"
    assert sorted(path.name for path in folder.iterdir()) == sorted(name.removesuffix(".txt") for name in FILES)
    for line in (f"mtp-bench check {folder}", f"mtp-bench compare {folder} --env", f"mtp-bench submit {folder} --env"):
        assert line in out
    submission = load_submission(folder)
    assert (submission.name, submission.authors) == ("mine", ("A. Author",))
    assert submission.parameters == {"gate": 3.0, "patience": 1.0}


def test_the_test_in_its_readme_passes(tmp_path: Path) -> None:
    folder = new_submission("mine", tmp_path)
    code = (folder / "README.md").read_text().split("```python\n")[1].split("```")[0]
    names: dict[str, Any] = {"__file__": str(folder / "test_agent.py")}
    exec(code, names)
    names["test_the_agent_keeps_the_contract"]()


def test_a_folder_that_exists_is_left_alone(tmp_path: Path, cli: CommandLine) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "agent.py").write_text("precious")
    assert "mine exists already, expected a new folder" in cli("new", "mine", "--folder", tmp_path).error
    assert (tmp_path / "mine" / "agent.py").read_text() == "precious"


def test_the_template_uses_public_names_only() -> None:
    tree = ast.parse((TEMPLATE / "agent.py.txt").read_text())
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    (own,) = [node for node in imports if (node.module or "").startswith("mtp_bench")]
    assert own.module == "mtp_bench"
    assert not [alias.name for alias in own.names if alias.name.startswith("_")]


def test_the_agent_follows_and_forecasts(card: str, kitti: str, tmp_path: Path) -> None:
    submission = load_submission(new_submission("mine", tmp_path))
    (rollout,) = run_scenes(submission.build, card, {"data": kitti}, ["0006"])
    assert rollout.invalid.sum() == 0
    for t in range(7):  # one id per object, through two frames without detections
        assert rollout.track_id[rollout.tracks.rows(t)].tolist() == [0, 1, 2]
    before, now = (rollout.track_box[rollout.tracks.rows(t)][:, :2] for t in (5, 6))
    straight = rollout.forecast[rollout.objects.rows(6)][:, 0] / 100.0  # the first sample
    np.testing.assert_allclose(straight[:, 0], now - before, atol=0.06)
    np.testing.assert_allclose(straight[:, 2], 3 * straight[:, 0], atol=0.03)
    assert rollout.object_class[rollout.objects.rows(6)].tolist() == [0, 0, 1]


def test_a_car_that_is_not_seen_for_a_while_keeps_its_speed(tmp_path: Path) -> None:
    """1 m per frame, seen in frame 0 and next in frame 3."""
    task = kitti_task()
    agent = load_submission(new_submission("mine", tmp_path)).build(task)
    agent.reset(task)
    for detections in (frame((10.0, 0.0, 0)), frame(), frame(), frame((12.5, 0.0, 0))):
        action = agent.act({**observation(detections), "dt": np.array(task.dt)})
    np.testing.assert_allclose(action["forecast"][0, 0, 0], [2.5 / 3, 0], atol=1e-6)
