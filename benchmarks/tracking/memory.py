"""Memory of tracker and agent, each in a process of its own."""

from __future__ import annotations

import ctypes
import gc
import json
import resource
import subprocess
import sys
import tracemalloc
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from .scenes import KITTI, Row, Scenes, Start, agent, recordings, run_scene, tracker

MIB = 2.0**20
PROGRAM = str(Path(__file__).parents[1] / "tracker.py")


def memory_here(what: str, hypotheses: int, data: str | None, scene: str) -> Row:
    """Memory of running one scene in this process, which should have done nothing else."""
    task, scenes = recordings(KITTI, data, name=scene)
    observations = scenes[scene]
    makers: dict[str, Callable[[int], Start]] = {"tracker": tracker, "agent": agent}
    make = makers[what]
    run_scene(
        make(2), task, observations[:10]
    )  # all that two hypotheses need is loaded
    before = _fresh_peak()
    run_scene(make(hypotheses), task, observations)
    rise = None if before is None else (_status("VmHWM:") - before) / 1024
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        MIB if sys.platform == "darwin" else 1024
    )
    gc.collect()
    tracemalloc.start()
    run_scene(make(hypotheses), task, observations)
    return {
        "resident MiB": resident,
        "rise MiB": rise,
        "traced MiB": tracemalloc.get_traced_memory()[1] / MIB,
    }


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
    scene = max(
        scenes,
        key=lambda name: np.mean(
            [seen["detection_valid"].sum() for seen in scenes[name]]
        ),
    )
    rows: list[Row] = []
    for what in ("tracker", "agent"):
        first: Row = {}
        for h in sizes:
            command = [
                sys.executable,
                PROGRAM,
                "--memory",
                what,
                str(h),
                scene,
                *(["--data", data] if data else []),
            ]
            found = json.loads(
                subprocess.run(
                    command, check=True, capture_output=True, text=True
                ).stdout
            )
            first = first or found
            ratios = {
                f"{name[:-4]} x H=1": found[name] / first[name] if first[name] else None
                for name in found
            }
            rows.append(
                {
                    "of": what,
                    "scene": scene,
                    "frames": len(scenes[scene]),
                    "H": h,
                    **found,
                    **ratios,
                }
            )
    return rows
