"""Every source that a card can name has a package of its name, which also says what it is and where it looked."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from mtp_bench._bundle import card_ids
from mtp_bench.cards import load_card
from mtp_bench.cards.source import SOURCES
from mtp_bench.sources import about, describe
from mtp_bench.sources.base import SourcePackage


@pytest.mark.parametrize("name", SOURCES)
def test_a_section_has_a_package(name: str) -> None:
    assert isinstance(import_module(f"mtp_bench.sources.{name}").PACKAGE, SourcePackage)


FOLDERS = {
    "MTP-KITTI-v0": ["kitti_tracking", ""],
    "MTP-nuScenes-v0": ["nuscenes", ""],
    "MTP-WILDTRACK-v0": ["wildtrack", "Wildtrack_dataset", ""],
    "MTP-PETS-v0": ["mot3d2015", "3DMOT2015", ""],
}


@pytest.mark.parametrize("env_id", FOLDERS)
def test_status_of_a_missing_root(env_id: str, tmp_path: Path) -> None:
    status = describe(load_card(env_id), tmp_path)
    assert status.searched == tuple(tmp_path / folder for folder in FOLDERS[env_id])
    assert (status.root, status.usable, status.missing) == (None, False, [])
    about = status.about
    assert all((about.layout, about.licence, about.citation, about.how_to_get))


@pytest.mark.parametrize("env_id", card_ids())
def test_what_is_known_of_a_dataset_needs_no_data(env_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "cache"))
    card = load_card(env_id)
    assert about(card) == describe(card, tmp_path / "data").about
