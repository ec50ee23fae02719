"""The court that hostile agents stand before."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.hostile import Court


@pytest.fixture
def court(card: str, kitti: str, tmp_path: Path) -> Court:
    return Court(card, kitti, tmp_path)
