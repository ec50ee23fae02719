"""A log of four cars and a bicycle with five faults of known cause, and what finds them again.

    python examples/planted_faults.py

Tables and columns: docs/data/own.md. What the output means: docs/visualization/fault.md.
"""

import math
import subprocess
import sys
from pathlib import Path

import mtp_bench

SIZE = {"car": "4.5,1.8,1.6", "bicycle": "1.8,0.6,1.7", "pedestrian": "0.6,0.6,1.75"}


def place(name: str, t: float) -> tuple[str, float, float, float]:
    """Class, x, y and heading of an object after ``t`` seconds, metres and radians."""
    if name == "turning":  # left, from 10 s on, in a circle of 8 m
        angle = min(max(t - 10, 0), math.pi / 2)
        rest = 8 * max(t - 10 - angle, 0)
        return (
            "car",
            8 * min(t, 10) + 8 * math.sin(angle),
            8 * (1 - math.cos(angle)) + rest,
            angle,
        )
    lane = {"hidden": 12, "jumping": 24, "mistaken": 36, "straight": 48}[name]
    return "bicycle" if name == "mistaken" else "car", 4 * t, float(lane), 0.0


truth, seen = ["frame,id,class,x,y,yaw,l,w,h"], ["frame,class,x,y,yaw,l,w,h,score"]
for frame in range(41):  # 20 s, 2 frames per second
    t = frame / 2
    for name in ("turning", "hidden", "jumping", "mistaken", "straight"):
        kind, x, y, yaw = place(name, t)
        truth.append(f"{frame},{name},{kind},{x:.2f},{y:.2f},{yaw:.2f},{SIZE[kind]}")
        if name == "hidden" and 8 <= t < 10.5:
            continue  # not detected
        if name == "jumping" and t == 9:
            y += 5  # one detection 5 m aside
        if name == "mistaken" and 8 <= t < 11:
            kind = "pedestrian"
        seen.append(f"{frame},{kind},{x:.2f},{y:.2f},{yaw:.2f},{SIZE[kind]},0.9")
    if 5 <= t < 8:
        seen.append(
            f"{frame},car,30,-20,0,{SIZE['car']},0.6"
        )  # a car that is not there
Path("log/one").mkdir(parents=True, exist_ok=True)
Path("log/one/truth.csv").write_text("\n".join(truth) + "\n")
Path("log/one/detections.csv").write_text("\n".join(seen) + "\n")
mtp_bench.run(
    "stp",
    mtp_bench.MTPEnv("MTP-nuScenes-mini-v0", files="log").card,
    "runs/log",
    replace=True,
)
for command in ("worst runs/log", "view runs/log --at turning --png fault.png"):
    print(f"$ mtp-bench {command}", flush=True)
    subprocess.run([sys.executable, "-m", "mtp_bench", *command.split()], check=True)
