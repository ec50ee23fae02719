"""Messages between the judge and an agent: a JSON header and the bytes of arrays, without pickle.

A message is 4 bytes (length of the header), 8 bytes (length of the body), the header,
the body; lengths are little-endian. The header holds fields by the kind of message and,
under "arrays", name, dtype and shape of each array.
"""

import json
import math
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

PREFIX = struct.Struct("<IQ")
HEADER_LIMIT = 1 << 16  # bytes
_MAX_ARRAYS = 64
_MAX_EMPTY_AXIS = 1 << 30  # of an array without entries
_MAX_AXES = 8
_MAX_AXIS = 1 << 40
_MAX_NAME = 80  # characters of a name in an error text
DTYPES = frozenset(
    ["|b1", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f2", "<f4", "<f8"]
)
UNUSABLE = ""  # dtype of a field that is not an array of numbers

Arrays = Mapping[str, NDArray[Any]]


class WireError(Exception):
    """A malformed message."""


def encode(
    header: dict[str, Any], arrays: Mapping[str, NDArray[Any] | None] | None = None
) -> bytes:
    """Return a message as one block of bytes.

    None stands for an array that cannot be used.
    """
    entries: list[tuple[str, str, tuple[int, ...]]] = []
    body: list[memoryview] = []
    for name, value in (arrays or {}).items():
        if value is None:
            entries.append((name, UNUSABLE, ()))
            continue
        entries.append((name, value.dtype.str, value.shape))
        body.append(np.ascontiguousarray(value).data)
    text = json.dumps({**header, "arrays": entries}, allow_nan=False).encode()
    size = sum(part.nbytes for part in body)
    return b"".join((PREFIX.pack(len(text), size), text, *body))


def header_of(text: bytes | bytearray | memoryview) -> dict[str, Any]:
    """Return the header of a message.

    Raise WireError unless it is a JSON object.
    """
    try:
        header = json.loads(bytes(text))
    except (ValueError, RecursionError):
        raise WireError("the header is not JSON") from None
    if not isinstance(header, dict):
        raise WireError("the header is not a JSON object")
    return header


def arrays_of(
    header: dict[str, Any],
    body: bytes | bytearray | memoryview,
    expected: Mapping[str, tuple[int, ...]] | None = None,
) -> dict[str, NDArray[Any] | None]:
    """Return the writable arrays of a message.

    Arrays are views if the body is writable, otherwise copies. Raises WireError if
    header and body do not fit. With ``expected`` shapes, an array of another name or
    shape is replaced by None without allocating memory.
    """
    entries = header.get("arrays")
    if not isinstance(entries, list) or len(entries) > _MAX_ARRAYS:
        raise WireError("arrays is not a list, or too long")
    arrays: dict[str, NDArray[Any] | None] = {}
    offset = 0
    for entry in entries:
        name, dtype, shape = _entry(entry)
        if name in arrays:
            raise WireError(f"array {name[:_MAX_NAME]!r} comes twice")
        size = 0 if dtype == UNUSABLE else math.prod(shape) * np.dtype(dtype).itemsize
        if size > len(body) - offset:
            raise WireError(f"array {name[:_MAX_NAME]!r} is longer than the message")
        arrays[name] = None
        fits = expected is None or expected.get(name) == shape
        if fits and dtype != UNUSABLE:
            arrays[name] = _array(body, dtype, shape, offset)
        offset += size
    if offset != len(body):
        raise WireError("the message is longer than its arrays")
    return arrays


def _array(
    body: bytes | bytearray | memoryview,
    dtype: str,
    shape: tuple[int, ...],
    offset: int,
) -> NDArray[Any]:
    count = math.prod(shape)
    if count == 0:  # a shape such as [2**39, 0, 2**39] is too large for numpy
        if any(size >= _MAX_EMPTY_AXIS for size in shape):
            raise WireError("an empty array of a huge shape")
        return np.zeros(shape, dtype)
    array = np.frombuffer(body, dtype, count, offset).reshape(shape)
    if array.flags.writeable and array.flags.aligned:
        return array
    return array.copy()


def _entry(entry: Any) -> tuple[str, str, tuple[int, ...]]:
    """Return name, dtype and shape of an entry of a header, or raise WireError."""
    match entry:
        case [str(name), str(dtype), list(shape)] if (
            (dtype in DTYPES or dtype == UNUSABLE)
            and len(shape) <= _MAX_AXES
            and all(type(size) is int and 0 <= size < _MAX_AXIS for size in shape)
        ):
            return name, dtype, tuple(shape)
    raise WireError(f"an array entry is {str(entry)[:_MAX_NAME]}")


def as_numbers(value: object) -> NDArray[Any] | None:
    """Return ``value`` as an array of numbers, else None.

    Never raises, whatever object of an agent it is.
    """
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiub":
            return None
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        if array.dtype.str not in DTYPES:
            array = array.astype(np.float64)
        return array
    except Exception:
        return None
