"""The command line: what each command prints and writes, its exit status, and what the README says of it."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import typer.main

import mtp_bench
from mtp_bench import card_ids
from mtp_bench.commands.app import app
from tests.conftest import REPOSITORY
from tests.support.command_line import CommandLine, copy_sequence, plain_environment, read_json, write_submission
from tests.support.small_scenes import write_kitti

COMMANDS = [
    "envs", "data", "doctor", "run", "score", "compare", "robustness", "study", "view", "events", "worst", "video", "train", "fit-noise",
]  # fmt: skip
COMMANDS += ["new", "check", "submit", "verify", "board", "import", "export", "maintain"]
TABLES = ["envs", "data", "score", "compare", "events", "worst", "check", "verify", "board"]  # what prints one
HEAVY = ["torch", "rerun", "highway_env", "sklearn", "numba", "scipy", "joblib", "pandas", "matplotlib", "jinja2"]


@pytest.fixture(scope="module")
def training(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A data root with a sequence outside the validation split."""
    root = write_kitti(tmp_path_factory.mktemp("training"))
    copy_sequence(Path(root), "0001", "0002")
    return root


def registered() -> dict[str, Any]:
    group: Any = typer.main.get_command(app)
    return {name: group.get_command(None, name) for name in group.list_commands(None)}


def python(code: str, *arguments: str, **keywords: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code, *arguments], text=True, check=False, **keywords)


def test_the_commands_are_those_of_the_design(cli: CommandLine) -> None:
    assert list(registered()) == COMMANDS
    options = {name: {word for p in command.params for word in p.opts} for name, command in registered().items()}
    assert all("--data" in options[name] for name in [*COMMANDS[1:9], "check", "submit", "verify"])
    assert all("--json" in options[name] for name in TABLES)
    assert all("Usage: mtp-bench" in cli.ok(*words, "--help") for words in [[], *([name] for name in COMMANDS)])
    assert cli.ok("--version") == f"mtp-bench {mtp_bench.__version__}\n"


@pytest.mark.parametrize("arguments", [["--help"], ["data", "--data", "/nowhere"]], ids=str)
def test_help_and_listings_load_no_heavy_package(arguments: list[str]) -> None:
    code = f"""
import sys
from mtp_bench.commands.app import main
try:
    main()
except SystemExit as left:
    loaded = sorted(set({HEAVY}) & set(sys.modules))
    parts = sorted(name for name in sys.modules if name.startswith("mtp_bench.commands."))
    print("left with", left.code, loaded, parts)
"""
    done = python(code, *arguments, capture_output=True)
    last = done.stdout.splitlines()[-1]
    assert last.startswith("left with 0 []"), done.stdout + done.stderr
    assert "mtp_bench.commands.board" not in last
    assert ("mtp_bench.commands.data" in last) == (arguments[0] == "data")


def test_the_program_and_the_module_are_the_same(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("mtp-bench")
    commands = [[str(program), "envs"], [sys.executable, "-m", "mtp_bench", "envs"]]
    first, second = (subprocess.run(c, capture_output=True, text=True, check=True) for c in commands)
    assert first.stdout == second.stdout
    assert "MTP-KITTI-v0" in first.stdout


def test_settings_of_numba_here_are_refused(cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They would come from a submission, and change how the judge runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    assert str(tmp_path) in cli("envs").error


WRONG_USAGE = {
    "no command": [], "too large a number": ["compare", "stp", "--env", "e", "--seeds", "1" + 25 * "0"],
    "an empty word": ["verify", ""], "an empty value": ["run", "stp", "--env", "e", "--output="],
    "unknown command": ["comapre"], "unknown option": ["envs", "--jsno", "a.json"],
    "no agent": ["run", "--env", "MTP-KITTI-v0", "-o", "run"], "no output": ["run", "stp", "--env", "MTP-KITTI-v0"],
    "no seed": ["compare", "stp", "--env", "MTP-KITTI-v0", "--seeds", "0"],
    "a table of another form": ["board", "--table", "table.xls"],
    "more scenes than are checked": ["check", "stp", "--scenes", "10"],
}  # fmt: skip


@pytest.mark.parametrize("arguments", WRONG_USAGE.values(), ids=WRONG_USAGE.keys())
def test_wrong_usage(
    arguments: list[str], cli: CommandLine, tmp_path: Path, kitti: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MTP_BENCH_DATA", kitti)
    output = cli(*arguments)
    assert output.status == 2
    assert "Usage: mtp-bench" in output.err + output.out
    assert "Traceback" not in output.err
    assert list(tmp_path.iterdir()) == []


UNKNOWN = {
    "env": (["run", "stp", "--env", "MTP-KITI-v0"], "unknown environment 'MTP-KITI-v0': did you mean 'MTP-KITTI-v0'?"),
    "agent": (["run", "spt", "--env", "CARD"], "unknown submission 'spt': did you mean 'stp'?"),
    "folder": (["run", "EMPTY", "--env", "CARD"], "is not a submission, expected a folder"),
    "card file": (["run", "stp", "--env", "none.toml"], "no card file at none.toml"),
    "agent beside others": (["compare", "stp", "mpt", "--env", "CARD"], "unknown submission 'mpt': did you mean 'mtp'"),
    "run": (["score", "EMPTY"], "no run.json there, expected a folder written by `mtp-bench run`"),
}


@pytest.mark.parametrize(("arguments", "message"), UNKNOWN.values(), ids=UNKNOWN.keys())
def test_unknown_names(
    arguments: list[str], message: str, cli: CommandLine, tmp_path: Path, card: str, kitti: str
) -> None:
    (tmp_path / "empty").mkdir()
    given = [{"CARD": card, "EMPTY": str(tmp_path / "empty")}.get(word, word) for word in arguments]
    more = {"run": ["-o", str(tmp_path / "run")], "compare": ["--json", str(tmp_path / "a.json")]}
    assert message in cli(*given, "--data", kitti, *more.get(arguments[0], [])).error
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


@pytest.mark.parametrize("arguments", [["run", "spt", "-o", "out"], ["study", "--agent", "spt"]])
def test_a_misspelt_agent_is_refused_before_scenes_are_made(
    arguments: list[str], cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "cache"))
    assert "unknown submission 'spt': did you mean 'stp'?" in cli(*arguments, "--env", "MTP-Roundabout-v0").error
    assert not list(tmp_path.iterdir())


def test_json_on_stdout_stands_alone(
    cli: CommandLine, tmp_path: Path, events_run: Path, known: list[str], kitti: str
) -> None:
    # not all of `data`: other processes of the tests make scenes meanwhile
    for command in (["envs"], ["data", *known], ["events", events_run, "--data", kitti]):
        printed = cli.ok(*command, "--json", "-")
        cli.ok(*command, "--json", tmp_path / "a.json")
        assert json.loads(printed) == read_json(tmp_path / "a.json")
    assert cli.ok("envs").startswith("Environments"), "the next command prints again"


def test_json_on_standard_output_stands_alone_beside_talking_agents(tmp_path: Path, card: str, kitti: str) -> None:
    """Agents run in processes of their own, which have the same standard output; a few runs make the event weights."""
    code = "from mtp_bench.running.reference import make_reference as m; from mtp_bench.commands.app import main"
    code += "; m.__defaults__ = (*m.__defaults__[:-1], range(6)); main()"
    talking = write_submission(tmp_path / "talking", "talking", body='print("HERE I AM")')
    known = ("--env", card, "--data", kitti, "--scenes", "1", "--seeds", "1", "--jobs", "2", "--json", "-")
    done = python(code, "compare", str(talking), *known, env=plain_environment(), capture_output=True)
    assert done.returncode == 0, done.stderr
    assert {row["agent"] for row in json.loads(done.stdout)["rows"]} >= {"talking", "stp"}
    assert "HERE I AM" in done.stderr


CLOSED = {
    "output": ("envs >&-", 0, ""),
    "output of a failure": ("score none >&-", 1, "error: none/run.json: no run.json there"),
    "error stream": ("score none 2>&-", 1, ""),
    "a full disk": ("envs >/dev/full", 1, "error: standard output, or temporary files in "),
    "a pipe that closes early": ("envs | true", 0, ""),
}


@pytest.mark.parametrize(("words", "status", "said"), CLOSED.values(), ids=CLOSED)
def test_what_a_stream_does_not_take_goes_nowhere_else(words: str, status: int, said: str, tmp_path: Path) -> None:
    if "/dev/full" in words and not Path("/dev/full").exists():
        pytest.skip("this system has no full device")
    command = f"exec {shlex.quote(sys.executable)} -P -m mtp_bench {words}"
    done = subprocess.run(
        ["sh", "-c", command], env=plain_environment(), cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr[: len(said) or None]) == (status, "", said)
    assert len(done.stderr.splitlines()) == bool(said)


@pytest.mark.parametrize("command", [["compare"], ["study"], ["robustness"], ["run"], ["train", "predictor"]], ids=str)
def test_many_options_are_grouped(command: list[str], cli: CommandLine) -> None:
    """Each option is in one group, the common ones first."""
    printed = cli.ok(*command, "--help")
    headings = re.findall(r"^(\w[\w ]+):$", printed, flags=re.MULTILINE)
    assert [each for each in headings if each != "Arguments"] == ["What is run", "Output", "Scenes",
                                                                "Detections and tracks", "Machine", "Options"][: len(headings)]  # fmt: skip
    listed = re.findall(r"^  (?:-\w, )?(--[a-z-]+)", printed, flags=re.MULTILINE)
    assert len(listed) == len(set(listed)) > 12


def test_the_root_comes_from_the_environment_unless_it_is_given(
    cli: CommandLine, tmp_path: Path, kitti: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    printed = cli.ok("data", "--data", kitti, "--json", tmp_path / "a.json")
    content = read_json(tmp_path / "a.json")
    assert list(content) == list(card_ids())
    assert re.search("KITTI tracking +complete +KITTI-5Hz, KITTI-noego, KITTI\n", printed)
    assert len(printed.splitlines()) <= 24, "it fits a terminal"
    first = content["MTP-KITTI-v0"]
    assert (first["usable"], first["missing"], first["problems"], first["counts"]["scenes"]) == (True, [], [], 3)
    monkeypatch.setenv("MTP_BENCH_DATA", kitti)
    env = ("--env", "MTP-KITTI-v0")
    calls = [(*env,), (*env, "--data", tmp_path), ("--data", tmp_path)]
    assert [cli("data", *words).status for words in calls] == [0, 1, 0]
    printed = cli.ok("data", *env)
    assert all(text in printed for text in ("found: 3 scenes, 20 frames", "licence: CC BY-NC-SA 3.0 (Geiger et al.)"))


UNWRITABLE = {"none/a.json": "there is no folder none", "folder": "it is a folder, expected the name of a file"}


@pytest.mark.parametrize(("path", "message"), [*UNWRITABLE.items(), ("file/a.json", "there is no folder file")])
def test_a_file_that_cannot_be_written_is_refused_before_the_work(
    path: str, message: str, cli: CommandLine, tmp_path: Path, card: str, kitti: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent = write_submission(tmp_path / "mine", body="raise RuntimeError('it ran')")
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    monkeypatch.chdir(tmp_path)
    output = cli("compare", agent, "--env", card, "--data", kitti, "--json", path)
    assert message in output.error
    assert (output.out, sorted(p.name for p in tmp_path.iterdir())) == ("", ["file", "folder", "mine"])


def test_train_fits_the_training_split(cli: CommandLine, tmp_path: Path, card: str, training: str) -> None:
    common = ("train", "motion-noise", "--env", card, "--data", training)
    printed = cli.ok(*common)
    fitted = tomllib.loads(printed)
    assert (list(fitted), list(fitted["pointrcnn-world"])) == (["pointrcnn-world"], ["car", "pedestrian"])
    fields = {"measurement", "jerkiness", "speed", "acceleration"}
    assert (set(fitted["pointrcnn-world"]["car"]), cli.ok(*common, "-o", tmp_path / "noise.toml")) == (fields, "")
    assert (tmp_path / "noise.toml").read_text() == printed
    assert list(tomllib.loads(cli.ok(*common, "--observe", "truth"))) == ["truth-world"]


def test_the_progress_bar_keeps_to_the_error_stream_of_a_terminal(tmp_path: Path, card: str, training: str) -> None:
    terminal, side = pytest.importorskip("pty").openpty()
    arguments = ["train", "motion-noise", "--env", card, "--data", training]
    code = "from mtp_bench.core import notice; notice.SILENT_SECONDS = 0; "
    code += "from mtp_bench.commands.app import main; main()"
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200", "MTP_BENCH_QUIET": "0"}
    done = python(code, *arguments, stdout=subprocess.PIPE, stderr=side, env=environment)
    os.close(side)
    written = bytearray()
    with suppress(OSError):  # of a terminal that nobody has open any more, once all is read: at most 4 KB at a time
        while part := os.read(terminal, 1 << 16):
            written += part
    os.close(terminal)
    shown = written.decode()
    assert list(tomllib.loads(done.stdout)) == ["pointrcnn-world"]
    assert re.search("(reading scenes|preparing scenes|is working)[^\n]*━", shown), "as fast as the machine is"
    assert shown.endswith("\x1b[2K"), "the bar leaves no trace"


def test_a_deleted_current_folder_is_named(cli: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert cli("new", "mine").error == "the current folder does not exist any more: change to another one"


def commands_of(text: str) -> list[list[str]]:
    """Arguments of every ``mtp-bench`` call in the shell blocks of a document."""
    blocks = re.findall(r"^```(?:sh|bash|console)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    whole = [block.replace("\\\n", " ") for block in blocks]  # lines that go on
    lines = [part for block in whole for line in block.splitlines() for part in line.split("&&")]
    calls = [shlex.split(line.strip().removeprefix("$ "), comments=True) for line in lines]
    return [words[1:] for words in calls if words and Path(words[0]).name == "mtp-bench"]


DOCUMENTS = [
    "README.md", "CONTRIBUTING.md", "baselines/README.md", "envs/README.md", "leaderboard/SUBMITTING.md",
    "leaderboard/MAINTAINING.md",
    *sorted(path.relative_to(REPOSITORY).as_posix() for path in (REPOSITORY / "docs").rglob("*.md")),
]  # fmt: skip


@pytest.mark.parametrize("document", DOCUMENTS)
def test_the_commands_of_the_documents_exist(document: str, repository: Path) -> None:
    text = (repository / document).read_text()
    for words in commands_of(text):
        assert words[0] in COMMANDS, words
        registered()[words[0]].make_context(words[0], words[1:])  # parses and checks, runs nothing
    for name in re.findall(r"`mtp-bench (\w[\w-]*)", text):
        assert name in COMMANDS


def test_the_commands_of_make_exist(repository: Path) -> None:
    calls = re.findall(r"\$\(BIN\)/mtp-bench ([^;&`\n\\]+)", (repository / "Makefile").read_text())
    assert calls
    for call in calls:
        name, *words = shlex.split(call)
        registered()[name].make_context(name, words)


@pytest.mark.parametrize("words", [
    ("score", "a", "--data", "x", "--data", "y"),
    ("import", "forecasts", "a", "--env", "x", "--env", "y", "-o", "z"),
    ("compare", "stp", "--env", "x", "--full", "--full"),
])  # fmt: skip
def test_an_option_that_is_given_twice_is_an_error(cli: CommandLine, words: tuple[str, ...]) -> None:
    output = cli(*words)
    assert output.status == 2
    assert "given twice, expected once" in " ".join(output.err.split())
