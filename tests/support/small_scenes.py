"""Scenes small enough to think through, a KITTI folder made of them, and agents that answer them."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtp_bench.agent.checks import check_action
from mtp_bench.core import Action as Action, Detections, Floats, Ints, Scene, Task, Truth
from mtp_bench.core.bundle import bundled
from mtp_bench.env.rollouts import RecordedAction, record_action
from tests.support.scoring_scenes import make_scene as drawn_scene

CARD_ID = "MTP-Small-v0"
CARD = """
id = "MTP-Small-v0"
summary = "two cars and a pedestrian"
[source]
name = "kitti"
[task]
rate = 10.0
past = 2
future = 3
samples = 4
classes = ["car", "pedestrian"]
miss_error = 2.0
forecast_gate = 2.0
[task.event_gate]
measure = "center_distance"
threshold = 2.0
[size]
detections = 6
tracks = 5
objects = 4
hypotheses = 3
"""


def write_card(folder: Path, content: str = CARD) -> str:
    path = folder / f"{CARD_ID}.toml"
    path.write_text(content)
    return str(path)


def write_short_card(folder: Path, env_id: str, seconds: float = 3.0) -> str:
    """Card of a simulated env with two short scenes of little traffic."""
    lines = {"seconds": f"seconds = {seconds}", "vehicles": "vehicles = 8", "val": "val = [10000, 10002]"}
    text = (bundled("envs") / f"{env_id}.toml").read_text()
    path = folder / f"{env_id}.toml"
    path.write_text("\n".join(lines.get(line.split(" = ")[0], line) for line in text.splitlines()))
    return str(path)


def task(**changes: Any) -> Task:
    whole = Task(
        env_id=CARD_ID, classes=("car", "pedestrian"), dt=0.1, past=2, future=3, k=4, samples=4, detections=6,
        tracks=5, objects=4, hypotheses=3, detector="pointrcnn",
    )  # fmt: skip
    return replace(whole, **changes)


def make_scene(name: str = "one", frames: int = 8, empty: tuple[int, ...] = ()) -> Scene:
    """A car along x, a car along y and a pedestrian at rest; the detections are 0.1 m off.

    Frames in ``empty`` have no detection. The ego car starts at (20, 10, 1) with a heading of 0.5 rad.
    """
    t = np.arange(frames)
    car = [[20 + 0.8 * i, 10, 0.8, 0.0, 4, 1.8, 1.5] for i in t]
    other = [[40, 5 + 0.5 * i, 0.8, np.pi / 2, 4, 1.8, 1.5] for i in t]
    walker = [[25, 15, 0.9, 1.0, 0.6, 0.6, 1.8] for _ in t]
    box = np.stack([car, other, walker], axis=1).reshape(-1, 7)  # sorted by frame
    class_id = np.tile([0, 0, 1], frames)
    truth = Truth(
        start=np.arange(frames + 1) * 3,
        box=box,
        velocity=np.tile([[8.0, 0.0], [0.0, 5.0], [0.0, 0.0]], (frames, 1)),
        class_id=class_id,
        object_id=np.tile([7, 3, 5], frames),
        eligible=np.ones(3 * frames, dtype=bool),
        neutral=np.zeros(3 * frames, dtype=bool),
    )
    seen = ~np.isin(np.repeat(t, 3), empty)
    detections = Detections(
        start=np.concatenate([[0], np.cumsum(3 * ~np.isin(t, empty))]),
        box=(box + np.array([0.1, 0, 0, 0, 0, 0, 0]))[seen],
        velocity=np.full((int(seen.sum()), 2), np.nan),
        class_id=class_id[seen],
        score=np.tile([3.0, 1.0, -2.0], frames)[seen],
    )
    ego = np.column_stack([20 + 0.5 * t, np.full(frames, 10.0), np.ones(frames), np.full(frames, 0.5)])
    return Scene(name=name, time=1000.0 + 0.1 * t, ego=ego, truth=truth, detections=detections)


def bare_scene(name: str = "bare", frames: int = 3) -> Scene:
    return drawn_scene([[]] * frames, name)


class MemorySource:
    """A source of scenes in memory."""

    def __init__(self, *scenes: Scene) -> None:
        self.scenes = {scene.name: scene for scene in scenes}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.scenes)

    def load(self, name: str) -> Scene:
        return self.scenes[name]


def empty_action(rules: Task) -> Action:
    n, o, h, k = rules.tracks, rules.objects, rules.hypotheses, rules.samples
    return {
        "track_id": np.arange(n),
        "track_box": np.ones((n, 7), dtype=np.float32),
        "track_class": np.full(n, -1),
        "track_valid": np.zeros(n, dtype=np.int8),
        "hypothesis_member": np.zeros((h, n), dtype=np.int8),
        "hypothesis_log_weight": np.full(h, -np.inf, dtype=np.float32),
        "object_box": np.ones((o, 7), dtype=np.float32),
        "object_class": np.zeros(o, dtype=np.int64),
        "object_valid": np.zeros(o, dtype=np.int8),
        "forecast": np.zeros((o, k, rules.future, 2), dtype=np.float32),
        "forecast_log_weight": np.full((o, k), -np.inf, dtype=np.float32),
    }


def decode(action: object, rules: Task, detected: Ints | None = None) -> RecordedAction:
    return record_action(check_action(action, rules), rules, detections=detected)


def full_action(rules: Task) -> Action:
    """Three tracks, two of them in both hypotheses 0 and 1 and id 12 in different states; two objects forecast."""
    action = empty_action(rules)
    action["track_id"][:4] = [10, 11, 12, 12]
    action["track_valid"][:4] = 1
    action["track_box"][:4, 0] = [1, 5, 9, 10]
    action["hypothesis_member"][0, [0, 1, 2]] = 1
    action["hypothesis_member"][1, [0, 1, 3]] = 1
    action["hypothesis_log_weight"][:2] = [0.0, -1.0]
    action["object_valid"][:2] = 1
    action["object_box"][:2, 0] = [1, 5]
    action["forecast"][:2, :2] = [[[1, 0], [2, 0], [3, 0]], [[0, 1], [0, 2], [0, 3]]]
    action["forecast_log_weight"][:2, :2] = [0.0, -0.5]
    action["object_confidence"] = np.full(rules.objects, 0.75, dtype=np.float32)
    action["hypothesis_parent"] = np.array([1, 0, *[-1] * (rules.hypotheses - 2)])
    return action


@dataclass
class EchoAgent:
    """Returns the detections as tracks and objects; forecasts run along the heading, so they turn with the frame."""

    noise: float = 0.0  # m, of the forecasts' speed

    def reset(self, task: Task) -> None:
        self._task = task
        self._rng = np.random.default_rng(task.seed)

    def act(self, observation: dict[str, NDArray[Any]]) -> Action:
        rules, action = self._task, empty_action(self._task)
        valid = np.flatnonzero(observation["detection_valid"])
        rows = valid[: rules.tracks]
        action["track_valid"][: len(rows)] = 1
        action["track_box"][: len(rows)] = observation["detection_box"][rows]
        action["track_class"][: len(rows)] = observation["detection_class"][rows]
        action["hypothesis_member"][:2] = action["track_valid"]
        action["hypothesis_log_weight"][:2] = [0.0, -2.0][: rules.hypotheses]
        rows = valid[: rules.objects]
        box = observation["detection_box"][rows]
        action["object_valid"][: len(rows)] = 1
        action["object_box"][: len(rows)] = box
        action["object_class"][: len(rows)] = observation["detection_class"][rows]
        speed = 0.5 + 0.1 * np.arange(rules.samples) + self.noise * self._rng.normal(size=rules.samples)
        far = speed[:, None] * np.arange(1, rules.future + 1)
        heading = np.stack([np.cos(box[:, 3]), np.sin(box[:, 3])], axis=-1)
        action["forecast"][: len(rows)] = far[None, :, :, None] * heading[:, None, None, :]
        action["forecast_log_weight"][: len(rows)] = 0.0
        return action


def make_echo(task: Task) -> EchoAgent:
    return EchoAgent()


def make_noisy(task: Task) -> EchoAgent:
    return EchoAgent(noise=0.1)


def write_kitti(root: Path) -> str:
    """A data root with three tiny sequences in the official layout: traffic, traffic with gaps, nothing at all."""
    folder = root / "kitti_tracking"
    for name in ("training/label_02", "training/calib", "training/oxts"):
        (folder / name).mkdir(parents=True)
    for kind in ("Car", "Pedestrian", "Cyclist"):
        (folder / "detections/pointrcnn" / kind).mkdir(parents=True)
    lengths = {"0001": 9, "0006": 7, "0008": 4}
    for name, frames in lengths.items():
        scene = bare_scene(frames=frames) if name == "0008" else make_scene(frames=frames, empty=(3, 4))
        _write_sequence(folder, name, scene)
    lines = [f"{name} empty 000000 {frames:06d}\n" for name, frames in lengths.items()]
    (folder / "evaluate_tracking.seqmap.val").write_text("".join(lines))
    return str(root)


def _write_sequence(folder: Path, name: str, scene: Scene) -> None:
    truth, seen = scene.truth, scene.detections
    labels: list[str] = []
    found: dict[str, list[str]] = {"Car": [], "Pedestrian": [], "Cyclist": []}
    for t in range(scene.frames):
        own, rows = truth.rows(t), seen.rows(t)
        for box, kind, identity in zip(truth.box[own], truth.class_id[own], truth.object_id[own], strict=True):
            type_name = ("Car", "Pedestrian")[kind]
            labels.append(f"{t} {identity} {type_name} 0 0 0 0 0 50 50 {_camera_fields(box, ' ')}")
        for box, kind, score in zip(seen.box[rows], seen.class_id[rows], seen.score[rows], strict=True):
            type_name, code = (("Car", 2), ("Pedestrian", 1))[kind]
            found[type_name].append(f"{t},{code},0,0,50,50,{score},{_camera_fields(box, ',')},0")
    (folder / "training/label_02" / f"{name}.txt").write_text("\n".join(labels))
    for type_name, lines in found.items():
        (folder / "detections/pointrcnn" / type_name / f"{name}.txt").write_text("\n".join(lines))
    oxts = "49.0 8.4 115 0 0 0.3 1.4776 4.7767 5" + " 0" * 21
    (folder / "training/oxts" / f"{name}.txt").write_text("\n".join([oxts] * scene.frames))
    unit, turned = "1 0 0 0 1 0 0 0 1", "0 -1 0 0 0 0 -1 0 1 0 0 0"
    calibration = "P2: 721.5377 0 609.5593 0 0 721.5377 172.854 0 0 0 1 0\n"
    calibration += f"R_rect {unit}\nTr_velo_cam {turned}\nTr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0\n"
    (folder / "training/calib" / f"{name}.txt").write_text(calibration)


def _camera_fields(box: Floats, separator: str) -> str:
    """h w l x y z ry in camera axes: x right, y down, z forward; the bottom of the box."""
    x, y, z, yaw, l, w, h = box
    return separator.join(f"{value:.6f}" for value in (h, w, l, -y, h / 2 - z, x, -yaw - np.pi / 2))
