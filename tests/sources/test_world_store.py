"""Generated worlds on disk, and the scenes that are cut from them."""

import os
import stat
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from mtp_bench.cards import Card
from mtp_bench.core import Floats, Lane
from mtp_bench.core.errors import DataError
from mtp_bench.core.files import CACHE_VARIABLE
from mtp_bench.sources import describe, open_source, prepare
from mtp_bench.sources.base import section_of
from mtp_bench.sources.cache import content_hash
from mtp_bench.traffic.highway import simulate
from mtp_bench.traffic.highway.source import WorldStore, _simulate, ever_seen, pack, traffic_of, unpack
from mtp_bench.traffic.highway.world import CLASSES, SECRET_SEEDS, HighwaySource, Traffic, World
from tests.support.detector_scenes import grid_truth
from tests.support.source_files import card_of

FRAMES = 80  # 8 s at 10 Hz
TRAFFIC = Traffic("intersection", "ego", FRAMES / 10, 5, 1)


def world(seed: int, traffic: Traffic = TRAFFIC) -> World:
    """A car ahead of a still ego, a truck far away and a pedestrian, all walking along x; ``seed`` shifts them."""
    box = np.zeros((FRAMES, 3, 7))
    box[..., 0] = np.array([10.0, 300.0, 20.0]) + np.arange(FRAMES)[:, None] * 0.1
    box[..., 1] = 0.01 * seed
    box[..., 4:] = (4.0, 2.0, 1.5)
    kind = np.array([CLASSES.index(name) for name in ("car", "truck", "pedestrian")])
    truth = grid_truth(box, np.tile([1.0, 0.0], (3, 1)), kind, np.array([4, 7, 9]))
    lanes = (Lane(line(0, 0), line(0, 2), line(0, -2), (1,)), Lane(line(10, 0), line(10, 2), line(10, -2)))
    return World(np.arange(FRAMES) / 10, np.zeros((FRAMES, 4)), truth, lanes)


def line(x: float, y: float) -> Floats:
    """Ten metres along x."""
    return np.array([[x, y], [x + 10.0, y]])


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[int]:
    """Seeds that were simulated; the simulation is replaced and the cache is empty."""
    seeds: list[int] = []

    def simulate_world(traffic: Traffic, seed: int) -> World:
        seeds.append(seed)
        return world(seed, traffic)

    monkeypatch.setattr(simulate, "simulate_world", simulate_world)
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return seeds


def card(classes: Sequence[str] = CLASSES, rate: float = 2.0) -> Card:
    """Three scenes of 8 s in the validation split."""
    seeds = {"train": [0, 2], "val": [5, 8], "test": [9, 10]}
    return card_of("MTP-Intersection-v0", classes, rate, seconds=8.0, seeds=seeds)


def same(a: World, b: World) -> bool:
    return content_hash(pack(a)) == content_hash(pack(b))


def test_a_world_is_made_once_and_survives_packing(made: list[int]) -> None:
    store = WorldStore(TRAFFIC, _simulate)
    assert store.read(5) is None
    first = store.get(5)
    assert same(WorldStore(TRAFFIC, _simulate).get(5), first)
    assert (made, first.visible.shape) == ([5], (3 * FRAMES,))
    read = unpack(pack(first))
    assert same(first, read)
    assert [lane.following for lane in read.lanes] == [(1,), ()]
    np.testing.assert_array_equal(read.truth.box, first.truth.box)


def bytes_in_the_middle(path: Path) -> None:
    content = bytearray(path.read_bytes())
    for at in range(len(content) // 10, len(content) - 2000, 97):  # the directory at the end stays whole
        content[at] ^= 0xFF
    path.write_bytes(bytes(content))


def another_value(path: Path) -> None:
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["box"][0, 0] += 1e-6
    np.savez(path, **arrays)


def in_its_place(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def replace_file(path: Path) -> None:
        path.unlink()
        make(path)

    return replace_file


DAMAGE: dict[str, Callable[[Path], object]] = {
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:-200]), "empty": lambda path: path.write_bytes(b""),
    "no archive": lambda path: path.write_text("not a zip file"), "bytes in the middle": bytes_in_the_middle,
    "another value": another_value, "a folder": in_its_place(lambda path: (path / "more").mkdir(parents=True)),
    "a pipe": in_its_place(os.mkfifo), "unreadable": lambda path: path.chmod(0),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_broken_files(damage: Callable[[Path], object], made: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    store, said = WorldStore(TRAFFIC, _simulate), list[str]()
    monkeypatch.setattr("mtp_bench.core.files.say_once", said.append)
    good = store.get(5)
    damage(store.path(5))
    if os.access(store.path(5), os.R_OK) and damage is DAMAGE["unreadable"]:
        pytest.skip("root reads every file")
    assert store.read(5) is None
    assert same(store.get(5), good)
    assert store.read(5) is not None
    assert (made, said) == ([5, 5], [f"{store.path(5)} was damaged and is made anew"])


def test_secret_worlds_lie_apart_and_nobody_else_lists_them() -> None:
    store = WorldStore(TRAFFIC, _simulate)
    store.get(5)
    shown = stat.S_IMODE(store.folder.stat().st_mode)
    store.keep_private()
    assert store.path(SECRET_SEEDS - 1).parent == store.folder
    assert store.path(SECRET_SEEDS).parent == store.secret_folder != store.folder
    assert stat.S_IMODE(store.secret_folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(store.folder.stat().st_mode) == shown


def test_many_scenes_are_not_generated_for_nothing(made: list[int], tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("in the way")
    with pytest.raises(DataError, match=r"generated scenes cannot be stored in .* set MTP_BENCH_CACHE to another"):
        prepare(card())
    assert made == []


def test_a_scene_is_cut_to_rate_reach_and_classes() -> None:
    """The truck is out of reach; pedestrians are not a class of this card."""
    source = open_source(card(classes=["truck", "car"]))
    assert source.names == ("intersection-000005", "intersection-000006", "intersection-000007")
    scene = source.load("intersection-000006")
    np.testing.assert_allclose(scene.time, np.arange(16) / 2)
    assert (scene.truth.object_id.tolist(), scene.truth.class_id.tolist()) == ([4] * 16, [1] * 16)
    np.testing.assert_allclose(scene.truth.box[:, :2], np.stack([10.0 + 0.5 * np.arange(16), np.full(16, 0.06)], 1))
    assert (scene.truth_complete, scene.detector) == (True, "nuscenes_megvii, simulated detections")
    assert (len(scene.lanes), len(scene.detections.start)) == (2, 17)


def test_an_object_is_a_target_once_it_has_been_in_view() -> None:
    scene = open_source(card()).load("intersection-000005")
    hidden = scene.truth.object_id == 9  # the pedestrian, who walks behind the car
    assert scene.visible is not None
    np.testing.assert_allclose(scene.visible, ~hidden)
    np.testing.assert_array_equal(scene.truth.eligible, ~hidden)
    rows = world(0).truth
    visible = np.ones(len(rows.box))
    visible[rows.object_id == 7] = 0.0
    pedestrian = np.flatnonzero(rows.object_id == 9)
    visible[pedestrian[:12]] = 0.04
    visible[pedestrian[20:]] = 0.0
    expected = rows.object_id == 4
    expected[pedestrian[12:]] = True  # what was seen stays known
    np.testing.assert_array_equal(ever_seen(rows, visible), expected)


def test_preparing_makes_what_is_missing_and_the_status_counts_it(made: list[int]) -> None:
    WorldStore(traffic_of(section_of(card(), HighwaySource)), _simulate).get(6)
    prepare(card(), scenes=2)
    assert made == [6, 5]
    status = describe(card())
    assert (status.usable, status.about.generated) == (True, True)
    assert status.notes[0].startswith("2 of 3 scenes are stored")
    prepare(card())
    assert made == [6, 5, 7]
