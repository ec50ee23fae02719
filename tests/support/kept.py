"""Folders that take long to make, of which the next run of the same checkout takes what the one before made."""

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

KEPT = "MTP_BENCH_TESTS_KEPT"  # names the folder; `.ci/run` sets it, whose runs follow each other at once


def kept(name: str, temporary: pytest.TempPathFactory, make: Callable[[Path], None]) -> Path:
    """The folder that ``make`` fills; where it fails, nothing is kept."""
    root = os.environ.get(KEPT)
    folder = (Path(root) if root else temporary.mktemp("kept")) / name
    if folder.exists():
        return folder
    begun = Path(tempfile.mkdtemp(dir=folder.parent))  # a new one: an earlier run may have failed half way
    make(begun)
    return begun.replace(folder)
