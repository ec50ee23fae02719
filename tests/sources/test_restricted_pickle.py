"""The restricted reader of pickles: equal to `pickle.load` on arrays, one error for anything else, and nothing runs."""

import builtins
import copyreg
import io
import os
import pickle
import struct
import subprocess
import sys
import textwrap
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench.core import DataError
from mtp_bench.sources import restricted_pickle
from mtp_bench.sources.restricted_pickle import array_of, read_pickle
from tests.support.forecast_files import av2

MARKER = "it-ran"


def written(root: Path, content: bytes) -> Path:
    path = root / "f.pkl"
    path.write_bytes(content)
    return path


# ---- what is read
def same(value: Any, expected: Any) -> None:
    """Compare what was read with what `pickle` reads; arrays by `array_of`."""
    if isinstance(expected, np.ndarray):
        read = array_of(value, (-1,) * expected.ndim, "here")
        assert (read.shape, read.tolist()) == (expected.shape, expected.astype(float).tolist())
    elif isinstance(expected, dict):
        assert list(value) == list(expected)
        for key, part in expected.items():
            same(value[key], part)
    elif isinstance(expected, list | tuple):
        assert len(value) == len(expected)
        for got, part in zip(value, expected, strict=True):
            same(got, part)
    else:
        assert value == expected


REAL: dict[str, Any] = {
    "a submission": av2(),
    "plain values": {"a": [1, -(2**70), 0.5, None, True, "ü", b"x", (1, 2)], 3: {"b": ()}},
    "types": [np.arange(4).astype(kind) for kind in "?bhilqBHILQefd"],
    "big endian": [np.arange(3, dtype=">f8"), np.arange(3, dtype=">i2")],
    "Fortran order": [np.asfortranarray(np.arange(6.0).reshape(2, 3)), np.arange(24.0).reshape(2, 3, 4).T],
    "empty": [np.zeros((0, 6, 2)), np.zeros(0)],
    "no dimension": [np.array(2.5)],
    "scalars": [np.float32(0.25), np.int64(7), np.bool_(True), np.str_("SCHOOL_BUS"), np.float64(1e-9)],
    "a part of an array": [np.arange(20.0).reshape(4, 5)[1:3, ::2]],
    "one array twice": [av2()] * 2,
    "read-only": [np.broadcast_to(np.arange(3.0), (2, 3))],
}


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("case", REAL)
def test_real_pickles_are_read_as_pickle_reads_them(case: str, protocol: int, tmp_path: Path) -> None:
    content = pickle.dumps(REAL[case], protocol)
    same(read_pickle(written(tmp_path, content)), pickle.loads(content))


def test_a_long_text_and_many_frames(tmp_path: Path) -> None:
    content = pickle.dumps({"text": "x" * 200_000, "arrays": [np.arange(10_000.0)] * 3})
    same(read_pickle(written(tmp_path, content)), pickle.loads(content))


# ---- what is not
class Call:
    """Pickled as a call."""

    def __init__(self, function: Any, *arguments: Any, state: Any = None) -> None:
        self.reduced = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self) -> Any:
        return self.reduced


class Plain:
    """An object that is made without a call."""

    def __init__(self) -> None:
        self.__dict__.update(a=1)


class ByPersistentId(pickle.Pickler):
    def persistent_id(self, value: Any) -> Any:
        return ("os", "system") if value == "me" else None


def persistent(protocol: int) -> bytes:
    stream = io.BytesIO()
    ByPersistentId(stream, protocol).dump(["me"])
    return stream.getvalue()


def by_extension() -> bytes:
    copyreg.add_extension("builtins", "eval", 240)
    try:
        return pickle.dumps(Call(eval, "1"), 2)
    finally:
        copyreg.remove_extension("builtins", "eval", 240)


def array_with(*state: Any, start: bytes = b"cnumpy.core.multiarray\n_reconstruct\n") -> bytes:
    """An array that is filled with this state."""
    stream = io.BytesIO()
    stream.write(b"\x80\x04" + start + b"cnumpy\nndarray\nK\x00\x85C\x01b\x87R")
    stream.write(pickle.dumps(state, 4)[2:-1])
    stream.write(b"b.")
    return stream.getvalue()


TYPE_F8 = b"cnumpy\ndtype\nX\x02\x00\x00\x00f8\x89\x88\x87R"


def array_of_bytes(data: bytes, shape: bytes, kind: bytes = TYPE_F8) -> bytes:
    """An array in the form of protocol 5, with these opcodes for its parts."""
    return b"\x80\x05cnumpy._core.numeric\n_frombuffer\n(" + data + kind + shape + b"X\x01\x00\x00\x00CtR."


def typed(code: str) -> bytes:
    letters = code.encode()
    return b"cnumpy\ndtype\nX" + struct.pack("<I", len(letters)) + letters + b"\x89\x88\x87R"


def copies() -> bytes:
    """16 MiB of text, encoded a thousand times."""
    text = b"X" + struct.pack("<I", 1 << 24) + b"x" * (1 << 24) + b"q\x00"
    call = b"c_codecs\nencode\nh\x00X\x06\x00\x00\x00latin1\x86R"
    return b"\x80\x02" + text + b"0]q\x01(" + call * 1000 + b"e."


def nested_lists(depth: int) -> bytes:
    """Lists in lists, which only `array_of` would follow."""
    return b"\x80\x02" + b"]" * depth + b"a" * (depth - 1) + b"."


def evil(marker: Path) -> dict[str, tuple[bytes, str]]:
    command = f"touch {marker}"
    calls = f"__import__('os').system({command!r})"
    old = f"(S{command!r}\nios\nsystem\n.".encode()
    new = b"\x80\x02cos\nsystem\n" + pickle.dumps((command,), 2)[2:-1] + b"\x81."
    named = f"(cos\nsystem\nS{command!r}\no.".encode()
    eight = struct.pack("<Q", 1 << 40)
    return {
        "a command": (pickle.dumps(Call(os.system, command)), "it names posix.system, which is not read"),
        "a command in text": (pickle.dumps(Call(os.system, command), 0), "it names posix.system"),
        "eval": (pickle.dumps(Call(eval, calls)), r"it names builtins.eval"),
        "exec": (pickle.dumps(Call(exec, calls), 2), r"it names (__builtin__|builtins).exec"),
        "numpy.load": (pickle.dumps(Call(np.load, str(marker))), "it names numpy"),
        "getattr": (pickle.dumps(Call(builtins.getattr, "a", "upper")),
                    "it names builtins.getattr"),
        "an attribute of a known name": (b"\x80\x04\x8c\x05numpy\x8c\x0cndarray.dump\x93.", "names numpy.ndarray.dump"),
        "a name of many lines": (b"\x80\x04\x8c\x08a\nb\x1b[1mc\x8c\x01d\x93.", "it names a b.*c.d, which is not read"),
        "an extension": (by_extension(), "KeyError"),
        "a persistent id": (persistent(4), "KeyError"),
        "a persistent id in text": (b"Pme\n.", "KeyError"),
        "INST": (old, "KeyError"),
        "OBJ": (named, "it names os.system"),
        "OBJ of a known name": (b"(cnumpy\nndarray\no.", "KeyError"),
        "NEWOBJ": (new, "it names os.system"),
        "NEWOBJ of a known name": (b"\x80\x02cnumpy\nndarray\n)\x81.", "KeyError"),
        "NEWOBJ_EX": (b"\x80\x04cnumpy\nndarray\n)}\x92.", "KeyError"),
        "an object of a class": (pickle.dumps(Plain()), "it names .*Plain"),
        "an ordered dict": (pickle.dumps(OrderedDict(a=1)), "it names collections.OrderedDict"),
        "an array of objects": (pickle.dumps(np.array([Call(os.system, command)], dtype=object)), "it (names|has)"),
        "an array of records": (pickle.dumps(np.zeros(2, dtype="f8,i4")), "arrays of objects, expected numbers"),
        "an array of times": (pickle.dumps(np.array(["2020-01-01"], dtype="M8[D]")), "arrays of objects"),
        "a type without a code": (b"\x80\x02cnumpy\ndtype\nN\x85R.", "arrays of objects, expected numbers"),
        "a call of a text": (b"\x80\x02X\x01\x00\x00\x00a)R.", "it calls an object that is not a function"),
        "a call of an array": (pickle.dumps(np.arange(3.0), 5)[:-1] + b")R.", "."),
        "BUILD of a dict": (b"\x80\x02}}b.", "it changes an object that is not an array"),
        "BUILD of a function": (b"\x80\x02cnumpy\nndarray\n}b.", "it changes an object that is not an array"),
        "BUILD with a dict": (b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n)R}b.", "."),
        "a type of a type": (b"\x80\x02cnumpy\ndtype\ncnumpy\nndarray\n\x85R.", "arrays of objects"),
        "a wrong shape": (array_of_bytes(b"C\x08" + bytes(8), b"K\x02\x85"), "cannot reshape"),
        "a negative shape": (array_of_bytes(b"C\x08" + bytes(8), b"J\xff\xff\xff\xffJ\xff\xff\xff\xff\x86"), "unknown"),
        "a shape of words": (array_of_bytes(b"C\x08" + bytes(8), b"X\x01\x00\x00\x00a\x85"), "invalid literal"),
        "a huge shape": (array_of_bytes(b"C\x00", b"\x8a\x07" + b"\xff" * 6 + b"\x7f\x85"), "cannot reshape"),
        "a shape beyond integers": (array_of_bytes(b"C\x00", b"\x8a\x10" + b"\x7f" * 16 + b"\x85"), "."),
        "many dimensions": (array_of_bytes(b"C\x08" + bytes(8), b"(" + b"K\x01" * 9 + b"t"), "of another form"),
        "a length in place of bytes": (array_of_bytes(b"\x8a\x06" + b"\x7f" * 6, b"K\x01\x85"), "of another form"),
        "a list in place of bytes": (array_of_bytes(b"]", b"K\x00\x85"), "of another form"),
        "bytes of another length": (array_of_bytes(b"C\x07" + bytes(7), b"K\x01\x85"), "must be a multiple"),
        "huge letters": (array_of_bytes(b"C\x00", b"K\x01\x85", typed("U1000000000")), "."),
        "objects by their letter": (array_of_bytes(b"C\x08" + bytes(8), b"K\x01\x85", typed("O")), "arrays of objects"),
        "many fields": (array_of_bytes(b"C\x08" + bytes(8), b"K\x01\x85", typed("f8," * 50)), "arrays of objects"),
        "another encoding": (b"\x80\x02c_codecs\nencode\nX\x01\x00\x00\x00aX\x05\x00\x00\x00rot13\x86R.", "encoding"),
        "a buffer outside": (b"\x80\x05\x97.", "KeyError"),
        "bytes without end": (b"\x80\x05\x96" + eight + b"x.", "."),
        "words without end": (b"\x80\x04\x8d" + eight + b"x.", "."),
        "a frame without end": (b"\x80\x04\x95" + eight + b"x.", "."),
        "an integer without end": (b"\x80\x02\x8b\xff\xff\xff\x00" + b"\x7f" * 99, "KeyError"),
        "digits without end": (b"L" + b"9" * 10_000 + b"L\n.", "Exceeds the limit"),
        "copies of a text": (copies(), "it unpacks to more than 256 MiB"),
        "another protocol": (b"\x80\x09N.", "unsupported pickle protocol: 9"),
        "nothing": (b"", "EOFError"),
        "no pickle": (b"PK\x03\x04 a zip file", "."),
        "JSON": (b'{"log": {}}', "KeyError"),
        "cut off": (pickle.dumps(av2())[:-100], "."),
        "cut off in a number": (pickle.dumps(av2(), 2)[:120], "."),
        "no memo": (b"h\x05.", "."),
        "an empty stack": (b"\x80\x020000.", "."),
        "a dict of lists": (b"\x80\x02}]Ns.", "TypeError"),
        "items of an array": (b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n)RNNs.", "TypeError"),
        "a filled array": (array_with(1, (2,), None, False, b"x" * 16), "."),
        "four parts of a state": (array_with(1, (2,), None, False), "."),
    }  # fmt: skip


@pytest.mark.parametrize("case", evil(Path("x")))
def test_a_hostile_pickle_is_one_error_and_runs_nothing(case: str, tmp_path: Path) -> None:
    content, message = evil(tmp_path / MARKER)[case]
    with pytest.raises(DataError, match=message) as caught:
        read_pickle(written(tmp_path, content))
    text = str(caught.value)
    assert str(tmp_path / "f.pkl") in text
    assert "\n" not in text
    assert "\x1b" not in text
    assert len(text) < 500
    assert not (tmp_path / MARKER).exists()


def test_the_marker_would_be_seen(tmp_path: Path) -> None:
    content, _ = evil(tmp_path / MARKER)["a command"]
    pickle.loads(content)
    assert (tmp_path / MARKER).exists()


@pytest.mark.parametrize(
    "case", ["bytes without end", "copies of a text", "huge letters", "a length in place of bytes"]
)
def test_a_bomb_takes_no_memory(case: str, tmp_path: Path) -> None:
    content, _ = evil(tmp_path / MARKER)[case]
    path = written(tmp_path, content)
    program = f"""
        import resource
        from pathlib import Path
        from mtp_bench.core import DataError
        from mtp_bench.sources import restricted_pickle
        resource.setrlimit(resource.RLIMIT_AS, ({2 << 30}, {2 << 30}))
        try:
            restricted_pickle.read_pickle(Path({str(path)!r}))
        except DataError as error:
            status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
            print("MemoryError" in str(error), int(status["VmHWM"].split()[0]) >> 10)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, check=True)
    is_out_of_memory, megabytes = done.stdout.split()
    assert is_out_of_memory == "False"
    assert int(megabytes) < 450


def test_deep_lists_are_read_and_never_followed(tmp_path: Path) -> None:
    value = read_pickle(written(tmp_path, nested_lists(100_000)))
    with pytest.raises(DataError, match=r"here: numbers of shape \(0,\), expected \(2,\)"):
        array_of(value, (2,), "here")


def test_a_list_that_holds_itself(tmp_path: Path) -> None:
    value = read_pickle(written(tmp_path, b"\x80\x02]q\x00h\x00a."))
    assert value[0] is value
    with pytest.raises(DataError, match="expected"):
        array_of(value, (1,), "here")


def test_a_huge_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restricted_pickle, "MAX_BYTES", 1 << 20)
    with pytest.raises(DataError, match="it is above 1 MiB, the limit"):
        read_pickle(written(tmp_path, b"x" * ((1 << 20) + 1)))


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo])
def test_a_path_that_is_no_file(make: Callable[[Path], object], tmp_path: Path) -> None:
    make(tmp_path / "f.pkl")
    with pytest.raises(DataError, match=r"f\.pkl cannot be read"):
        read_pickle(tmp_path / "f.pkl")


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no file .*f\.pkl"):
        read_pickle(tmp_path / "f.pkl")


VALUES: dict[str, tuple[Any, str]] = {
    "a text": ("1.5", "here: str, expected numbers"),
    "texts": (["1.5"], r"shape \(0,\), expected \(1,\)"),
    "none": (None, "here: NoneType, expected numbers"),
    "a dict": ({}, "here: dict, expected numbers"),
    "a huge integer": ([10**400], "here: list, expected numbers"),
    "an array of words": (np.array(["1.5"]), "here: ndarray, expected numbers"),
    "a number for a list": (1.5, r"numbers of shape \(\), expected \(1,\)"),
    "complex numbers": (np.array([1j]), "here: ndarray, expected numbers"),
}


@pytest.mark.parametrize("case", VALUES)
def test_a_value_that_is_no_array_of_one_number(case: str) -> None:
    value, message = VALUES[case]
    with pytest.raises(DataError, match=message):
        array_of(value, (1,), "here")
