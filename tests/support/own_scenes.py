"""Own scenes: tables small enough to think through, and scenes that hold everything."""

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench.core import ImageField, Lane, Scene
from tests.support.small_scenes import make_scene

CLASSES = ("car", "pedestrian")
BOX = "0.8,0,4,1.8,1.5"
TRUTH = ["frame,id,class,x,y,z,yaw,l,w,h", f"0,1,car,0,0,{BOX}", f"1,1,car,1,0,{BOX}", f"2,1,car,2,0,{BOX}"]
DETECTIONS = ["frame,class,x,y,z,yaw,l,w,h,score", f"0,car,0.1,0,{BOX},0.9", f"2,car,2.1,0,{BOX},0.8"]
EGO = ["frame,time,x,y,z,yaw", "0,0.0,5,0,1,0.1", "1,0.1,5,1,1,0.1", "2,0.2,5,2,1,0.1"]


def write_tables(folder: Path, **tables: list[str] | None) -> Path:
    """The folder of one scene with these tables, else those above, in ``folder``/one."""
    scene = folder / "one"
    scene.mkdir(parents=True, exist_ok=True)
    for table, lines in {"truth": TRUTH, "detections": DETECTIONS, **tables}.items():
        if lines is not None:
            (scene / f"{table}.csv").write_text("".join(f"{line}\n" for line in lines))
    return folder


def whole_scene() -> Scene:
    """A scene with every field that a scene of one's own can have: all but stored tracks."""
    scene = make_scene(frames=6, empty=(2,))
    rows = len(scene.truth.box)
    image = ImageField(
        projection=np.arange(72.0).reshape(6, 3, 4), height=np.arange(6.0), heading=np.linspace(-1, 1, 6),
        size=(1242, 375), region=np.arange(8.0).reshape(2, 4), region_start=np.array([0, 0, 1, 1, 1, 2, 2]),
        box_size=np.arange(6.0).reshape(2, 3),
    )  # fmt: skip
    truth = replace(scene.truth, eligible=np.arange(rows) % 2 == 0, neutral=np.arange(rows) % 3 == 0)
    lanes = (_lane(3, (1,)), _lane(2, (), junction=True), _lane(4, (0, 1)))
    return replace(
        scene, truth=truth, detector="pointrcnn, stored detections", truth_complete=True,
        visible=np.linspace(0, 1, rows), skipped={"detection not finite": 2}, recording="a long drive",
        world=np.arange(24.0).reshape(6, 4), image=image, lanes=lanes, annotated=np.ones(6, dtype=bool),
        neutral_areas=np.array([[0.0, 1.0, 2.0, 3.0]]),
    )  # fmt: skip


def _lane(points: int, following: tuple[int, ...], junction: bool = False) -> Lane:
    center = np.arange(2.0 * points).reshape(-1, 2)
    return Lane(center, center + 1, center - 1, following, junction)


def assert_same(first: Any, second: Any, where: str = "scene") -> None:
    """Two records are equal to the last bit."""
    assert type(first) is type(second), where
    if is_dataclass(first):
        for field in fields(first):
            assert_same(getattr(first, field.name), getattr(second, field.name), f"{where}.{field.name}")
    elif isinstance(first, tuple):
        assert len(first) == len(second), where
        for at, pair in enumerate(zip(first, second, strict=True)):
            assert_same(*pair, f"{where}[{at}]")
    elif isinstance(first, np.ndarray):
        assert (first.dtype, first.shape) == (second.dtype, second.shape), where
        np.testing.assert_array_equal(first, second, err_msg=where)
    else:
        assert first == second, where


def write_long_log(folder: Path, frames: int = 30) -> Path:
    """The folder of a scene of two cars, long enough for targets of nuScenes' task, at 2 frames per second."""
    cars = [(t, i, f"{2 * t + 3 * i},{4 * i},{BOX}") for t in range(frames) for i in range(2)]
    truth = [TRUTH[0], *(f"{t},{i},car,{place}" for t, i, place in cars)]
    detections = [DETECTIONS[0], *(f"{t},car,{place},1" for t, _, place in cars)]
    return write_tables(folder, truth=truth, detections=detections)
