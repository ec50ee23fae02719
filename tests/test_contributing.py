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
NAMED = re.compile(r"^\| (?:sampler|metric|card, dataset) \| `(tests/.+)` \|$", flags=re.MULTILINE)
# Of the tests that the page names those that read what the examples add; all of them take minutes.
QUICK = (
    "tests/scoring/test_golden_results.py",
    "tests/tables",
    "tests/viz/test_verdict.py",
    "tests/running/test_compare.py::test_the_file_has_the_keys_that_others_script_against",
    "tests/cards/test_cards.py",
    "tests/sources/test_packages.py",
    "tests/test_readme.py::test_the_table_of_environments_is_complete",
    "tests/test_package.py::test_baselines_use_public_names_only",
)

UNREAD = """
[[tool.mypy.overrides]]
# no addition imports it, and to read it takes a third of the time
module = ["torch.*"]
follow_imports = "skip"
"""


def apply(diff: str, root: Path) -> set[str]:
    """Insert the added lines of each hunk after its context line, which must occur once; returns the changed files."""
    changed = set()
    for part in diff.split("--- a/")[1:]:
        name = part.split("\n", 1)[0]
        for hunk in part.split("@@\n")[1:]:
            context, *lines = hunk.rstrip("\n").split("\n")
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
    for folder in ("mtp_bench", "envs", "baselines", "docs", "tests"):
        shutil.copytree(repository / folder, root / folder)
    (root / "leaderboard").symlink_to(repository / "leaderboard")  # large, and only read
    settings = (repository / "pyproject.toml").read_text()
    (root / "pyproject.toml").write_text(settings)
    (root / "mypy.toml").write_text(settings + UNREAD)
    page = (repository / "CONTRIBUTING.md").read_text()
    files = dict(FILE.findall(page))
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        assert not (root / name).exists()
        (root / name).write_text(text)
    changed = {name for diff in DIFF.findall(page) for name in apply(diff, root)}
    write_walks(root / "data" / "walks" / "scenes")
    return root, set(files), changed


def python(root: Path, *arguments: str) -> str:
    """Run Python in the copy, without real data and compiled kernels; returns what it prints."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MTP_BENCH_", "PYTEST_"))}
    environment |= {"MTP_BENCH_CACHE": str(root / "cache"), "PYTHONPATH": str(root), "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


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
    metric = {"mtp_bench/scoring/rows.py", "mtp_bench/scoring/report.py"}
    assert changed == metric | {"mtp_bench/cards/source.py", "docs/environment/index.md"}


def test_the_additions_work_together(followed: tuple[Path, set[str], set[str]]) -> None:
    """The new baseline runs on the new environment, and the new metric is in the report."""
    root, _, _ = followed
    code = """
import json

import mtp_bench
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import make_reference
make_reference.__defaults__ = (*make_reference.__defaults__[:-1], range(6))  # of 48 runs, each without compiled kernels
options = RunOptions("data")
mtp_bench.run("mtp_strided", "MTP-Walks-v0", "run", options)
print(json.dumps(mtp_bench.score("run", options).report.to_json()))
"""
    rows = json.loads(python(root, "-c", code))["rows"]
    (row,) = [row for row in rows if (row["agent"], row["subset"]) == ("mtp_strided", "all")]
    assert row["targets"] > 0
    assert row["samples"] == 10
    assert row["moving_error"] >= 0


@pytest.mark.parametrize(
    "check", ["ruff check", "ruff format --check", "mypy --follow-imports=silent --config-file mypy.toml"]
)
def test_the_additions_pass_lint(followed: tuple[Path, set[str], set[str]], check: str) -> None:
    root, new, changed = followed
    files = sorted(name for name in new | changed if name.endswith(".py"))
    python(root, "-m", *check.split(), *files)


def test_the_additions_keep_the_order_of_imports(followed: tuple[Path, set[str], set[str]]) -> None:
    root, _, _ = followed
    lint_imports = Path(sys.executable).with_name("lint-imports")
    assert " 0 broken" in python(root, str(lint_imports), "--no-logo", "--no-cache")


def test_the_additions_pass_tests_that_the_page_names(
    followed: tuple[Path, set[str], set[str]], repository: Path
) -> None:
    root, _, _ = followed
    named = " ".join(NAMED.findall((repository / "CONTRIBUTING.md").read_text())).split()
    assert [test for test in QUICK if not test.startswith(tuple(named))] == []
    python(root, "-m", "pytest", "-q", "--basetemp", "pytest", *QUICK)
