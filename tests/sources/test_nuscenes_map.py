"""The road of the map expansion: what is read of it and when, and that runs without lanes never depend on it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtp_bench import MTPEnv
from mtp_bench.cards.card import LaneSection
from mtp_bench.core import Lane
from mtp_bench.core.errors import DataError, MissingDataError
from mtp_bench.sources import describe, with_map
from mtp_bench.sources.base import HALF_LANE
from mtp_bench.sources.nuscenes import pictures
from mtp_bench.sources.nuscenes.pictures import read_lanes
from tests.support.command_line import CommandLine
from tests.support.nuscenes_root import VERSION, edited, nuscenes_card, scene, write_json

Record = dict[str, Any]
LOCATION = "boston-seaport"

# In the official layout, beside the way of an ego: from 40 m behind it to 20 m ahead run two lanes, "own" around it and
# "other" to its left, towards it. At the end of "own" a bend of 10 m turns left. "far", which follows it, lies 1 km away.
LAYERS = (
    "polygon", "line", "node", "drivable_area", "road_segment", "road_block", "lane", "lane_connector", "ped_crossing",
    "walkway", "stop_line", "carpark_area", "road_divider", "lane_divider", "traffic_light",
)  # fmt: skip


def make_map() -> Record:
    content: Record = {"version": "1.3", "canvas_edge": [2000.0, 2000.0], **{layer: [] for layer in LAYERS}}
    lines: dict[str, list[Record]] = {"bend": [path(20.0, 0.0, 0.0, "SLS", [2.0, 5 * np.pi, 3.0], 10.0)]}
    for token, ahead, left, turn, kind in (
        ("own", -40.0, 0.0, 0.0, "CAR"), ("other", 20.0, 4.0, np.pi, "CAR"), ("far", 1000.0, 0.0, 0.0, "CAR"),
        ("cycleway", -40.0, -4.0, 0.0, "BIKE"),
    ):  # fmt: skip
        edges = {"from_edge_line_token": "", "to_edge_line_token": "", "lane_type": kind}
        content["lane"].append({"token": token, "polygon_token": f"{token}-ring", **edges})
        halves = (ahead, "LSR"), (ahead + 30.0 * np.cos(turn), "RSL")
        lines[token] = [path(start, left, turn, shape, [0.0, 30.0, 0.0], 999.0) for start, shape in halves]
    content["lane_connector"].append({"token": "bend"})
    links = {"own": ([], ["bend"]), "bend": (["own"], ["nowhere", "far", "cycleway"])}
    connectivity = {token: {"incoming": before, "outgoing": after} for token, (before, after) in links.items()}
    return content | {"arcline_path_3": lines, "connectivity": connectivity}


def path(ahead: float, left: float, turn: float, shape: str, lengths: list[float], radius: float) -> Record:
    """A part of a middle line; the end, which the file has too, is not needed. The ego drives along y."""
    start = [-left, float(ahead), float(np.pi / 2 + turn)]
    return {"start_pose": start, "end_pose": start, "shape": shape, "radius": radius, "segment_length": lengths}


def write_map(data: Path, content: Record) -> Path:
    file = data / f"nuscenes/maps/expansion/{LOCATION}.json"
    write_json(file, content)
    return file


@pytest.fixture
def mapped(data: Path) -> Path:
    """The small root with a log that says where its scenes are, and a map of that place."""
    path = data / "nuscenes" / VERSION / "scene.json"
    with edited(path) as records:
        for record in records:
            record["log_token"] = "log-1"
    write_json(path.with_name("log.json"), [{"token": "log-1", "location": LOCATION}])
    write_map(data, make_map())
    return data


def drawn(data: Path, notes: list[str] | None = None) -> tuple[Lane, ...]:
    return with_map(scene(data), nuscenes_card(), data, ([] if notes is None else notes).append).lanes


def test_lanes_are_where_they_were_drawn(mapped: Path) -> None:
    own, other, bend = drawn(mapped)  # "far" is left out, as bicycles' lanes are everywhere
    assert [lane.following for lane in (own, other, bend)] == [(2,), (), ()]
    np.testing.assert_allclose(own.center[[0, -1]], [[0.0, -40.0], [0.0, 20.0]], atol=1e-9)
    np.testing.assert_allclose(own.left[:, 0], -HALF_LANE, atol=1e-9)  # the ego heads along y: left is -x
    np.testing.assert_allclose(own.right[:, 0], HALF_LANE, atol=1e-9)
    np.testing.assert_allclose(other.center[[0, -1]], [[-4.0, 20.0], [-4.0, -40.0]], atol=1e-9)
    np.testing.assert_allclose(other.left[:, 0], -4.0 + HALF_LANE, atol=1e-9)
    np.testing.assert_allclose(bend.center[-1], [-13.0, 32.0], atol=1e-9)  # 2 m on, a quarter of a circle, 3 m on
    assert (own.junction, other.junction, bend.junction) == (False, False, True)
    np.testing.assert_allclose(np.hypot(*(bend.left - bend.center).T), HALF_LANE)
    for lane in (own, other, bend):
        assert lane.left.shape == lane.right.shape == lane.center.shape
        assert 0.01 < np.hypot(*np.diff(lane.center, axis=0).T).max() <= pictures.MAX_STEP_M + 1e-9


def test_without_the_expansion_nothing_is_read(data: Path) -> None:
    notes: list[str] = []
    assert drawn(data, notes) == ()  # there is no log.json either
    assert not notes


def test_agents_see_the_lanes_and_what_continues_them(mapped: Path, cli: CommandLine) -> None:
    card = nuscenes_card().model_copy(update={"lanes": LaneSection()})
    seen, _ = MTPEnv(card, str(mapped)).reset()
    pieces = int((seen["lane_valid"].sum(axis=1) > 0).sum())
    assert pieces == 5  # two of 60 m in pieces of 38 m, and the bend
    ends = {i: seen["lane_point"][i][seen["lane_valid"][i] == 1][[0, -1]] for i in range(pieces)}
    links = [(i, int(j)) for i in range(pieces) for j in seen["lane_next"][i] if j >= 0]
    assert len(links) == 3  # from the first piece of either lane, and from "own" to the bend
    for i, j in links:
        np.testing.assert_allclose(ends[i][1], ends[j][0], atol=1e-4)
    whole = read_lanes(mapped / "nuscenes/maps/expansion" / f"{LOCATION}.json")
    assert [lane.following for lane in whole] == [(3,), (), (), (2,)]
    shutil.rmtree(mapped / "nuscenes/maps/expansion")
    with pytest.raises(
        MissingDataError, match=r"shows lanes, which come with the map expansion pack \(v1\.3\) of https"
    ):
        MTPEnv(card, str(mapped))
    assert any("shows lanes" in line for line in describe(card, mapped).missing)
    said = cli("submit", "stp", "--env", "MTP-nuScenes-Lanes-v0", "--data", mapped).err
    assert "lanes, by which an agent can recognise a recorded scene even after a random motion" in said


def changed(key: str, value: Any) -> Callable[[Record], Record]:
    return lambda content: {**content, key: value}


def arc(**changes: Any) -> Callable[[Record], Record]:
    def change(content: Record) -> Record:
        lines = content["arcline_path_3"]
        return {**content, "arcline_path_3": {**lines, "own": [{**lines["own"][0], **changes}]}}

    return change


BROKEN: dict[str, tuple[Callable[[Record], Record], str]] = {  # change, what the error names
    "no lanes": (lambda content: {"lane": []}, "no lane"),
    "no middle lines": (changed("arcline_path_3", {}), "no lane with a middle line"),
    "a list of middle lines": (changed("arcline_path_3", []), "arcline_path_3"),
    "a list of numbers": (changed("lane", [1, 2]), r"lane\[0\]"),
    "a shape": (arc(shape="LXR"), "shape"),
    "a radius": (arc(radius=-1.0), "radius"),
    "lengths": (arc(segment_length=[1.0, -1.0, 1.0]), "segment_length"),
    "an endless length": (arc(segment_length=[1.0, 1e9, 1.0]), "segment_length"),
    "a pose": (arc(start_pose=[1.0, None, 0.0]), "start_pose"),
    "a part": (changed("arcline_path_3", {"own": [3]}), "arcline_path_3"),
}


@pytest.mark.parametrize(("change", "text"), BROKEN.values(), ids=BROKEN)
def test_a_broken_map_is_left_out_with_one_note(change: Callable[[Record], Record], text: str, mapped: Path) -> None:
    path = write_map(mapped, change(make_map()))
    with pytest.raises(DataError, match=text):
        read_lanes(path)
    notes: list[str] = []
    assert drawn(mapped, notes) == ()
    (note,) = notes
    assert note.startswith(f"drawn without the road: {path}")
