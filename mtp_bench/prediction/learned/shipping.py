"""Packing of weights that ship: ``python -m mtp_bench.prediction.learned.shipping FILE...``.

Numbers keep 7 bits of the fraction, as in bfloat16, and the file is compressed, to two thirds of its size.
"""

from __future__ import annotations

import lzma
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import MtpBenchError
from ...files import write_bytes
from .registry import network_of
from .weights import PACKED, SHIPPED, packed_tensors, read_weights

FRACTION = 7  # bits
_DROPPED = 10 - FRACTION  # of the bits that half precision has
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 0, "lp": 1, "pb": 1}]  # pairs of bytes


def ship(file: Path, folder: Path = SHIPPED) -> Path:
    """Write the packed form of a file of weights into ``folder``; its path.

    Raises SubmissionError if ``file`` is not a file of weights, and MtpBenchError if the folder cannot be written.
    """
    stored = read_weights(file, network_of(file.name.split("-", 1)[0]))
    short = {name: rounded(value) for name, value in stored.weights.items()}
    packed = lzma.compress(packed_tensors(replace(stored, weights=short)), filters=_FILTERS)
    path = folder / f"{file.name.removesuffix(PACKED)}{PACKED}"
    write_bytes(path, packed)
    return path


def rounded(values: NDArray[np.floating]) -> NDArray[np.float16]:
    """The nearest numbers of half precision whose last three bits are 0, ties to even; finite ones stay finite."""
    bits = np.asarray(values, dtype=np.float16).view(np.uint16).astype(np.uint32)
    odd = (bits >> _DROPPED) & 1
    near = (bits + (1 << (_DROPPED - 1)) - 1 + odd) >> _DROPPED << _DROPPED
    down = bits >> _DROPPED << _DROPPED
    infinite = (near & 0x7C00) == 0x7C00
    return np.where(infinite, down, near).astype(np.uint16).view(np.float16)


if __name__ == "__main__":
    try:
        for name in sys.argv[1:]:
            print(ship(Path(name)))
    except MtpBenchError as error:
        sys.exit(f"error: {error}")
