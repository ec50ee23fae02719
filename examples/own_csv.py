"""A log of two cars in CSV, of which one is not detected for 2 s: tables, env, STP, score, picture of the failure.

    python examples/own_csv.py

Tables and columns: docs/data/own.md. What the picture shows: docs/visualization/why.md.
"""

import subprocess
import sys
from pathlib import Path

import mtp_bench

Path("two_cars/one").mkdir(parents=True, exist_ok=True)
rows = [
    (t, n, f"car,{2 * t + 9 * n},{4 * n},0,4.5,1.8,1.6\n")
    for t in range(30)
    for n in (0, 1)
]
truth = "frame,id,class,x,y,yaw,l,w,h\n" + "".join(
    f"{t},{n},{box}" for t, n, box in rows
)
seen = "frame,class,x,y,yaw,l,w,h\n" + "".join(
    f"{t},{box}" for t, n, box in rows if n or not 12 <= t < 16
)
Path("two_cars/one/truth.csv").write_text(truth)
Path("two_cars/one/detections.csv").write_text(seen)
env = mtp_bench.MTPEnv(
    "MTP-nuScenes-v0", files="two_cars"
)  # 2 frames per second, vehicles
mtp_bench.run("stp", env.card, "runs/two_cars", replace=True)
print(f"error {mtp_bench.score('runs/two_cars').report.rows[0].error:.2f} m")
view = [
    "view",
    "runs/two_cars",
    "--at",
    "lost-0",
    "--png",
    "failure.png",
]  # `mtp-bench events runs/two_cars`
subprocess.run([sys.executable, "-m", "mtp_bench", *view], check=True)
