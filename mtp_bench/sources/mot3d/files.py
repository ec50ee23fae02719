"""Files of 3DMOT2015, read into arrays: ``seqinfo.ini``, and the rows of ``gt.txt`` and ``det.txt``."""

from __future__ import annotations

import configparser
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from ...errors import DataError, MissingDataError
from ...types import Floats, Ints
from ..text import RowTable, read_table, read_text

SEQINFO, TRUTH, DETECTIONS = "seqinfo.ini", "gt/gt.txt", "det/det.txt"  # inside train/<sequence>
COLUMNS = "frame id left top width height confidence X Y Z"


class SequenceInfo(msgspec.Struct, frozen=True):
    """Content of the section [Sequence] of ``seqinfo.ini``."""

    rate: Annotated[float, msgspec.Meta(gt=0, le=1e6)] = msgspec.field(name="frameRate")  # Hz
    length: Annotated[int, msgspec.Meta(gt=0, le=10**6)] = msgspec.field(name="seqLength")  # frames


KNOWN = {"PETS09-S2L1": SequenceInfo(7.0, 795), "TUD-Stadtmitte": SequenceInfo(25.0, 179)}  # for a lost seqinfo.ini


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of ``gt.txt`` or ``det.txt`` in the order of the file."""

    table: RowTable
    frame: Ints  # [R] from 1
    object_id: Ints  # [R] -1 for detections
    confidence: Floats  # [R] detections: score; truth: 0 = not to be evaluated
    ground: Floats  # [R, 3] m, X Y Z of the foot point


def read_sequence_info(path: Path) -> SequenceInfo:
    """Frame rate and number of frames; DataError names the key that is missing or wrong."""
    sequence = path.parent.name
    if not path.is_file() and sequence in KNOWN:
        known = KNOWN[sequence]
        raise MissingDataError(
            f"no file {path}; some copies come without it: write it with the lines '[Sequence]', 'name={sequence}', "
            f"'frameRate={known.rate:g}' and 'seqLength={known.length}'"
        )
    parser = configparser.RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment, method-assign]  # keys keep their capitals
    try:
        parser.read_string(read_text(path), source=str(path))
        return msgspec.convert(dict(parser.items("Sequence")), SequenceInfo, strict=False)
    except (configparser.Error, msgspec.ValidationError) as error:
        raise DataError(f"{path} cannot be read: {' '.join(str(error).split())}") from None


def read_truth(path: Path, length: int) -> Rows:
    """True rows of a sequence of ``length`` frames; DataError names the line that is wrong."""
    rows = _read_rows(path, length)
    rows.table.refuse_second_box(rows.frame, rows.object_id, np.arange(len(rows.frame)))
    return rows


def read_detections(path: Path, length: int) -> Rows:
    """Detections in a sequence of ``length`` frames; DataError names the line that is wrong.

    Detections of the 2D benchmark have sequences of the same names, but X = Y = Z = -1 everywhere: DataError says so.
    """
    rows = _read_rows(path, length)
    if len(rows.frame) and (rows.ground == -1).all():
        raise DataError(
            f"{path}: X, Y and Z are -1 in every row, as in the 2D benchmark (2DMOT2015); expected the file of "
            "3D MOT 2015, https://motchallenge.net/data/3D_MOT_2015"
        )
    return rows


def _read_rows(path: Path, length: int) -> Rows:
    """The rows of either file, whose frames lie in the sequence; an empty file gives no rows."""
    table = read_table(path, COLUMNS, ",")
    table.refuse_not_finite(COLUMNS)
    frame = table.whole("frame")
    outside = (frame < 1) | (frame > length)
    table.refuse(outside, lambda row: f"frame {frame[row]}, expected 1 to {length}, the seqLength of {SEQINFO}")
    return Rows(table, frame, table.whole("id"), table["confidence"], table.matrix("X Y Z"))
