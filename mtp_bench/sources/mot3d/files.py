"""Files of 3DMOT2015, read into arrays: the root, ``seqinfo.ini``, and the rows of ``gt.txt`` and ``det.txt``."""

from __future__ import annotations

import configparser
import math
import reprlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import DataError
from ...types import Bools, Floats, Ints
from ..roots import candidates

FOLDERS = ("mot3d2015", "3DMOT2015")  # the second is the folder of the official archive
SEQINFO, TRUTH, DETECTIONS = "seqinfo.ini", "gt/gt.txt", "det/det.txt"  # inside train/<sequence>
COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence", "X", "Y", "Z")
LIMIT = 1e9  # of any number in a row: far beyond metres, pixels and identities
LONGEST = 1e6  # frames of a sequence, and its frame rate in Hz
HOW_TO_GET = (
    f"download 3D MOT 2015 from https://motchallenge.net/data/3D_MOT_2015 and unpack it into {FOLDERS[0]}/ or "
    f"{FOLDERS[1]}/ of the data root; the images are not needed"
)


@dataclass(frozen=True)
class SequenceInfo:
    """What ``seqinfo.ini`` says of a sequence."""

    rate: float  # Hz
    length: int  # frames


# What a seqinfo.ini that was lost has to say.
KNOWN = {"PETS09-S2L1": SequenceInfo(7.0, 795), "TUD-Stadtmitte": SequenceInfo(25.0, 179)}


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of ``gt.txt`` or ``det.txt`` in the order of the file."""

    line: Ints  # [R] line in the file, from 1
    frame: Ints  # [R] from 1
    object_id: Ints  # [R] -1 for detections
    image_box: Floats  # [R, 4] left top width height, pixels
    confidence: Floats  # [R] detections: score; truth: 0 = not to be evaluated
    ground: Floats  # [R, 3] m, X Y Z of the foot point


def find_root(data: str | Path | None, sequence: str) -> Path:
    """The folder that holds ``train/<sequence>``: ``mot3d2015`` or ``3DMOT2015`` inside the data root, or the root.

    Raises DataError that names the folders looked at and the sequences that are there instead.
    """
    folders, origin = searched(data)
    for folder in folders:
        if (folder / "train" / sequence).is_dir():
            return folder
    found = sorted({name for folder in folders for name in KNOWN if (folder / "train" / name).is_dir()})
    raise DataError(
        f"no 3DMOT2015 data: train/{sequence} is in none of {', '.join(str(folder) for folder in folders)} ({origin})"
        + (f"; found there: {', '.join(found)}" if found else "")
        + f"; name another root with --data or MTP_BENCH_DATA, or get the data: {HOW_TO_GET}"
    )


def searched(data: str | Path | None) -> tuple[tuple[Path, ...], str]:
    """Folders in which the dataset may lie, best first; and where the data root's name comes from."""
    inside = [candidates(data, folder)[0][0] for folder in FOLDERS]
    (_, root), origin = candidates(data, FOLDERS[0])
    return (*inside, root), origin


def read_sequence_info(path: Path) -> SequenceInfo:
    """Frame rate and number of frames; DataError names the key that is missing or wrong."""
    sequence = path.parent.name
    if not path.is_file() and sequence in KNOWN:
        known = KNOWN[sequence]
        raise DataError(
            f"no file {path}; some copies come without it: write it with the lines '[Sequence]', 'name={sequence}', "
            f"'frameRate={known.rate:g}' and 'seqLength={known.length}'"
        )
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(_text(path), source=str(path))
    except configparser.Error as error:
        raise DataError(f"{path} cannot be read: {' '.join(str(error).split())}") from None
    rate, length = _number(path, parser, "frameRate"), _number(path, parser, "seqLength")
    if length != round(length):
        raise DataError(f"{path}: seqLength is {length:g}, expected a whole number of frames")
    return SequenceInfo(rate, int(length))


def read_truth(path: Path, length: int) -> Rows:
    """True rows of a sequence of ``length`` frames; DataError names the line that is wrong."""
    rows = _read_rows(path, length)
    order = np.lexsort((rows.frame, rows.object_id))
    frame, object_id = rows.frame[order], rows.object_id[order]
    twice = np.flatnonzero((frame[1:] == frame[:-1]) & (object_id[1:] == object_id[:-1]))
    if len(twice):
        at = order[twice + 1].min()
        raise DataError(
            f"{path}, line {rows.line[at]}: a second box of object {rows.object_id[at]} in frame {rows.frame[at]}"
        )
    return rows


def read_detections(path: Path, length: int) -> Rows:
    """Detections in a sequence of ``length`` frames; DataError names the line that is wrong.

    Detections of the 2D benchmark have sequences of the same names, but X = Y = Z = -1 everywhere: DataError says so.
    """
    rows = _read_rows(path, length)
    if len(rows.frame) and (rows.ground == -1).all():
        raise DataError(f"{path}: X, Y and Z are -1 in every row, as in the 2D benchmark (2DMOT2015); {HOW_TO_GET}")
    return rows


def _read_rows(path: Path, length: int) -> Rows:
    """Rows of either file; an empty file gives none."""
    lines = _text(path).splitlines()
    number = [n for n, line in enumerate(lines, 1) if line.strip()]
    value = np.array([_values(path, n, lines[n - 1]) for n in number]).reshape(-1, len(COLUMNS))
    line = np.array(number, dtype=np.int64)
    _refuse_fractions(path, line, value[:, 0], "frame")
    _refuse_fractions(path, line, value[:, 1], "id")
    outside = (value[:, 0] < 1) | (value[:, 0] > length)
    if outside.any():
        at = int(np.argmax(outside))
        raise DataError(
            f"{path}, line {line[at]}: frame {value[at, 0]:g}, expected 1 to {length}, the seqLength of {SEQINFO}"
        )
    frame, object_id = value[:, 0].astype(np.int64), value[:, 1].astype(np.int64)
    return Rows(line, frame, object_id, value[:, 2:6], value[:, 6], value[:, 7:])


def _values(path: Path, number: int, line: str) -> list[float]:
    """Numbers of one row, all finite."""
    cells = line.split(",")
    if len(cells) != len(COLUMNS):
        raise DataError(
            f"{path}, line {number}: {len(cells)} columns, expected {len(COLUMNS)} ({', '.join(COLUMNS)}): "
            "is the file cut off?"
        )
    return [_finite(path, number, name, cell) for name, cell in zip(COLUMNS, cells, strict=True)]


def _finite(path: Path, number: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not abs(value) <= LIMIT:  # NaN is not, either
        got = reprlib.repr(cell.strip())
        raise DataError(f"{path}, line {number}: {name} is {got}, expected a finite number up to {LIMIT:g}")
    return value


def _refuse_fractions(path: Path, line: Ints, value: Floats, what: str) -> None:
    bad: Bools = np.asarray(value != np.round(value))
    if bad.any():
        at = int(np.argmax(bad))
        raise DataError(f"{path}, line {line[at]}: {what} is {value[at]:g}, expected a whole number")


def _number(path: Path, parser: configparser.ConfigParser, key: str) -> float:
    """A key of the section [Sequence] as a number above 0 and up to `LONGEST`."""
    text = parser.get("Sequence", key, fallback=None)
    if text is None:
        raise DataError(f"{path}: no key {key!r} in the section [Sequence], expected e.g. '{key}=25'")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value <= LONGEST:
        raise DataError(f"{path}: {key} is {text!r}, expected a number above 0 and up to {LONGEST:g}")
    return value


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")  # some copies start with a byte order mark
    except FileNotFoundError:
        raise DataError(f"no file {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path} cannot be read as text: {error}") from None
