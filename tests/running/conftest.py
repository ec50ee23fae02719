"""The small card as one that ships."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.command_line import ship


@pytest.fixture
def shipped(tmp_path: Path, repository: Path, card: str) -> Iterator[str]:
    """Id of the small card, which ships with a bundle of its own, without frozen event weights."""
    patch = ship(tmp_path / "bundle", repository, card)
    yield Path(card).stem
    patch.undo()
