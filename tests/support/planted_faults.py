"""A log of 20 s at 2 Hz with faults that are known: a car that is missed, a bicycle seen as a person, and a turn."""

from pathlib import Path

import numpy as np

FRAMES, CAR, BICYCLE, PEDESTRIAN = 41, (4.5, 1.8, 1.6), (1.8, 0.6, 1.7), (0.6, 0.6, 1.75)


def place(name: str, t: float) -> tuple[float, float, float]:
    """Place and heading of an object at ``t`` s: m, m, rad."""
    if name == "missed":
        return 80 - 5 * t, 3.0, np.pi
    if name == "mistaken":
        return 4 * t, 30.0, 0.0
    if name == "parked":
        return 45.0, -20.0, 0.0
    angle = np.clip((t - 10) * 8 / 8, 0, np.pi / 2)  # "turning": to the left after 10 s, with a radius of 8 m
    after = max(0.0, t - 10 - np.pi / 2) * 8
    return (-40 + 8 * t, -6.0, 0.0) if t < 10 else (40 + 8 * np.sin(angle), 2 - 8 * np.cos(angle) + after, angle)


def write_log(folder: Path) -> Path:
    """Write the tables of the log as the scene "log" of a folder of own scenes, which is returned."""
    rng, truth, seen = np.random.default_rng(3), ["frame,id,class,x,y,yaw,l,w,h"], ["frame,class,x,y,yaw,l,w,h,score"]
    for frame in range(FRAMES):
        t = frame / 2
        for name in ("missed", "mistaken", "parked", "turning"):
            kind, size = ("bicycle", BICYCLE) if name == "mistaken" else ("car", CAR)
            x, y, yaw = place(name, t)
            box = f"{yaw:.4f},{','.join(map(str, size))}"
            truth.append(f"{frame},{name},{kind},{x:.4f},{y:.4f},{box}")
            kind = "pedestrian" if name == "mistaken" and 8 <= t < 11 else kind
            if name != "missed" or not 8 <= t < 10.5:
                dx, dy = rng.normal(0, 0.1, 2)
                seen.append(f"{frame},{kind},{x + dx:.4f},{y + dy:.4f},{box},{0.8 + rng.random() / 10:.3f}")
    (folder / "log").mkdir(parents=True)
    (folder / "log" / "truth.csv").write_text("\n".join(truth) + "\n")
    (folder / "log" / "detections.csv").write_text("\n".join(seen) + "\n")
    return folder
