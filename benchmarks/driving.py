"""Does bADE order driving? Drive scores and bADE of the same agents, and Kendall's tau between them.

    python benchmarks/driving.py measure --env MTP-Drive-Intersection-v0 --scenes 40 -o FOLDER [--attacks] [--seed 1]
    python benchmarks/driving.py show FOLDER [--json figures.json] [--markdown page.md]

`measure`: every agent drives in each scene, and forecasts, open loop, the scene in which ground-truth tracks drove. It
keeps a file per scene, agent and seed (`driving_measure.py`), and goes on where it was stopped; several processes may
fill one folder. `show`: drive score, and bADE of the open loop over all targets, on identity switches, and near the ego
(targets weighted by exp(-approach^2 / (2 sigma^2)), as in PI-ADE). bADE in own episodes has equal weights, and budgets
of the number of targets alone, as each agent drives in other traffic. Tau is 1 where the agent of less error always
drives better. Intervals resample scenes, the same for both numbers. `--attacks` adds those of `driving_attacks.py`,
`--changes` every agent with each change of its confidence and samples; "stp: scale 0.5" is one of them.

The weights of the planner were fitted so, on training scenes:

    python benchmarks/driving.py measure --split train --set caution=20 --agents gt_tracks,stp,tracking_free -o FOLDER
    python benchmarks/driving_honesty.py gains FOLDER
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.driving_attacks import ATTACKS, SCAN
from benchmarks.driving_figures import Measured, figures
from benchmarks.driving_measure import AGENTS, measure
from benchmarks.driving_tables import grids
from mtp_bench.cards import Card, DriveSection, PlannerSection, load_card
from mtp_bench.cards.changes import with_split
from mtp_bench.env.environment import MTPEnv


def measured(given: argparse.Namespace) -> None:
    card = _changed(with_split(load_card(given.env), given.split), given.set)
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
    agents = list(given.agents.split(",") if given.agents else AGENTS)
    if given.changes:
        agents += [f"{agent}: {change}" for agent in agents for change in SCAN]
    if given.attacks:
        agents += [attack for attack in ATTACKS if attack not in agents]
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
        not given.drives_only,
        lambda text: print(text, flush=True),
    )


def _changed(card: Card, weights: Sequence[str]) -> Card:
    """The card with other weights of its planner, each WEIGHT=VALUE."""
    drive = card.drive or DriveSection()
    values = {
        name: float(value) for name, value in (each.split("=") for each in weights)
    }
    planner = PlannerSection(**{**drive.planner.model_dump(), **values})
    return card.model_copy(
        update={"drive": drive.model_copy(update={"planner": planner})}
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
    one.add_argument("--changes", action="store_true")
    one.add_argument("--split", default="val")
    one.add_argument(
        "--set", nargs="*", default=[], metavar="WEIGHT=VALUE", help="of the planner"
    )
    one.add_argument(
        "--drives-only", action="store_true", help="no bADE: twice as fast"
    )
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
