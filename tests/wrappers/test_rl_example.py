"""The example of reinforcement learning trains and says what came of it, and the blocks of its page run."""

import re
import runpy
from pathlib import Path
from typing import Any

import pytest

from docs.generate import learning
from tests.test_readme import blocks


def test_blocks_of_its_page_run(repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: pip install '.[rl]'")
    names: dict[str, Any] = {}
    for block in blocks(repository / "docs/environment/reinforcement.md", "python"):
        exec(compile(block, "reinforcement.md", "exec"), names)
    assert re.search(r"^-\d+\.\d m per frame$", capsys.readouterr().out, flags=re.MULTILINE)


def test_the_curves_are_drawn_from_their_numbers() -> None:
    assert learning.FILE.read_text() == learning.curves(), "run python -m docs.generate.learning"


@pytest.mark.parametrize("method", ["PPO", "DQN"])
def test_the_example_trains_and_compares(method: str, repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: pip install '.[rl]'")
    example = runpy.run_path(str(repository / "examples/rl_association.py"))
    namespace = example["main"].__globals__
    namespace["HELD_OUT"], namespace["TRAINING"], namespace["EVERY"] = slice(5, 6), slice(2), 256
    namespace["METHODS"]["PPO"] |= {"n_steps": 128, "batch_size": 64}
    namespace["METHODS"]["DQN"] |= {"learning_starts": 100}
    before, after = example["main"](256, 0, method)
    assert before != after, "it learned something"
    assert f"{method},    256 steps: {after:+7.2f} m per frame against nearest" in capsys.readouterr().out
