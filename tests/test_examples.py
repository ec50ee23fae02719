"""Every example runs from an empty folder, and prints what the documentation shows of it.

A comment says what an example needs beside the library: `# needs: stable-baselines3, data` (packages, recordings).
"""

import re
import runpy
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest

from docs.generate.outputs import COLUMNS, EXAMPLES as FOLDER, OUTPUTS, ROOT, run
from mtp_bench.commands.app import main
from mtp_bench.running.comparison import compare
from tests.support.command_line import CommandLine, restored_signals
from tests.test_readme import blocks

NEEDS = re.compile(r"^# needs: (.+)$", flags=re.MULTILINE)
ELSEWHERE = {"rl_association": "tests/wrappers/test_rl_example.py"}  # it takes a minute: there it trains on less
FAULTS = FOLDER / "planted_faults.py"  # run with the commands of the page about its log
FIRST = FOLDER / "first_agent.py"  # as a program
EXAMPLES = sorted(path for path in FOLDER.glob("*.py") if path.stem not in ELSEWHERE and path not in (FAULTS, FIRST))


def needs(example: Path) -> list[str]:
    found = NEEDS.search(example.read_text())
    return [name.strip() for name in found[1].split(",")] if found else []


def missing(package: str) -> bool:
    try:
        version(package)
    except PackageNotFoundError:
        return True
    return False


def case(example: Path) -> object:
    packages = [name for name in needs(example) if name != "data"]
    absent = [name for name in packages if missing(name)]
    marks = [pytest.mark.data] if "data" in needs(example) else []
    marks += [pytest.mark.skipif(bool(absent), reason=f"not installed: {', '.join(absent)}")]
    return pytest.param(example, marks=marks, id=example.stem)


def sentences(output: str) -> list[str]:
    """Lines outside of tables, with # for every number."""
    lines = [line for line in output.splitlines() if line.strip() and line[0] not in "┏┃┡│└├╭╰─ "]
    return [re.sub(r"\d+(\.\d+)?", "#", " ".join(line.split())) for line in lines]


def run_here(example: Path, folder: Path) -> None:
    """Run an example in this process, which has loaded most libraries already; commands that it starts, too."""
    in_processes = subprocess.run

    def started(words: list[str], **keywords: Any) -> Any:
        if words[:3] != [sys.executable, "-m", "mtp_bench"]:
            return in_processes(words, **keywords)
        patch.setattr(sys, "argv", ["mtp-bench", *words[3:]])
        with restored_signals(), pytest.raises(SystemExit) as left:
            main()
        assert not left.value.code
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("COLUMNS", COLUMNS)
        patch.syspath_prepend(example.parent)
        patch.setattr(subprocess, "run", started)
        patch.setattr(sys, "argv", [str(example)])
        runpy.run_path(str(example), run_name="__main__")


@pytest.fixture
def main_table_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Comparisons run what the table needs that examples print, in half of the time."""
    monkeypatch.setattr(compare, "__defaults__", (*(compare.__defaults__ or ())[:-1], False))


@pytest.mark.usefixtures("few_event_runs", "main_table_alone")
@pytest.mark.parametrize("example", [case(example) for example in EXAMPLES])
def test_it_runs(example: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_here(example, tmp_path)
    printed = capsys.readouterr().out
    assert printed.strip(), "an example shows something"
    shown = OUTPUTS / f"{example.stem}.txt"
    if shown.exists():
        unknown = set(sentences(shown.read_text())) - set(sentences(printed))
        assert not unknown, f"{printed}\nthe documentation shows other lines: python -m docs.generate.outputs"


def test_the_first_runs_as_a_program(tmp_path: Path) -> None:
    done = run(FIRST, tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert sentences(done.stdout) == sentences((OUTPUTS / f"{FIRST.stem}.txt").read_text())


@pytest.mark.parametrize("name", sorted(path.stem for path in (FOLDER / "reference").glob("*.py")))
def test_an_example_of_the_reference_prints_what_is_shown(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile((FOLDER / f"reference/{name}.py").read_text(), name, "exec"), {"__name__": "__main__"})
    assert capsys.readouterr().out == (OUTPUTS / f"reference/{name}.txt").read_text()


def test_the_example_of_the_commands_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> None:
    monkeypatch.chdir(tmp_path)
    for line in (FOLDER / "reference/commands.sh").read_text().splitlines():
        cli.ok(*shlex.split(line, comments=True)[1:])
    assert (tmp_path / "frame.png").exists()


def test_planted_faults_and_commands_on_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    test_it_runs(FAULTS, tmp_path, capsys)
    cli = CommandLine(capsys)
    lines = "".join(blocks(ROOT / "docs/visualization/fault.md", "sh")).splitlines()
    commands = [words[1:] for line in lines if (words := shlex.split(line, comments=True))]
    shown = [words for words in commands if words[0] == "worst" or "--png" in words]
    printed = [cli.ok(*words) for words in shown]
    assert len(printed) >= 3
    assert "turning@" in printed[0]
    assert "turning@" not in printed[1], "it is not the detector's fault"
    assert "hidden@" in printed[1]


@pytest.mark.parametrize(("name", "test"), ELSEWHERE.items())
def test_others_run_elsewhere(name: str, test: str) -> None:
    assert f"examples/{name}.py" in (ROOT / test).read_text()


@pytest.mark.parametrize("shown", sorted(OUTPUTS.rglob("*.txt")), ids=lambda path: path.stem)
def test_what_is_shown_is_of_an_example(shown: Path) -> None:
    assert (FOLDER / shown.relative_to(OUTPUTS).with_suffix(".py")).exists()
