"""Files that nobody sends by accident: each is one line that says what was got and what to do, and ends in time."""

import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.agent import load_submission, submission_files as contents
from mtp_bench.core.files import clean_text, file_digest
from mtp_bench.judge import load_record
from mtp_bench.judge.gateway.layout import image_of
from mtp_bench.tracking.kernels.cache import cache_folder
from tests.support.command_line import CommandLine, Output, plain_environment, write_submission, write_training
from tests.support.disks import mounted
from tests.support.small_scenes import CARD, CARD_ID, write_card

pytestmark = pytest.mark.usefixtures("remembered_weights")
PATIENCE = 120  # s; what hangs is far from it
DEEP = "nested deeper than 64 levels"
Change = Callable[[Path], object]


@pytest.fixture(autouse=True)
def _in_time() -> Iterator[None]:
    """A command that waits for ever fails its test, in place of stopping all of them."""

    def end(*_: object) -> None:
        raise AssertionError(f"it did not end within {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def refused(output: Output) -> str:
    """The one line of a command that gave up, for the reason that it says."""
    assert output.status in (1, 2)
    assert "Traceback" not in output.err + output.out
    text = output.error
    assert len(text) < 2000, "an error is no copy of what was sent"
    assert text.isprintable()
    return text


def text(content: str) -> Change:
    return lambda path: path.write_text(content, encoding="utf-8")


def raw(content: bytes) -> Change:
    return lambda path: path.write_bytes(content)


def sparse(size: int) -> Change:
    """A file of many zeros that takes no room on the disk."""

    def make(path: Path) -> None:
        with path.open("wb") as file:
            file.truncate(size)

    return make


def nested(folder: Path) -> None:
    (folder / "/".join("d" * 40)).mkdir(parents=True)


def bind(path: Path) -> None:
    before = Path.cwd()
    os.chdir(path.parent)  # the path of a socket is short
    try:
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(path.name)
    finally:
        os.chdir(before)


ANY_TEXT: dict[str, tuple[Change, str]] = {  # of JSON and TOML alike -> what is said
    "a FIFO": (os.mkfifo, "it is a FIFO, expected a file"),
    "a folder": (Path.mkdir, "it is a folder, expected a file"),
    "a socket": (bind, "it is a socket, expected a file"),
    "a link to itself": (lambda path: path.symlink_to(path), "Too many levels of symbolic links"),
    "UTF-16": (raw('{"a": 1}'.encode("utf-16")), "not valid UTF-8: invalid start byte at byte 0; save it as UTF-8"),
    "half a letter": (raw(b'name = "\xc3"'), "not valid UTF-8"),
    "20 GB of zeros": (sparse(20 << 30), "larger than "),
    "a device without end": (lambda path: path.symlink_to("/dev/zero"), "it is a device, expected a file"),
}
JSON: dict[str, tuple[Change, str]] = {
    **ANY_TEXT,
    "1e400": (text('{"a": 1e400}'), "a number is too large, infinite or NaN"),
    "a key twice": (text('{"a": 1, "b": {"c": 1, "c": 2}}'), "key 'c' comes twice"),
    "5 000 digits": (text('{"a": ' + "9" * 5000 + "}"), "a number has thousands of digits"),
    "20 digits": (text('{"a": -' + "9" * 20 + "}"), "a number of 20 digits, expected at most 19"),
    "NaN": (text('{"a": NaN}'), "NaN is not allowed in JSON"),
    "-Infinity": (text('{"a": -Infinity}'), "-Infinity is not allowed in JSON"),
    "900 deep": (text('{"a": ' + "[" * 900 + "]" * 900 + "}"), DEEP),
    "100 000 deep": (text('{"a": ' + "[" * 100_000), DEEP),
    "tables 100 000 deep": (text('{"a":' * 100_000), DEEP),
    "half a letter, escaped": (text('{"a": ["\\ud800"]}'), "contains a lone surrogate"),
    "half a letter in a key": (text('{"a": {"\\udfff": 1}}'), "contains a lone surrogate"),
    "a list": (text("[]"), "holds list, expected a table"),
    "nothing": (text(""), "not valid JSON"),
}
TOML: dict[str, tuple[Change, str]] = {
    **ANY_TEXT,
    "1e400": (text("a = 1e400"), "a number is too large, infinite or NaN"),
    "5 000 digits": (text("a = " + "9" * 5000), "a number has thousands of digits"),
    "5 000 digits of 16": (text("a = 0x" + "f" * 5000), "a number has thousands of digits"),
    "20 digits": (text("a = " + "9" * 20), "a number of 20 digits, expected at most 19"),
    "nan": (text("a = nan"), "a number is too large, infinite or NaN"),
    "900 deep": (text("a = " + "[" * 900 + "]" * 900), DEEP),
    "100 000 deep": (text("a = " + "[" * 100_000), DEEP),
    "a key 1 000 deep": (
        text("a" + ".a" * 1000 + " = 1"), "line 1 has 1000 dots outside of numbers, expected at most 64"),
    "a date": (text("a = 2026-01-01"), "a date (2026-01-01), expected texts, numbers, lists and tables"),
    "an escape of half a letter": (text('a = "\\ud800"'), "not valid TOML"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "said"), JSON.values(), ids=JSON)
def test_a_record(change: Change, said: str, cli: CommandLine, tmp_path: Path) -> None:
    if change is Path.mkdir:
        said = "no record there"  # a folder is looked through
    path = tmp_path / "MTP-Small-v0.json"
    change(path)
    assert said in refused(cli("verify", path))


SOME = ("a FIFO", "UTF-16", "20 GB of zeros", "900 deep", "1e400")  # for files that the same functions read


@pytest.mark.parametrize("what", SOME)
def test_a_stored_run(what: str, cli: CommandLine, tmp_path: Path) -> None:
    change, said = JSON[what]
    change(tmp_path / "run.json")
    assert said in refused(cli("score", tmp_path))


@pytest.mark.parametrize(("change", "said"), TOML.values(), ids=TOML)
def test_a_manifest(change: Change, said: str, cli: CommandLine, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo")
    (folder / "submission.toml").unlink()
    change(folder / "submission.toml")
    if "link" in said:  # what leads nowhere is no manifest
        said = "is not a submission, expected a folder with submission.toml"
    assert said in refused(cli("check", folder))


@pytest.mark.parametrize("what", SOME)
def test_a_card(what: str, cli: CommandLine, kitti: str, tmp_path: Path) -> None:
    path, (change, said) = tmp_path / f"{CARD_ID}.toml", TOML[what]
    change(path)
    if "expected a file" in said:
        said = "no card file at"
    assert said in refused(cli("run", "stp", "--env", path, "--data", kitti, "-o", tmp_path / "run"))


@pytest.mark.parametrize("what", SOME)
def test_a_detector_profile(what: str, cli: CommandLine, tmp_path: Path) -> None:
    path, (change, said) = tmp_path / "noise.toml", TOML[what]
    change(path)
    assert said in refused(cli("run", "stp", "--env", "MTP-Merge-v0", "--detector", path, "-o", tmp_path / "run"))


LONG = "a" * 10_000_000
MANIFESTS: dict[str, tuple[str, str, str]] = {  # what is replaced, by what, what is said
    "authors of 10 MB": ('"A. Author"', f'"{LONG}"', "larger than 1024 KiB"),
    "authors of 100 kB": ('"A. Author"', f'"{LONG[:100_000]}"', "authors.0: got 'aaa"),
    "1 000 authors": ('"A. Author"', '"A", ' * 1000, "at most 50 items"),
    "an escape code": ("A. Author", "A\\u001b[2J", "expected one line without controls"),
    "text that turns around": ("A. Author", "A\\u202etxt.exe", "expected one line without controls"),
    "a name of 300 letters": ('"echo"', f'"{LONG[:300]}"', "at most 64 lower-case"),
    "a name that leaves": ('"echo"', '"../echo"', "name: got '../echo'"),
    "a source that is a script": ('"echo"', '"echo"\nsource = "javascript:alert(1)"', "source: got 'javascript"),
    "a commit that is none": ('"echo"', '"echo"\ncommit = "main"', "commit: got 'main'"),
    "a licence of markup": ('"echo"', '"echo"\nlicense = "<b>"', "license: got '<b>'"),
    "a key of 100 kB": ('"echo"', f'"echo"\n{LONG[:100_000]} = 1', "unknown key 'aaa"),
    "a sweep of millions": (
        '"agent:build"', '"agent:build"\n[compare.sweep]\n' + "\n".join(f"a{i} = {list(range(10))}" for i in range(7)),
        "compare.sweep makes 10000000 settings, expected at most 1000"),
}  # fmt: skip


@pytest.mark.parametrize(("what", "by", "said"), MANIFESTS.values(), ids=MANIFESTS)
def test_what_a_manifest_says(what: str, by: str, said: str, cli: CommandLine, tmp_path: Path) -> None:
    path = write_submission(tmp_path / "echo") / "submission.toml"
    path.write_text(path.read_text().replace(what, by))
    assert said in refused(cli("check", tmp_path / "echo"))


SIZES: dict[str, tuple[str, str]] = {  # parameters, what is said
    "a billion hypotheses": ("hypotheses = 1000000000", "one action would have "),
    "no hypotheses": ("hypotheses = 0", "parameter 'hypotheses' is 0, expected a whole number of at least 1"),
    "less than none": ("hypotheses = -1", "parameter 'hypotheses' is -1, expected a whole number of at least 1"),
    "half a hypothesis": ("hypotheses = 1.5", "parameter 'hypotheses' is 1.5, expected a whole number"),
}


@pytest.mark.parametrize(("parameter", "said"), SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("command", ["submit", "run", "compare"])
def test_absurd_parameters(
    command: str, parameter: str, said: str, cli: CommandLine, card: str, kitti: str, tmp_path: Path
) -> None:
    tables = f'[parameters]\n{parameter}\n[compare]\nhypotheses = "hypotheses"\n'
    folder = write_submission(tmp_path / "echo", tables=tables)
    output = () if command == "compare" else ("-o", tmp_path / "out")
    text = refused(cli(command, folder, "--env", card, "--data", kitti, "--jobs", 1, *output))
    assert said in text
    if "would have" in said:
        assert all(each in text for each in ("hypotheses 1000000000", "expected at most 64 MiB"))


def test_a_billion_samples(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    tables = '[parameters]\ndraws = 1000000000\n[compare]\ndraws = "draws"\nsamples = ["equal", "free"]\n'
    folder = write_submission(tmp_path / "echo", tables=tables)
    said = refused(cli("compare", folder, "--env", card, "--data", kitti, "--jobs", 1, "--full"))
    assert all(each in said for each in ("samples 4000000000", "expected at most 64 MiB"))


CARDS: dict[str, tuple[str, str, str]] = {
    "1e308 metres": ("miss_error = 2.0", "miss_error = 1e308", "Input should be less than or equal to 10000"),
    "1e308 frames a second": ("rate = 10.0", "rate = 1e308", "less than or equal to 1000"),
    "a past of a billion frames": ("past = 2", "past = 1000000000", "less than or equal to 1000"),
    "a billion samples": ("samples = 4", "samples = 1000000000", "less than or equal to 1000"),
    "a billion detections": ("detections = 6", "detections = 1000000000", "one observation would have "),
    "a billion tracks": ("tracks = 5", "tracks = 1000000000", "one action would have "),
}


@pytest.mark.parametrize(("what", "by", "said"), CARDS.values(), ids=CARDS)
def test_absurd_cards(what: str, by: str, said: str, cli: CommandLine, kitti: str, tmp_path: Path) -> None:
    path = write_card(tmp_path, CARD.replace(what, by))
    assert said in refused(cli("run", "stp", "--env", path, "--data", kitti, "-o", tmp_path / "run"))


def test_a_card_of_1e308_seconds(cli: CommandLine, repository: Path, tmp_path: Path) -> None:
    path = tmp_path / "MTP-Merge-v0.toml"
    path.write_text((repository / "envs" / path.name).read_text().replace("[source]", "[source]\nseconds = 1e308"))
    assert "seconds" in refused(cli("run", "stp", "--env", path, "-o", tmp_path / "run"))


def many(folder: Path) -> None:
    for number in range(contents.MOST_FILES + 1):
        (folder / f"{number}.txt").touch()


def named_in_latin(folder: Path) -> None:
    Path(os.fsdecode(os.fsencode(folder) + b"/caf\xe9.py")).touch()


def link_out(folder: Path) -> None:
    (folder.parent / "secret").write_text("truth")
    (folder / "weights.bin").symlink_to("../secret")


def device(folder: Path) -> None:
    try:
        os.mknod(folder / "zero", 0o600 | 0o020000, os.makedev(1, 5))
    except PermissionError:
        pytest.skip("only root makes devices")


FOLDERS: dict[str, tuple[Change, str]] = {
    "20 GB of zeros": (lambda folder: sparse(20 << 30)(folder / "weights.bin"), "20.0 GiB or more (weights.bin"),
    "10 001 files": (many, "more than 10000 files, the limit"),
    "a FIFO": (lambda folder: os.mkfifo(folder / "weights.bin"), "weights.bin is a FIFO, expected files and folders"),
    "a socket": (lambda folder: bind(folder / "door"), "door is a socket, expected files and folders only"),
    "a device": (device, "zero is a device, expected files and folders only"),
    "a link out": (link_out, "weights.bin is a link to a file; a submission holds its files itself: copy"),
    "a link to /": (lambda folder: (folder / "root").symlink_to("/"), "root is a link to a folder"),
    "a link to itself": (lambda folder: (folder / "loop").symlink_to("loop"), "loop is a link to a file"),
    "a link up": (lambda folder: (folder / "up").symlink_to(".."), "up is a link to a folder"),
    "a file .git": (lambda folder: (folder / ".git").touch(), ".git is a file, and only a folder may have this name"),
    "a file __pycache__": (lambda folder: (folder / "__pycache__").write_text("1"), "__pycache__ is a file, and only"),
    "a name that is no text": (named_in_latin, "caf\\xe9.py': its name is not UTF-8"),
    "folders 40 deep": (nested, "folders are nested deeper than 32 levels"),
}


@pytest.mark.parametrize(("change", "said"), FOLDERS.values(), ids=FOLDERS)
def test_submission_folders(change: Change, said: str, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo")
    change(folder)
    assert said in refused(cli("submit", folder, "--env", card, "--data", kitti, "-o", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_submission_that_is_a_link_to_itself(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    (tmp_path / "echo").symlink_to(tmp_path / "echo")
    assert "is not a submission" in refused(cli("submit", tmp_path / "echo", "--env", card, "--data", kitti))


def test_a_file_that_grows_while_it_is_hashed(tmp_path: Path) -> None:
    """Its size was within the bound when it was looked at."""
    path = tmp_path / "weights.bin"
    path.write_bytes(bytes(3 << 20))
    assert len(file_digest(path, 3 << 20)) == 64
    with pytest.raises(OSError, match="it has more than 2097152 bytes, and may be growing"):
        file_digest(path, 2 << 20)


def test_a_submission_that_changes_while_it_runs(cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    """All scenes run the copy that was made at the beginning, and the record is of it."""
    folder = write_submission(tmp_path / "echo", body="import time; time.sleep(0.1)")
    known = ("--env", card, "--data", kitti, "--jobs", "1", "--seeds", "1")
    arguments = ["submit", folder, *known, "-o", tmp_path / "out"]

    def change() -> None:
        while not list((tmp_path / "out").glob("*.part/seed-0/*.npz")):
            time.sleep(0.01)
        (folder / "more.txt").touch()

    expected = image_of(load_submission(folder), card).digest
    threading.Thread(target=change, daemon=True).start()
    cli.ok(*arguments)
    assert (folder / "more.txt").exists()
    assert load_record(tmp_path / "out" / f"{CARD_ID}.json").submission.digest == expected


DEEP_HEAD = b'{"__metadata__": {"mtp_bench": "' + b"[" * 50_000 + b'"}}'
WEIGHTS: dict[str, tuple[Change, str]] = {
    "a header of 2**63 bytes": (raw(struct.pack("<Q", 2**63) + b"{}"), "not a file of weights"),
    "a header that is deep": (raw(struct.pack("<Q", 200_000) + b'{"a":' * 40_000), "not a file of weights"),
    "said deeply": (raw(struct.pack("<Q", len(DEEP_HEAD)) + DEEP_HEAD), DEEP),
    "20 GB of zeros": (sparse(20 << 30), "bytes, expected at most 67108864"),
    "cut off": (raw(b"\x01"), "not a file of weights"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "said"), WEIGHTS.values(), ids=WEIGHTS)
def test_weights(
    change: Change, said: str, cli: CommandLine, known: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MTP_BENCH_WEIGHTS", str(tmp_path / "weights"))
    (tmp_path / "weights").mkdir()
    change(tmp_path / "weights" / f"modes-truth-{CARD_ID}.safetensors")
    assert said in refused(cli("run", "stp_modes", *known, "--jobs", 1, "-o", tmp_path / "run"))


@pytest.mark.parametrize(("got", "expected"), [
    ("plain – ünïcode ✓ \u0645\u200c\u0646", "plain – ünïcode ✓ \u0645\u200c\u0646"),
    ("a\nb\r\nc\u2028d\te", "a b c d\ufffde"), ("\x1b[31mred\x07", "\ufffd[31mred\ufffd"),
    ("\ud800\udc00 \u202e \u200b \ufeff", "\ufffd\ufffd \ufffd \ufffd \ufffd"), ("x" * 50, "x" * 19 + "…"),
    ("\n" * 50, " " * 19 + "…"),
])  # fmt: skip
def test_clean_text(got: str, expected: str) -> None:
    cleaned = clean_text(got, 20 if len(got) > 30 else 40)
    assert cleaned.strip() == expected.strip()
    cleaned.encode()


def test_a_name_of_a_folder_that_is_no_text(cli: CommandLine, known: list[str], tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo")
    output = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9")
    said = cli.ok("submit", folder, *known, "--jobs", 1, "--seeds", 1, "--scenes", 1, "-o", output)
    assert "caf\\udce9/MTP-Small-v0.json: partial" in said
    assert (Path(output) / f"{CARD_ID}.json").is_file()


def test_a_home_that_cannot_be_written(card: str, kitti: str, tmp_path: Path) -> None:
    """What needs no cache works; what needs a place says which variable names one."""
    folder = write_submission(tmp_path / "echo")
    free = ("MTP_BENCH_CACHE", "MTP_BENCH_WEIGHTS", "XDG_CACHE_HOME", "XDG_DATA_HOME")
    environment = {name: value for name, value in plain_environment().items() if name not in free}
    with mounted(tmp_path / "home", "ro") as home:
        environment |= {"HOME": str(home), "NUMBA_CACHE_DIR": str(cache_folder()), "MPLCONFIGDIR": str(tmp_path)}

        def said(*arguments: object) -> tuple[int, str]:
            done = subprocess.run(
                [sys.executable, "-m", "mtp_bench", *map(str, arguments)], env=environment, capture_output=True,
                text=True, check=False,
            )  # fmt: skip
            return done.returncode, done.stderr

        known = ("--env", card, "--data", kitti, "--jobs", 1)
        assert said("run", folder, *known, "-o", tmp_path / "run")[0] == 0
        status, error = said("run", folder, "--env", "MTP-Merge-v0", "--scenes", 1, "-o", tmp_path / "merge")
        assert (status, error.count("\n")) == (1, 1)
        assert "Read-only file system; set MTP_BENCH_CACHE to another folder" in error
        environment["MTP_BENCH_CACHE"] = str(tmp_path / "cache")
        training = write_training(tmp_path / "training", "0001", ["0000"])
        status, error = said("train", "predictor", "modes", "--epochs", "1", "--env", card, "--data", training)
        assert (status, error.count("\n")) == (1, 1)
        assert "Read-only file system; choose another folder for weights with MTP_BENCH_WEIGHTS" in error


@pytest.mark.parametrize("command", ["run", "compare", "new"])
def test_a_full_disk(command: str, cli: CommandLine, card: str, kitti: str, tmp_path: Path) -> None:
    folder = write_submission(tmp_path / "echo")
    known: dict[str, tuple[Any, ...]] = {
        "run": (folder, "--env", card, "--data", kitti, "--jobs", 1, "-o", tmp_path / "disk" / "run"),
        "compare": (folder, "--env", card, "--data", kitti, "--jobs", 1, "--json", tmp_path / "disk" / "a.json"),
        "new": ("mine", "--folder", tmp_path / "disk"),
    }
    with mounted(tmp_path / "disk", "size=4k") as disk:
        said = refused(cli(command, *known[command]))
        assert all(each in said for each in (str(disk), "make room there, or choose another folder"))
        assert list(disk.iterdir()) == []
