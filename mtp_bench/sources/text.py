"""Text and JSON files of datasets; every error names the file and the place in it."""

import codecs
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from mmap import mmap
from pathlib import Path
from typing import Annotated, TypeVar

import msgspec

from ..core import DataError, MissingDataError, open_regular

# largest number in a file: far beyond metres, pixels, frames and identities
LIMIT = 1e9
Number = Annotated[float, msgspec.Meta(ge=-LIMIT, le=LIMIT)]
# a search for letters that come first is quick
_NAN = re.compile(rb'NaN(?<![\w"]NaN)(?![\w"])')
_INFINITY = re.compile(rb'Infinity(?<![\w"]Infinity)(?![\w"])')

ContentT = TypeVar("ContentT")


@contextmanager
def reading(path: Path, file_form: str) -> Iterator[None]:
    """Turn an error about a file into a DataError that names the file and its form."""
    from pyarrow import ArrowException

    file_errors = (
        OSError,
        ValueError,
        TypeError,
        LookupError,
        RecursionError,
        EOFError,
        zlib.error,
        msgspec.MsgspecError,
        ArrowException,
    )
    try:
        yield
    except FileNotFoundError:
        raise MissingDataError(f"no file {path}") from None
    except file_errors as error:
        problem = str(error).partition("\n")[0]
        raise DataError(f"{path} cannot be read as {file_form}: {problem}") from None


def read_text(path: Path) -> str:
    """Return the text of a file, without the byte order mark of some editors."""
    try:
        return _read_content(path).decode("utf-8")
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path} cannot be read as text: {error}; save it as UTF-8"
        ) from None


def _read_content(path: Path) -> bytes:
    try:
        with open_regular(path) as stream:
            return stream.read().removeprefix(codecs.BOM_UTF8)
    except FileNotFoundError:
        raise MissingDataError(f"no file {path}") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None


def read_json(path: Path, kind: type[ContentT]) -> ContentT:
    """Decode a JSON file as ``kind``.

    DataError names the place in the file. NaN, which official files have for unknown
    velocities, counts as null. Infinity becomes 1e300, which no number may be: the
    error about it then names the place.
    """
    return decode(as_json(_read_content(path)), kind, path)


def as_json(content: bytes) -> bytes:
    """Return JSON with null for NaN and 1e300 for Infinity, as in `read_json`."""
    return _INFINITY.sub(b"1e300", _NAN.sub(b"null", content))


def decode(
    content: bytes | mmap | msgspec.Raw, kind: type[ContentT], source: object
) -> ContentT:
    """Decode JSON as ``kind``.

    DataError names the ``source`` and the place in it.
    """
    try:
        return msgspec.json.decode(content, type=kind)
    except RecursionError:
        raise DataError(f"{source} cannot be read as JSON: nested too deeply") from None
    except msgspec.ValidationError as error:
        # msgspec says "Expected `int`, got `str` - at `$.key[0]`"
        problem, _, place = str(error).partition(" - at `$")
        problem = problem.replace("got `null`", "got null or NaN")
        where = f"{source}, {place.rstrip('`')}".removesuffix(", ")
        raise DataError(f"{where}: {problem[0].lower()}{problem[1:]}") from None
    except (msgspec.DecodeError, ValueError) as error:
        problem = f"{source} cannot be read as JSON: {error}"
        if "truncated" in str(error):
            problem += "; is the file cut off?"
        raise DataError(problem) from None
