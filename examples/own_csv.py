"""A log of two cars in CSV, of which one is not detected for 2 s: tables, env, STP, score, picture of the failure.

    python examples/own_csv.py

Tables and columns: docs/data/own.md. What the picture shows: docs/seeing/why.md.
"""

import subprocess
import sys
from pathlib import Path

import mtp_bench

Path("logs/one").mkdir(parents=True, exist_ok=True)
rows = [(t, n, f"car,{2 * t + 9 * n},{4 * n},0,4.5,1.8,1.6\n") for t in range(30) for n in (0, 1)]
truth = "frame,id,class,x,y,yaw,l,w,h\n" + "".join(f"{t},{n},{box}" for t, n, box in rows)
seen = "frame,class,x,y,yaw,l,w,h\n" + "".join(f"{t},{box}" for t, n, box in rows if n or not 12 <= t < 16)
Path("logs/one/truth.csv").write_text(truth)
Path("logs/one/detections.csv").write_text(seen)
env = mtp_bench.MTPEnv("MTP-nuScenes-v0", files="logs")  # 2 frames per second, vehicles
mtp_bench.run("stp", env.card, "runs/stp", replace=True)
print(f"error {mtp_bench.score('runs/stp').report.rows[0].error:.2f} m")
view = ["view", "runs/stp", "--at", "lost-0", "--png", "failure.png"]  # `mtp-bench events runs/stp` lists the events
subprocess.run([sys.executable, "-m", "mtp_bench", *view], check=True)
