"""The example of reinforcement learning trains and says what came of it, and the blocks of its page run."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed: pip install '.[rl]'")


def test_the_example_trains_and_compares(repository: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(repository / "examples/rl_association.py"))
    namespace = example["main"].__globals__
    namespace["HELD_OUT"], namespace["SEARCH"], namespace["TRAINING"] = slice(5, 6), slice(1), slice(2)
    namespace["AT_RANDOM"] = 4
    rewards = example["main"](100)
    assert list(rewards) == ["untrained", "PPO", "best constant", "nearest neighbour"]
    assert rewards["nearest neighbour"] > rewards["best constant"]
    assert rewards["PPO"] != rewards["untrained"], "it learned something"
    printed = capsys.readouterr().out
    beaten = "beaten" if rewards["PPO"] > rewards["best constant"] else "not beaten"
    assert f"after 100 steps the best constant policy is {beaten} by PPO" in printed


def test_the_blocks_of_docs_environment_reinforcement_md_run(
    repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (repository / "docs/environment/reinforcement.md").read_text()
    found = re.findall(r"^```python\n(.*?)^```$", page, flags=re.MULTILINE | re.DOTALL)
    assert len(found) == 2
    for block in found:
        exec(compile(block, "reinforcement.md", "exec"), {})
    printed = capsys.readouterr().out
    assert re.search(r"^-\d+\.\d m per step$", printed, flags=re.MULTILINE)
