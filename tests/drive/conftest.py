"""A card of short drives."""

import pytest

from tests.support.small_scenes import write_short_card


@pytest.fixture(scope="session")
def drive_card(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write_short_card(tmp_path_factory.mktemp("card"), "MTP-Drive-Intersection-v0", 8.0)
