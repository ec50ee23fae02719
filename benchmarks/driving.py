"""Does bADE order driving? Drive scores and bADE of the same agents, and Kendall's tau between them.

    python benchmarks/driving.py measure --env MTP-Drive-Intersection-v0 --scenes 40 -o FOLDER [--attacks] [--seed 1]
    python benchmarks/driving.py show FOLDER [--json figures.json] [--markdown page.md]

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

from benchmarks.driving_attacks import ATTACKS
from benchmarks.driving_figures import Measured, figures
from benchmarks.driving_measure import AGENTS, measure
from benchmarks.driving_tables import grids
from mtp_bench.cards import load_card
from mtp_bench.env.environment import MTPEnv


def measured(given: argparse.Namespace) -> None:
    card = load_card(given.env)
    note = given.output / "env.txt"
    if (
        note.is_file()
        and note.read_text(encoding="utf-8") != card.digest + " " + given.env
    ):
        raise SystemExit(
            f"{given.output} holds drives of another card; choose another folder"
        )
    given.output.mkdir(parents=True, exist_ok=True)
    note.write_text(card.digest + " " + given.env, encoding="utf-8")
    agents = [
        *(given.agents.split(",") if given.agents else AGENTS),
        *(ATTACKS if given.attacks else ()),
    ]
    low, _, high = (given.scenes or "").rpartition(":")
    names = MTPEnv(card).scene_names[int(low or 0) : int(high) if high else None]
    seeds = [int(seed) for seed in given.seed.split(",")]
    measure(
        card,
        names,
        agents,
        seeds,
        given.output,
        given.jobs,
        lambda text: print(text, flush=True),
    )


def shown(given: argparse.Namespace) -> None:
    made = figures(Measured(given.folder, given.jobs))
    console, tables = Console(width=210), grids(made)
    for table in tables:
        table.print(console)
    if given.markdown:
        given.markdown.write_text(
            "\n".join(table.markdown() for table in tables), encoding="utf-8"
        )
    if given.json:
        given.json.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("measure")
    one.add_argument("--env", default="MTP-Drive-Intersection-v0")
    one.add_argument("--scenes", help="the first N, or FROM:TO")
    one.add_argument(
        "--agents", help="separated by commas; else all that need no lanes"
    )
    one.add_argument(
        "--seed",
        default="0",
        help="of the detector and of agents' draws, separated by commas",
    )
    one.add_argument("--attacks", action="store_true")
    one.add_argument("--jobs", type=int, default=1)
    one.add_argument("-o", "--output", type=Path, required=True)
    one.set_defaults(run=measured)
    two = commands.add_parser("show")
    two.add_argument("folder", type=Path)
    two.add_argument("--json", type=Path)
    two.add_argument("--markdown", type=Path)
    two.add_argument(
        "--jobs", type=int, default=1, help="processes that make event weights"
    )
    two.set_defaults(run=shown)
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
