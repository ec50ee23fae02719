"""Tables, the plot, and what was aimed at beside what was found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .scenes import Row


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
