"""A reader of pickles that hold plain values and NumPy arrays, and runs nothing else.

`pickle.load` calls whatever a file names. Here a file can name the few functions of
`_KNOWN` alone, which make arrays of numbers; any other name, and any other way to
make an object, is an error. The judge does not import this module.
"""

import io
import pickle
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..core import DataError, clean_text, open_regular
from .text import reading

MAX_BYTES = 1 << 28  # of a file, and of what its calls are given
_MAX_DIMENSIONS = 8
_NUMBERS = "?bhilqBHILQefd"  # types of numbers, in NumPy's letters
# what makes objects in other ways than by a call of `_KNOWN`, and endless integers
_REFUSED = [
    getattr(pickle, name)[0]
    for name in [
        "BINPERSID",
        "EXT1",
        "EXT2",
        "EXT4",
        "INST",
        "LONG4",
        "NEWOBJ",
        "NEWOBJ_EX",
        "NEXT_BUFFER",
        "OBJ",
        "PERSID",
    ]
]


class _Array:
    """An array whose content follows, as NumPy stores it."""

    values: NDArray[Any] | None = None


class _Type:
    """A type of numbers or words."""

    def __init__(self, code: str) -> None:
        if not isinstance(code, str) or np.dtype(code).char not in f"{_NUMBERS}US":
            raise ValueError("it has arrays of objects, expected numbers")
        self.dtype = np.dtype(code)


def _numbers_of(data: Any, kind: _Type, shape: Any, order: Any = "C") -> NDArray[Any]:
    """Return the array that bytes hold, which it does not copy."""
    if not isinstance(data, bytes) or len(shape) > _MAX_DIMENSIONS:
        raise ValueError("it has an array of another form than NumPy's")
    values = np.frombuffer(data, dtype=kind.dtype)
    return values.reshape(tuple(map(int, shape)), order="F" if order == "F" else "C")


def _scalar_of(kind: _Type, data: Any) -> Any:
    return _numbers_of(data, kind, ()).item()


def _encoded(text: str, encoding: str) -> bytes:
    if encoding != "latin1":
        raise ValueError("it has a text in another encoding than latin1")
    return text.encode("latin1")


_KNOWN: dict[tuple[str, str], Callable[..., Any]] = {
    ("numpy", "ndarray"): lambda: None,
    ("numpy", "dtype"): lambda code, *flags: _Type(code),
    ("_codecs", "encode"): _encoded,
    ("__builtin__", "bytes"): lambda: b"",
    ("numpy._core.multiarray", "_reconstruct"): lambda *_: _Array(),
    ("numpy._core.multiarray", "scalar"): _scalar_of,
    ("numpy._core.numeric", "_frombuffer"): _numbers_of,
}


def _append_list(reader: Any, size: int) -> None:
    """Make a list of the last values, in place of a tuple.

    A list cannot be a key: the hash of tuples in tuples may never end.
    """
    reader.stack[-size:] = [reader.stack[-size:]]


# the unpickler in Python, whose steps can be replaced one by one
_Unpickler: Any = pickle._Unpickler


class _Reader(_Unpickler):  # type: ignore[misc]
    """Unpickler that calls the functions of `_KNOWN` alone."""

    dispatch: ClassVar = {
        code: step for code, step in _Unpickler.dispatch.items() if code not in _REFUSED
    }
    bytes_left = MAX_BYTES

    def find_class(self, module: str, name: str) -> Callable[..., Any]:
        """Return a function of `_KNOWN`."""
        # as NumPy 2 calls it
        key = (module.replace("numpy.core.", "numpy._core."), name)
        if key not in _KNOWN:
            raise ValueError(f"it names {module}.{name}, which is not read")
        return _KNOWN[key]

    def load_reduce(self) -> None:
        """Call a function that the file named."""
        arguments = self.stack.pop()
        function = self.stack[-1]
        if function not in _KNOWN.values():
            raise ValueError("it calls an object that is not a function")
        # a short file can give the same bytes to many calls
        texts = [value for value in arguments if isinstance(value, str | bytes)]
        self.bytes_left -= sum(map(len, texts))
        if self.bytes_left < 0:
            raise ValueError(f"it unpacks to more than {MAX_BYTES >> 20} MiB")
        self.stack[-1] = function(*arguments)

    def load_build(self) -> None:
        """Fill an array, or set the byte order of a type."""
        state = self.stack.pop()
        target = self.stack[-1]
        if isinstance(target, _Array):
            _, shape, kind, is_fortran, data = state
            order = "F" if is_fortran else "C"
            target.values = _numbers_of(data, kind, shape, order)
        elif isinstance(target, _Type):
            if state[1] in ("<", ">"):
                target.dtype = target.dtype.newbyteorder(state[1])
        else:
            raise ValueError("it changes an object that is not an array")

    def load_bytearray8(self) -> None:
        """Read bytes; the one of `pickle` makes room for any length that is stated."""
        (length,) = struct.unpack("<Q", self.read(8))
        self.append(self.read(length))

    for name, size in {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}.items():
        dispatch[getattr(pickle, name)[0]] = partial(_append_list, size=size)
    dispatch[pickle.TUPLE[0]] = dispatch[pickle.LIST[0]]
    dispatch[pickle.REDUCE[0]] = load_reduce
    dispatch[pickle.BUILD[0]] = load_build
    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8


def read_pickle(path: Path) -> Any:
    """Return the content of a pickle: dicts, lists, texts, numbers and `array_of` them.

    Raises DataError for a file that is missing, broken, too large or names other code.
    """
    with reading(path, "a pickle of arrays of numbers"):
        with open_regular(path) as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise ValueError(f"it is above {MAX_BYTES >> 20} MiB, the limit")
        try:
            return _Reader(io.BytesIO(content)).load()
        except Exception as error:  # whatever a broken or hostile file makes it raise
            text = f"{type(error).__name__}: {error}"
            raise ValueError(clean_text(text, 200)) from None


def array_of(value: Any, shape: tuple[int, ...], where: str) -> NDArray[np.float64]:
    """Return a value of `read_pickle` as numbers of ``shape``, -1 for any length.

    It is an array, a number or a flat list of numbers. Raises DataError that names
    ``where``.
    """
    content = value.values if isinstance(value, _Array) else value
    if isinstance(content, list | tuple):
        # no list of lists: a small pickle could hold one that never ends
        content = [item for item in content if isinstance(item, float | int)]
    try:
        array = np.array(content)
        if array.dtype.char not in _NUMBERS:
            raise ValueError
    except (ValueError, OverflowError):
        raise DataError(
            f"{where}: {type(content).__name__}, expected numbers"
        ) from None
    sizes = zip(array.shape, shape, strict=False)
    fits = all(expected in (-1, size) for size, expected in sizes)
    if array.ndim != len(shape) or not fits:
        raise DataError(
            f"{where}: numbers of shape {array.shape}, expected {shape}, where -1 is "
            "any length"
        )
    return array.astype(np.float64)
