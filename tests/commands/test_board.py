"""What `board` keeps: found again where nothing changed, and never where a byte did."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from mtp_bench.commands import board as command
from mtp_bench.core import cache
from mtp_bench.core.files import CACHE_VARIABLE
from tests.support.board_records import MAIN, made_up
from tests.support.command_line import CommandLine
from tests.support.stored_records import save_record

OTHER = "MTP-Merge-v0"
Board = Callable[[], str]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The environments whose records were read, instead of those that the cache has."""
    envs = list[str]()
    original = command.read_board

    def counting(*arguments: object) -> object:
        envs.append(str(arguments[2]))
        return original(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(command, "read_board", counting)
    return envs


@pytest.fixture
def leaderboard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two environments, with keys, and code and cards that a test may change."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    folder = tmp_path / "leaderboard"
    for env_id in (MAIN, OTHER):
        for name, error in (("stp", 1.0), ("a", 0.5)):
            save_record(made_up(name, error, env_id), folder / "records" / name / f"{env_id}.json")
    for path in ("keys/allowed_signers", "seals/note", "../library/code.py"):
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text("# text\n", encoding="utf-8")
    original = cache.files_digest

    def with_copy(paths: list[Path]) -> str:
        """The digest of the library covers a file that a test can change."""
        is_library = any(path.name == "cache.py" for path in paths)
        return original([*paths, tmp_path / "library" / "code.py"] if is_library else paths)

    monkeypatch.setattr(cache, "files_digest", with_copy)
    return folder


@pytest.fixture
def shown(cli: CommandLine, leaderboard: Path) -> Board:
    return lambda: cli.ok("board", "--records", leaderboard / "records", "--base", leaderboard)


def flip(path: Path, old: bytes, new: bytes) -> None:
    """Change bytes, and leave size and times as they were."""
    before = path.stat()
    content = path.read_bytes()
    assert len(old) == len(new)
    assert old in content
    path.write_bytes(content.replace(old, new, 1))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    after = path.stat()
    assert (after.st_size, after.st_mtime_ns) == (before.st_size, before.st_mtime_ns)


CHANGES = {
    "a record": (f"records/a/{MAIN}.json", b'"a"', b'"b"', [MAIN]),
    "a key": ("keys/allowed_signers", b"text", b"next", [MAIN, OTHER]),
    "a seal": ("seals/note", b"text", b"next", [MAIN, OTHER]),
    "the code": ("../library/code.py", b"text", b"next", [MAIN, OTHER]),
}


@pytest.mark.parametrize("case", CHANGES)
def test_a_changed_byte_is_found(case: str, leaderboard: Path, shown: Board, read: list[str]) -> None:
    name, old, new, envs = CHANGES[case]
    first = shown()
    assert sorted(read) == sorted([MAIN, OTHER])
    assert shown() == first
    assert len(read) == 2, "nothing changed, so nothing was read"
    flip(leaderboard / name, old, new)
    changed = shown()
    assert sorted(read[2:]) == sorted(envs)
    assert (changed == first) == (case != "a record")


def test_a_missing_and_a_new_record_are_found(leaderboard: Path, shown: Board, read: list[str]) -> None:
    first = shown()
    path = leaderboard / "records" / "a" / f"{MAIN}.json"
    other = path.rename(leaderboard / "kept.json")
    assert shown() != first
    other.rename(path)
    assert shown() == first
    assert read[2:] == [MAIN, MAIN]


def broken_number(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"0.5", b"0.4"))


BROKEN: dict[str, Callable[[Path], object]] = {
    "another number": broken_number,
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-9]),
    "empty": lambda path: path.write_bytes(b""),
    "no text": lambda path: path.write_bytes(b"\xff\n\xff"),
    "of another environment": lambda path: path.write_bytes(path.with_stem(OTHER).read_bytes()),
    "others may write": lambda path: path.chmod(0o666),
    "others may write to the folder": lambda path: path.parent.chmod(0o777),
    "a link": lambda path: path.symlink_to(path.rename(path.with_suffix(".other"))),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_of_the_cache_does_not_count(case: str, tmp_path: Path, shown: Board, read: list[str]) -> None:
    first = shown()
    path = tmp_path / "cache" / "board" / f"{MAIN}.json"
    assert json.loads(path.read_text().partition("\n")[2])["tables"][0]["rows"]
    BROKEN[case](path)
    assert shown() == first
    assert MAIN in read[2:]


def test_a_key_that_expires_and_files_of_tables_are_not_kept(
    leaderboard: Path, cli: CommandLine, shown: Board, read: list[str], tmp_path: Path
) -> None:
    files = ("--json", tmp_path / "a.json", "--table", tmp_path / "a.csv")
    for _ in range(2):
        cli.ok("board", "--records", leaderboard / "records", "--base", leaderboard, *files)
    assert read == ["None", "None"]
    (leaderboard / "keys" / "allowed_signers").write_text('a valid-before="20991231" ssh-ed25519 AAAA\n')
    for _ in range(2):
        shown()
    assert read == ["None"] * 4


def test_a_kept_page_has_the_same_bytes(leaderboard: Path, cli: CommandLine, read: list[str], tmp_path: Path) -> None:
    page = tmp_path / "page.html"

    def written() -> dict[str, bytes]:
        cli.ok("board", "--records", leaderboard / "records", "--base", leaderboard, "-o", page)
        files = [page, *sorted((tmp_path / "page.parts").iterdir())]
        return {file.name: file.read_bytes() for file in files}

    first = written()
    assert written() == first
    assert read == ["None"]
    (tmp_path / "docs" / "definitions").mkdir(parents=True)
    (tmp_path / "docs" / "definitions" / "index.md").write_text("a page that exists is linked to")
    assert written() != first
    assert len(read) == 2
