"""Folders that take long to make, of which the next run of the same checkout takes what the one before made."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

KEPT = "MTP_BENCH_TESTS_KEPT"  # names the folder; `.ci/run` sets it, whose runs follow each other at once


def kept(name: str, temporary: pytest.TempPathFactory, make: Callable[[Path], None]) -> Path:
    """The folder that ``make`` fills; where it fails, nothing is kept."""
    root = os.environ.get(KEPT)
    folder = Path(root) / name if root else temporary.mktemp(name)
    if root and folder.exists():
        return folder
    begun = folder.with_name(f"{name}.part")
    begun.mkdir()
    make(begun)
    return begun.replace(folder)
