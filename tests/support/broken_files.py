"""Files of which one byte is another one, and NPZ files with the head of an array cut short."""

import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

MASKS = (0xFF, 1, 4, 0x80)  # what a byte is changed by: one bit, or all


def flips(path: Path, most: int = 10**9) -> Iterator[int]:
    """The places of bytes, at most ``most`` and evenly spread: while each is told, that byte is another one."""
    content = path.read_bytes()
    for place in range(0, len(content), -(-len(content) // most)):
        changed = bytearray(content)
        changed[place] ^= MASKS[place % len(MASKS)]
        path.write_bytes(changed)
        yield place
    path.write_bytes(content)


def cut_head(path: Path, array: str) -> None:
    """Let the head of an array in an NPZ file end before its brackets do."""
    with zipfile.ZipFile(path) as stored:
        files = {name: stored.read(name) for name in stored.namelist()}
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3,\n"
    files[f"{array}.npy"] = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head
    with zipfile.ZipFile(path, "w") as stored:
        for name, content in files.items():
            stored.writestr(name, content)
