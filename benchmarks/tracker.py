"""Cost and memory of tracking with H hypotheses: KITTI, synthetic scenes, and the whole agent.

    python benchmarks/tracker.py [--data ROOT] [--json FILE] [--plot FILE.png|svg] [--repeats 3] [--quick]

A frame is one step of one tracker for all classes; observations are made before the clock starts. CPU time of one core;
per scene the least of the repeats, in which everything compared takes turns. Stages are wall time (their clock must be
cheap), with about 2 us per frame for the clock itself. The plain tracker is the same in NumPy, and it is run once.
An object's distinct histories are the distinct tracks that stand for it in the hypotheses, as the agent groups them.

Memory is that of a process of its own, after ten frames with two hypotheses: the peak of the resident set (libraries
and all), what it rises by while the scene is run (Linux only, in pages: too coarse for little), and the peak that
tracemalloc sees, in which what kernels allocate is counted.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import os
import resource
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import numpy as np

import mtp_bench.agent as agent_module
import mtp_bench.tracking.tracker as tracker_module
from mtp_bench import load_submission
from mtp_bench._observation import LocalFrame, make_feed
from mtp_bench.agent import Observation, Tracks
from mtp_bench.env import MTPEnv
from mtp_bench.errors import DataError
from mtp_bench.prediction import KinematicPredictor, KMeansSampler
from mtp_bench.tracking import HypothesisTracker
from mtp_bench.tracking.clusters import per_cluster
from mtp_bench.tracking.tree import HypothesisTree
from mtp_bench.tracks import group
from mtp_bench.types import Ints, Task
from tests.plain_tracker import PlainTracker

KITTI, NUSCENES = "MTP-KITTI-v0", "MTP-nuScenes-mini-v0"
HYPOTHESES, OBJECTS = (1, 5, 10, 20, 50, 100, 200), (10, 20, 50, 100, 200, 500)
PAPER = {1: 207.0, 5: 65.0, 10: 25.0, 20: 8.1}  # frames/s
ROOM = 60.0  # m2 per synthetic object
MIB = 2.0**20

Row = dict[str, Any]
Scenes = dict[str, list[Observation]]
Start = Callable[[Task], Callable[[Observation], Any]]  # makes what answers a scene frame by frame
Pieces = tuple[tuple[Any, str, str], ...]  # owner, name of its function, stage

TRACKER_STAGES: Pieces = (
    (tracker_module, "_seen", "prepare observation"),
    (HypothesisTree, "predict", "predict"),
    (tracker_module, "sparse_gains", "affinity"),
    (HypothesisTracker, "_associate", "association"),  # calls sparse_gains
    (HypothesisTree, "grow", "grow tree"),
    (HypothesisTree, "merge_equal", "grow tree"),
    (HypothesisTracker, "_output", "output"),
)
AGENT_STAGES: Pieces = (
    (HypothesisTracker, "step", "track"),
    (agent_module, "group", "group"),
    (KinematicPredictor, "sample", "forecast"),
    (KMeansSampler, "reduce", "reduce samples"),
    (agent_module, "pack", "pack"),
)


def tracker(hypotheses: int, kind: Any = HypothesisTracker, **options: Any) -> Start:
    def start(task: Task) -> Callable[[Observation], Tracks]:
        made = kind(hypotheses, **options)
        made.reset(task)
        return made.step  # type: ignore[no-any-return]

    return start


def agent(hypotheses: int) -> Start:
    def start(task: Task) -> Callable[[Observation], Any]:
        made = load_submission("mtp").build(task, hypotheses=hypotheses)
        made.reset(task)
        return made.act

    return start


def recordings(env_id: str, data: str | None, quick: bool = False, name: str | None = None) -> tuple[Task, Scenes]:
    """All observations of the scenes of a card: the two shortest if ``quick``, or one by name."""
    env = MTPEnv(env_id, data=data, scenes=None if name is None else [name])
    scenes: Scenes = {}
    for name in env.scene_names:
        env.reset(options={"scene": name})
        feed = make_feed(env.scene, LocalFrame.of(env.scene), env.task)
        scenes[name] = [feed.observe(t) for t in range(env.scene.frames)]
    return env.task, dict(sorted(scenes.items(), key=lambda scene: len(scene[1]))[:2]) if quick else scenes


def crowd(n: int, frames: int, seed: int = 0) -> tuple[Task, Scenes]:
    """Cars and pedestrians that walk at random in a square; 2 Hz, a tenth missed, as much clutter.

    Density does not depend on ``n``. At 60 m2 per object a car has several others within its gate.
    """
    rng, side = np.random.default_rng([seed, n]), np.sqrt(ROOM * n)
    class_id, size = np.arange(n) % 2, np.array([[4.5, 1.9, 1.6], [0.7, 0.7, 1.8]])
    xy, heading = rng.uniform(0, side, (n, 2)), rng.uniform(-np.pi, np.pi, n)
    speed = np.where(class_id == 0, 5.0, 1.2) * rng.uniform(0, 1, n)
    made: list[Observation] = []
    for _ in range(frames):
        heading += rng.normal(0, 0.1, n)
        xy += 0.5 * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        heading = np.where(((xy < 0) | (xy > side)).any(axis=1), np.arctan2(*(side / 2 - xy).T[::-1]), heading)
        seen, false = np.flatnonzero(rng.random(n) > 0.1), rng.integers(0, n, rng.poisson(0.1 * n))
        kind = class_id[np.concatenate([seen, false])]
        box = np.zeros((len(kind), 7))
        box[:, :2] = np.concatenate([xy[seen], rng.uniform(0, side, (len(false), 2))])
        box[:, 3], box[:, 4:] = heading[np.concatenate([seen, false])], size[kind]
        box[:, :4] += rng.normal(0, 0.15, (len(kind), 4))
        made.append(
            {
                "detection_box": box.astype(np.float32),
                "detection_class": kind.astype(np.int32),
                "detection_score": rng.uniform(0.2, 1.0, len(kind)).astype(np.float32),
                "detection_valid": np.ones(len(kind), dtype=np.int8),
                "detection_velocity": np.zeros((len(kind), 2), dtype=np.float32),
            }
        )
    task = Task("synthetic", ("car", "pedestrian"), 0.5, 4, 12, 10, 10, 2 * n, 32 * n, 2 * n, 20, "megvii")
    return task, {f"{n} objects": made}


def frames_of(scenes: Scenes) -> int:
    return sum(map(len, scenes.values()))


def run_scene(start: Start, task: Task, observations: Iterable[Observation]) -> None:
    step = start(task)
    for observation in observations:
        step(observation)


def cpu_seconds(starts: dict[Any, Start], task: Task, scenes: Scenes, repeats: int) -> dict[Any, float]:
    """CPU seconds of each over all scenes: the sum of the least of each scene."""
    for start in starts.values():  # imports, kernels
        run_scene(start, task, next(iter(scenes.values()))[:20])
    total = dict.fromkeys(starts, 0.0)
    for observations in scenes.values():
        least = dict.fromkeys(starts, np.inf)
        for _ in range(repeats):
            for name, start in starts.items():
                begin = time.process_time()
                run_scene(start, task, observations)
                least[name] = min(least[name], time.process_time() - begin)
        total = {name: total[name] + least[name] for name in starts}
    return total


@contextmanager
def wrapped(pieces: Pieces, wrap: Callable[[Callable[..., Any], str], Callable[..., Any]]) -> Iterator[None]:
    """The pieces stand wrapped for what they are while the context lasts."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in pieces]
    try:
        for owner, name, stage in pieces:
            setattr(owner, name, wrap(getattr(owner, name), stage))
        yield
    finally:
        for owner, name, function in before:
            setattr(owner, name, function)


@contextmanager
def stopwatch(pieces: Pieces) -> Iterator[dict[str, float]]:
    """Wall seconds spent in the pieces while the context lasts, by stage."""
    spent = {stage: 0.0 for _, _, stage in pieces}

    def timed(function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        def run(*args: Any) -> Any:
            begin = time.perf_counter()
            result = function(*args)
            spent[stage] += time.perf_counter() - begin
            return result

        return run

    with wrapped(pieces, timed):
        yield spent


def stages(start: Start, pieces: Pieces, task: Task, scenes: Scenes, repeats: int) -> Row:
    """Microseconds per frame by stage; each stage of a scene in the repeat that took least in all."""
    total = dict.fromkeys([*(stage for _, _, stage in pieces), "rest", "all"], 0.0)
    for observations in scenes.values():
        best: dict[str, float] = {"all": np.inf}
        for _ in range(repeats):
            with stopwatch(pieces) as spent:
                begin = time.perf_counter()
                run_scene(start, task, observations)
                seconds = time.perf_counter() - begin
            if "association" in spent:
                spent["association"] -= spent["affinity"]
            if seconds < best["all"]:
                best = {**spent, "rest": seconds - sum(spent.values()), "all": seconds}
        total = {stage: total[stage] + best[stage] for stage in total}
    return {stage: 1e6 * seconds / frames_of(scenes) for stage, seconds in total.items()}


def distinct_histories(tracks: Tracks, task: Task) -> Ints:
    """Distinct tracks [O] that stand for each object in the hypotheses, objects as the agent reports them."""
    leaf = np.sort(group(tracks, task.objects, 0.5).leaf, axis=1)
    return np.asarray(1 + (np.diff(leaf, axis=1) > 0).sum(axis=1) - (leaf[:, 0] < 0), dtype=np.int64)


def alive(hypotheses: int, task: Task, scenes: Scenes, **options: Any) -> Row:
    """Averages over frames of what the tracker holds; histories, over objects of all frames."""
    counts: list[tuple[int, int, int]] = []
    histories: list[Ints] = []
    for observations in scenes.values():
        made = HypothesisTracker(hypotheses, **options)
        made.reset(task)
        for observation in observations:
            histories.append(distinct_histories(made.step(observation), task))
            member = made._tree.member
            counts.append((len(member), member.shape[1], int(member[0].sum())))
    held, leaves, tracks = np.mean(counts, axis=0).tolist()
    per_object = float(np.concatenate(histories).mean())
    return {
        "hypotheses alive": held,
        "leaves": leaves,
        "tracks of the best": tracks,
        "histories per object": per_object,
    }


def against_hypotheses(task: Task, scenes: Scenes, sizes: Iterable[int], repeats: int) -> list[Row]:
    """Cost against H on recordings, beside the plain tracker and the paper."""
    frames = frames_of(scenes)
    ours = cpu_seconds({h: tracker(h) for h in sizes}, task, scenes, repeats)
    plain = cpu_seconds({h: tracker(h, PlainTracker) for h in (1, 20)}, task, scenes, 1)
    return [
        {
            "H": h,
            "frames/s": frames / seconds,
            "us per frame": 1e6 * seconds / frames,
            "x H=1": seconds / ours[1],
            "plain frames/s": frames / plain[h] if h in plain else None,
            "plain x H=1": plain[h] / plain[1] if h in plain else None,
            "paper frames/s": PAPER.get(h),
            "paper x H=1": PAPER[1] / PAPER[h] if h in PAPER else None,
            **alive(h, task, scenes),
        }
        for h, seconds in ours.items()
    ]


def best_of(tracks: Tracks) -> bytes:
    """The detections of the last P frames in the best hypothesis, whatever the ids and order of its tracks."""
    rows = np.where(tracks.past_valid[:, :, None], tracks.past, 0.0)[tracks.member[0]]
    table = rows.reshape(len(rows), -1) if len(rows) else np.zeros((0, 1))
    return bytes(table[np.lexsort(table.T)].tobytes())


def same_best(hypotheses: int, task: Task, scenes: Scenes) -> list[Row]:
    """Shares of frames in which joint and per-cluster hypotheses have a best like that of others.

    In whole runs, that of joint hypotheses and that of H = 1; and in one step from the parents of the joint ones.
    """
    of_parents: list[bool] = []

    def both(joint: Callable[..., Any], _: str) -> Callable[..., Any]:
        def solve(*problem: Any) -> Any:
            found, other = joint(*problem), per_cluster(*problem)
            equal = np.array_equal(found[1][0], other[1][0]) and found[2][0] == other[2][0]
            of_parents.append(bool(equal or np.isclose(found[0][0], other[0][0], 0, 1e-9)))
            return found

        return solve

    runs: list[list[bytes]] = []  # of joint ones, clusters, one
    for observations in scenes.values():
        steps = [tracker(hypotheses)(task), tracker(hypotheses, per_cluster=True)(task), tracker(1)(task)]
        runs += [[best_of(step(seen)) for step in steps] for seen in observations]
    with wrapped(((tracker_module, "joint_k_best", ""),), both):
        for observations in scenes.values():
            run_scene(tracker(hypotheses), task, observations)
    shares = [[100 * float(np.mean([run[i] == run[j] for run in runs])) for j in (0, 2)] for i in (0, 1)]
    names = "best of runs as joint, %", "as H=1, %", "as joint of the same parents, %"
    return [dict(zip(names, (*share, 100 * float(np.mean(of_parents))), strict=True)) for share in shares]


def joint_and_clusters(task: Task, scenes: Scenes, repeats: int) -> list[Row]:
    kinds = [(h, clusters) for h in (5, 20) for clusters in (False, True)]
    starts = {kind: tracker(kind[0], per_cluster=kind[1]) for kind in kinds}
    seconds = cpu_seconds(starts, task, scenes, repeats)
    best = {h: same_best(h, task, scenes) for h in (5, 20)}
    return [
        {
            "H": h,
            "hypotheses": "per cluster" if clusters else "joint",
            "frames/s": frames_of(scenes) / seconds[h, clusters],
            "x joint": seconds[h, clusters] / seconds[h, False],
            **alive(h, task, scenes, per_cluster=clusters),
            **best[h][clusters],
        }
        for h, clusters in kinds
    ]


def against_objects(sizes: Iterable[int], frames: int, repeats: int) -> list[Row]:
    rows = []
    for n in sizes:
        task, scenes = crowd(n, frames)
        seconds = cpu_seconds({h: tracker(h) for h in (1, 20)}, task, scenes, repeats)
        row: Row = {"objects": n, **{f"us, H={h}": 1e6 * seconds[h] / frames for h in seconds}}
        rows.append({**row, "H=20 / H=1": seconds[20] / seconds[1], **alive(20, task, scenes)})
    return rows


def growth(rows: list[Row], over: str, cost: str) -> dict[str, float]:
    """Slopes of log cost over log size: least squares over all, and between the last two."""
    x, y = (np.log([row[name] for row in rows]) for name in (over, cost))
    return {"all": float(np.polyfit(x, y, 1)[0]), "last two": float((y[-1] - y[-2]) / (x[-1] - x[-2]))}


def memory_here(what: str, hypotheses: int, data: str | None, scene: str) -> Row:
    """Memory of running one scene in this process, which should have done nothing else."""
    task, scenes = recordings(KITTI, data, name=scene)
    observations = scenes[scene]
    make = {"tracker": tracker, "agent": agent}[what]
    run_scene(make(2), task, observations[:10])  # all that two hypotheses need is loaded
    before = _fresh_peak()
    run_scene(make(hypotheses), task, observations)
    rise = None if before is None else (_status("VmHWM:") - before) / 1024
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (MIB if sys.platform == "darwin" else 1024)
    gc.collect()
    tracemalloc.start()
    run_scene(make(hypotheses), task, observations)
    return {"resident MiB": resident, "rise MiB": rise, "traced MiB": tracemalloc.get_traced_memory()[1] / MIB}


def _fresh_peak() -> int | None:
    """Resident kB now, from where the peak is counted anew; None where the system cannot."""
    gc.collect()
    try:
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        return _status("VmRSS:")
    except (OSError, AttributeError):
        return None


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name))


def memory(data: str | None, scenes: Scenes, sizes: Iterable[int]) -> list[Row]:
    """Memory against H on the scene with the most detections per frame."""
    scene = max(scenes, key=lambda name: np.mean([seen["detection_valid"].sum() for seen in scenes[name]]))
    rows: list[Row] = []
    for what in ("tracker", "agent"):
        first: Row = {}
        for h in sizes:
            command = [sys.executable, __file__, "--memory", what, str(h), scene, *(["--data", data] if data else [])]
            found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            first = first or found
            ratios = {f"{name[:-4]} x H=1": found[name] / first[name] if first[name] else None for name in found}
            rows.append({"of": what, "scene": scene, "frames": len(scenes[scene]), "H": h, **found, **ratios})
    return rows


def whole_agent(name: str, task: Task, scenes: Scenes, repeats: int) -> list[Row]:
    starts = {h: agent(h) for h in (1, 20)}
    seconds, rows = cpu_seconds(starts, task, scenes, repeats), []
    for h, start in starts.items():
        row = {"scenes": name, "frames": frames_of(scenes), "H": h, "CPU ms": 1e3 * seconds[h] / frames_of(scenes)}
        split = {stage: us / 1e3 for stage, us in stages(start, AGENT_STAGES, task, scenes, 1).items()}
        rows.append({**row, "x H=1": seconds[h] / seconds[1], **split})
    return rows


def show(title: str, rows: list[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    table, names = Table(), list(dict.fromkeys(name for row in rows for name in row))
    for name in names:
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(*(_shown(row.get(name)) for name in names))
    console = Console(width=180)
    console.print(f"\n{title}", style="bold", highlight=False)
    console.print(table)


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:,.0f}" if value >= 1000 else f"{value:.1f}" if value >= 100 else f"{value:.2f}"
    return "" if value is None else str(value)


def plot(path: Path, results: dict[str, Any]) -> None:
    """Cost against H on KITTI, its stages, and growth on synthetic scenes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 9), layout="constrained")
    (speed, split), (objects, crowded) = figure.subplots(2, 2)
    for name, label in (("frames/s", "mtp_bench"), ("plain frames/s", "plain NumPy"), ("paper frames/s", "the paper")):
        rows = [row for row in results["kitti"] if row[name]]
        speed.loglog([row["H"] for row in rows], [row[name] for row in rows], "o-", label=label)
    speed.set(title=f"KITTI val, {results['frames']} frames", xlabel="hypotheses H", ylabel="frames/s of one core")
    floor = np.zeros(len(results["stages"]))
    places = [str(row["H"]) for row in results["stages"]]
    for stage in [name for name in results["stages"][0] if name not in ("H", "all")]:
        heights = np.array([row[stage] for row in results["stages"]])
        split.bar(places, heights, bottom=floor, label=stage)
        floor += heights
    split.set(title="KITTI val, by stage", xlabel="hypotheses H", ylabel="us per frame")
    size = results["crowd"][0]["objects"]
    for axes, rows, over, lines in (
        (objects, results["objects"], "objects", {"us, H=1": "objects (H = 1)", "us, H=20": "objects (H = 20)"}),
        (crowded, results["crowd"], "H", {"us per frame": f"H ({size} objects)"}),
    ):
        x = np.array([row[over] for row in rows])
        for name, growing in lines.items():
            slopes = results["growth"][growing]
            label = f"{growing}: exponent {slopes['all']:.2f}, at last {slopes['last two']:.2f}"
            axes.loglog(x, [row[name] for row in rows], "o-", label=label)
        axes.loglog(x, rows[0][next(iter(lines))] * x / x[0], "k:", label="linear")
        axes.set(xlabel=over, ylabel="us per frame")
    objects.set_title("synthetic scenes of one density")
    crowded.set_title(f"synthetic scene of {size} objects")
    for axes in (speed, split, objects, crowded):
        axes.legend()
    figure.savefig(path)


def against_targets(results: dict[str, Any]) -> list[Row]:
    """What was aimed at, and what was found."""
    of = {row["H"]: row for row in results["kitti"]}
    most = max(row["H"] for row in results["memory"])
    found = [
        ("KITTI, H = 20: x H = 1", of[20]["x H=1"], "at most", 1.5),
        ("KITTI, H = 20: frames/s", of[20]["frames/s"], "at least", 1000.0),
    ]
    for name, slopes in results["growth"].items():  # linear, give or take what is measured
        rule, aim = ("at most", 1.05) if name.startswith("objects") else ("below", 0.9)
        found += [(f"exponent in {name}, {part}", slope, rule, aim) for part, slope in slopes.items()]
    for row in results["memory"]:
        if row["H"] == most:
            for kind in ("resident", "rise", "traced"):
                found.append((f"memory of {row['of']}, {kind}: H = {most} x H = 1", row[f"{kind} x H=1"], "below", 2.0))
    return [
        {"what": what, "found": value, "aim": f"{rule} {aim:g}", "met": "yes" if _meets(value, rule, aim) else "NO"}
        for what, value, rule, aim in found
        if value is not None
    ]


def _meets(value: float, rule: str, aim: float) -> bool:
    return value >= aim if rule == "at least" else value < aim or (rule == "at most" and value == aim)


def on_recordings(data: str | None, repeats: int, quick: bool) -> dict[str, Any]:
    task, scenes = recordings(KITTI, data, quick)
    frames = frames_of(scenes)
    where = f"KITTI val, {len(scenes)} sequences, {frames} frames, {len(task.classes)} classes per frame"
    results: dict[str, Any] = {"frames": frames, "sequences": list(scenes)}
    results["kitti"] = against_hypotheses(task, scenes, HYPOTHESES, repeats)
    show(f"Tracker against H: {where}", results["kitti"])
    results["stages"] = [{"H": h, **stages(tracker(h), TRACKER_STAGES, task, scenes, repeats)} for h in HYPOTHESES]
    show(f"Stages, us per frame: {where}", results["stages"])
    results["clusters"] = joint_and_clusters(task, scenes, repeats)
    show(f"Joint and per-cluster hypotheses: {where}", results["clusters"])
    results["memory"] = memory(data, scenes, (1, 20) if quick else (1, 20, 100))
    show("Memory on the KITTI sequence with the most detections per frame", results["memory"])
    agents = whole_agent("KITTI val", task, scenes, 1 if quick else 2)
    try:
        agents += whole_agent("nuScenes mini", *recordings(NUSCENES, data, quick), 1 if quick else 2)
    except DataError as error:
        print(f"nuScenes mini is left out: {error}", file=sys.stderr)
    results["agent"] = agents
    show("Whole agent (mtp), ms per frame; stages are wall time", agents)
    return results


def on_crowds(repeats: int, quick: bool) -> dict[str, Any]:
    frames = 10 if quick else 40
    objects = against_objects(OBJECTS[:3] if quick else OBJECTS, frames, repeats)
    show(f"Tracker against objects: synthetic, {frames} frames each, one object per {ROOM:g} m2", objects)
    task, scenes = crowd(20 if quick else 50, frames)
    n = int(next(iter(scenes)).split()[0])
    seconds = cpu_seconds({h: tracker(h) for h in HYPOTHESES}, task, scenes, repeats)
    crowded: list[Row] = [
        {
            "objects": n,
            "H": h,
            "us per frame": 1e6 * spent / frames,
            "x H=1": spent / seconds[1],
            **alive(h, task, scenes),
        }
        for h, spent in seconds.items()
    ]
    show(f"Tracker against H: synthetic, {n} objects, {frames} frames", crowded)
    exponents = {f"objects (H = {h})": growth(objects, "objects", f"us, H={h}") for h in (1, 20)}
    exponents[f"H ({n} objects)"] = growth(crowded, "H", "us per frame")
    return {"objects": objects, "crowd": crowded, "growth": exponents}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default=None, help="data root with KITTI, and nuScenes mini if it is there")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="few scenes, once: does it run?")
    parser.add_argument("--json", type=Path, default=None)
    parser.add_argument("--plot", type=Path, default=None)
    parser.add_argument("--memory", nargs=3, metavar=("WHAT", "H", "SCENE"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.memory:
        what, hypotheses, scene = given.memory
        print(json.dumps(memory_here(what, int(hypotheses), given.data, scene)))
        return
    repeats = 1 if given.quick else given.repeats
    results = on_recordings(given.data, repeats, given.quick) | on_crowds(10 * repeats, given.quick)  # short scenes
    results["growth"]["H (KITTI)"] = growth(results["kitti"], "H", "us per frame")
    show("Exponents: slope of log cost over log size", [{"of": k, **v} for k, v in results["growth"].items()])
    results["targets"] = against_targets(results)
    show("Targets", results["targets"])
    if given.json:
        given.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    if given.plot:
        plot(given.plot, results)


if __name__ == "__main__":
    main()
