"""Does bADE order driving? Drive scores and bADE of the same agents, and Kendall's tau between them.

    python benchmarks/driving.py measure --env MTP-Drive-Intersection-v0 --scenes 40 -o FOLDER [--attacks] [--seed 1]
    python benchmarks/driving.py show FOLDER [--json figures.json]

`measure`: every agent drives in each scene, and forecasts, open loop, the scene in which ground-truth tracks drove. It
keeps a file per scene, agent and seed (`driving_measure.py`), and goes on where it was stopped; several processes may
fill one folder. `show`: drive score, and bADE of the open loop over all targets, on identity switches, and near the ego
(targets weighted by exp(-approach^2 / (2 sigma^2)), as in PI-ADE). bADE in own episodes has equal weights, and budgets
of the number of targets alone, as each agent drives in other traffic. Tau is 1 where the agent of less error always
drives better. Intervals resample scenes, the same for both numbers. `--attacks` adds those of `driving_attacks.py`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.driving_attacks import ATTACKS
from benchmarks.driving_figures import MOST_SCENES, Measured, figures
from benchmarks.driving_measure import AGENTS, measure
from mtp_bench.cards import load_card
from mtp_bench.env.environment import MTPEnv


def measured(given: argparse.Namespace) -> None:
    card = load_card(given.env)
    note = given.output / "env.txt"
    if note.is_file() and note.read_text(encoding="utf-8") != card.digest + " " + given.env:
        raise SystemExit(f"{given.output} holds drives of another card; choose another folder")
    given.output.mkdir(parents=True, exist_ok=True)
    note.write_text(card.digest + " " + given.env, encoding="utf-8")
    agents = [*(given.agents.split(",") if given.agents else AGENTS), *(ATTACKS if given.attacks else ())]
    low, _, high = (given.scenes or "").rpartition(":")
    names = MTPEnv(card).scene_names[int(low or 0) : int(high) if high else None]
    seeds = [int(seed) for seed in given.seed.split(",")]
    measure(card, names, agents, seeds, given.output, given.jobs, lambda text: print(text, flush=True))


def shown(given: argparse.Namespace) -> None:
    made = figures(Measured(given.folder))
    console, table = Console(width=190), Table(title=f"{made['env']}, {made['scenes']} scenes; bADE open loop")
    first = next(row["errors"] for row in made["rows"].values() if "errors" in row)
    heads = ("agent", "drive score", "less stp", "p", f"seen at {made['scenes']}", f"at {MOST_SCENES}", "at fault",
             "all", "near miss", "progress", "phantom", "comfort", *first)  # fmt: skip
    for head in heads:
        table.add_column(head, justify="left" if head == "agent" else "right")
    for agent, row in made["rows"].items():
        seen = [f"{value:.3f}" for value in row["seen"].values()] if row["p"] is not None else ["", ""]
        table.add_row(
            agent, _cell(row["drive_score"], row["interval"]),
            _cell(row["difference"], row["difference_interval"], "+"),
            "" if row["p"] is None else f"{row['p']:.3f}", *seen, _cell(row["collisions"], row["collisions_interval"]),
            f"{row['any_collision']:.1f}", f"{row['near_misses']:.0f}", f"{row['progress']:.3f}",
            f"{row['phantom_brakes']:.0f}", f"{row['comfort']:.2f}",
            *(f"{value:.3f}" for value in row.get("errors", {}).values()),
        )  # fmt: skip
    console.print(table)
    for group, taus in made["tau"].items():
        cells = [
            f"{name} {tau['tau']:.2f} [{tau['low']:.2f}, {tau['high']:.2f}]" for name, tau in taus["measures"].items()
        ]
        half = f"drive score between halves of the scenes {taus['between halves']:.2f}"
        console.print(f"tau, {group}, {taus['agents']} agents: {'; '.join(cells)}; {half}")
    if given.json:
        given.json.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def _cell(value: float | None, interval: tuple[float, float] | None, sign: str = "") -> str:
    if value is None:
        return ""
    ends = "" if interval is None else f" [{interval[0]:{sign}.3f}, {interval[1]:{sign}.3f}]"
    return f"{value:{sign}.3f}{ends}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("measure")
    one.add_argument("--env", default="MTP-Drive-Intersection-v0")
    one.add_argument("--scenes", help="the first N, or FROM:TO")
    one.add_argument("--agents", help="separated by commas; else all that need no lanes")
    one.add_argument("--seed", default="0", help="of the detector and of agents' draws, separated by commas")
    one.add_argument("--attacks", action="store_true")
    one.add_argument("--jobs", type=int, default=1)
    one.add_argument("-o", "--output", type=Path, required=True)
    one.set_defaults(run=measured)
    two = commands.add_parser("show")
    two.add_argument("folder", type=Path)
    two.add_argument("--json", type=Path)
    two.set_defaults(run=shown)
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
