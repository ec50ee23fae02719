"""The court that hostile agents stand before."""

from pathlib import Path

import pytest

from mtp_bench.running.playing import compile_kernels
from tests.support.hostile import Court


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Else every fork server compiles all kernels for itself."""
    compile_kernels()


@pytest.fixture
def court(card: str, kitti: str, tmp_path: Path, hostile: Path) -> Court:
    return Court(card, kitti, tmp_path, hostile)
