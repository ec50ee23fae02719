"""The examples of CONTRIBUTING.md, followed in a copy of the repository."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

FILE = re.compile(r"^```(?:python|toml)\n# (\S+/\S+)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
DIFF = re.compile(r"^```diff\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)


def apply(diff: str, root: Path) -> set[str]:
    """Insert the added lines of a diff after its context line, which must occur once; returns the changed files."""
    changed = set()
    for part in diff.split("--- a/")[1:]:
        name = part.split("\n", 1)[0]
        context, *lines = part.split("@@\n", 1)[1].rstrip("\n").split("\n")
        assert all(line.startswith("+") for line in lines)
        text = (root / name).read_text()
        line = f"{context[1:]}\n"
        assert text.count(line) == 1, f"{name} has not once the line {line!r}"
        (root / name).write_text(text.replace(line, line + "".join(f"{line[1:]}\n" for line in lines)))
        changed.add(name)
    return changed


@pytest.fixture(scope="module")
def followed(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, set[str], set[str]]:
    """A copy of the repository after all examples: its folder, the new files, the changed files."""
    root = tmp_path_factory.mktemp("contributing")
    ignored = shutil.ignore_patterns("__pycache__", "records", "index.*", "seals", "weights.xz")
    for folder in ("mtp_bench", "envs", "baselines"):
        shutil.copytree(repository / folder, root / folder, ignore=ignored if folder != "mtp_bench" else None)
    shutil.copy(repository / "pyproject.toml", root)
    page = (repository / "CONTRIBUTING.md").read_text()
    files = dict(FILE.findall(page))
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        assert not (root / name).exists()
        (root / name).write_text(text)
    changed = {name for diff in DIFF.findall(page) for name in apply(diff, root)}
    write_walks(root / "data" / "walks" / "scenes")
    return root, set(files), changed


def write_walks(folder: Path) -> None:
    """Two scenes of four people who walk on straight lines for 12 s."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for scene in range(2):
        start, speed = rng.uniform(-8, 8, (4, 2)), rng.uniform(-0.4, 0.4, (4, 2))
        rows = [(t, i, *(start[i] + t * speed[i])) for t in range(25) for i in range(4)]
        (folder / f"walk{scene}.csv").write_text("".join(f"{t},{i},{x:.3f},{y:.3f}\n" for t, i, x, y in rows))


def test_names_of_the_tables_are_in_their_files(repository: Path) -> None:
    page = (repository / "CONTRIBUTING.md").read_text()
    rows = re.findall(r"^\| `([A-Za-z_.]+)(?:\(\.\.\.\))?` \| `(\S+\.py)` \|", page, flags=re.MULTILINE)
    assert len(rows) > 12
    for name, file in rows:
        text = (repository / "mtp_bench" / file).read_text()
        for part in name.split("."):
            assert re.search(rf"\b(class|def) {part}\b|^    {part}: ", text, re.MULTILINE), (name, file)


def test_each_addition_touches_few_files(followed: tuple[Path, set[str], set[str]]) -> None:
    _, new, changed = followed
    sampler = {name for name in new if "strided" in name}
    dataset = {name for name in new if "walks" in name.lower()}
    assert (len(sampler), len(dataset), new - sampler - dataset) == (3, 4, set())
    assert changed == {"mtp_bench/scoring/rows.py", "mtp_bench/scoring/report.py", "mtp_bench/cards/source.py"}


def test_the_additions_work_together(followed: tuple[Path, set[str], set[str]]) -> None:
    """The new baseline runs on the new environment, and the new metric is in the report."""
    root, _, _ = followed
    code = """
import json

import mtp_bench
from mtp_bench.running.options import RunOptions
options = RunOptions("data")
mtp_bench.run("mtp_strided", "MTP-Walks-v0", "run", options)
print(json.dumps(mtp_bench.score("run", options).report.to_json()))
"""
    environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["rows"]
    (row,) = [row for row in rows if (row["agent"], row["subset"]) == ("mtp_strided", "all")]
    assert row["targets"] > 0
    assert row["samples"] == 10
    assert row["moving_error"] >= 0
