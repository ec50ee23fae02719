"""Rules that all sources share: their packages, roots, facts, and cards that do not fit."""

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from mtp_bench.cards import load_card
from mtp_bench.cards.source import SOURCES, source_class
from mtp_bench.core.bundle import card_ids
from mtp_bench.core.errors import CardError, DataError, UnknownNameError
from mtp_bench.sources import describe, open_source, package_of
from mtp_bench.sources.base import SourcePackage
from tests.support.drawn_recordings import small_recording
from tests.support.layouts import LAYOUTS
from tests.support.source_files import with_task

ROOTS: dict[str, tuple[str, tuple[str, ...], str]] = {  # layout, folders, where to get it
    "kitti": ("KITTI", ("kitti_tracking",), "cvlibs.net"),
    "mot3d": ("3DMOT2015", ("mot3d2015", "3DMOT2015"), "motchallenge.net"),
    "people": ("ETH/UCY", ("eth_ucy", "ETH_UCY"), "Trajectron-plus-plus"),
    "wildtrack": ("WILDTRACK", ("wildtrack", "Wildtrack_dataset"), "epfl.ch"),
    "argoverse2": ("Argoverse 2", ("argoverse2", "av2"), "argoverse.org"),
    "nuscenes": ("nuScenes", ("nuscenes",), "nuscenes.org"),
}


ROOMS = {"highway": "traffic", "gym": "traffic"}


@pytest.mark.parametrize("name", SOURCES)
def test_a_registered_source_has_a_section_and_a_package(name: str) -> None:
    assert "val" in source_class(name).splits
    assert isinstance(import_module(f"mtp_bench.{ROOMS.get(name, 'sources')}.{name}").PACKAGE, SourcePackage)


@pytest.mark.parametrize("name", ROOTS)
def test_roots(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A dataset lies in a folder of the data root, or the data root is that folder."""
    layout, folders, address = ROOTS[name]
    card = LAYOUTS[layout].card(tmp_path)
    missing = describe(card, tmp_path / "nothing")
    assert missing.searched == tuple(tmp_path / "nothing" / folder for folder in (*folders, ""))
    assert (missing.root, missing.usable, missing.missing) == (None, False, [])
    with pytest.raises(DataError, match=rf"(?s){folders[0]}.*given as data root.*{address}"):
        open_source(card, tmp_path / "nothing")
    root = LAYOUTS[layout].write(tmp_path, small_recording(LAYOUTS[layout]))
    names = open_source(card, root).names
    for folder in folders:
        root = root.rename(tmp_path / folder)
        assert open_source(card, tmp_path).names == names
    monkeypatch.setenv("MTP_BENCH_DATA", str(tmp_path))
    source = open_source(card)
    assert describe(card).usable
    with pytest.raises(UnknownNameError, match="unknown scene 'nowhere'"):
        source.load("nowhere")


@pytest.mark.parametrize("change", [{"classes": ("pedestrian", "cars")}, {"rate": 3.3}], ids=["class", "rate"])
@pytest.mark.parametrize("name", ROOTS)
def test_cards_that_do_not_fit(name: str, change: dict[str, Any], tmp_path: Path) -> None:
    layout = LAYOUTS[ROOTS[name][0]]
    root, card = layout.write(tmp_path, small_recording(layout)), layout.card(tmp_path)
    text = "has no class 'cars'" if "classes" in change else r"task\.rate is 3\.3 Hz, but .* has"
    with pytest.raises(CardError, match=text):
        open_source(with_task(card, **change), root)


@pytest.mark.parametrize("env_id", card_ids())
def test_facts_of_a_dataset_need_no_data(env_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MTP_BENCH_CACHE", str(tmp_path / "cache"))
    card = load_card(env_id)
    facts = package_of(card).dataset
    assert facts == describe(card, tmp_path / "data").about
    assert all((facts.name, facts.licence, facts.citation, facts.how_to_get))
