"""Does bADE order driving? Drive scores and bADE of the same agents, and Kendall's tau between them.

    python benchmarks/driving.py measure --env MTP-Drive-Intersection-v0 --scenes 40 -o FOLDER [--attacks]
    python benchmarks/driving.py show FOLDER [--json figures.json]

`measure`: every agent drives in each scene, and forecasts, open loop, the scene in which ground-truth tracks drove. It
keeps one file per scene, and goes on where it was stopped. `show`: drive score, and bADE of the open loop over all
targets, on identity switches, and near the ego (targets weighted by exp(-approach^2 / (2 sigma^2)), as in PI-ADE). Tau
is 1 where the agent of less error always drives better. Intervals resample scenes, the same for both numbers.
`--attacks` adds those of `driving_attacks.py`.
"""

from __future__ import annotations

import argparse
import json
import pickle
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.driving_attacks import ATTACKS
from mtp_bench.cards import Card, load_card
from mtp_bench.env.environment import MTPEnv
from mtp_bench.parallel import Workers, parallel_map
from mtp_bench.running.drives import recorded_card
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.running.run import jobs_of, run_jobs
from mtp_bench.running.settings import setting_of
from mtp_bench.scoring import AgentScores, Reference, score_scene
from mtp_bench.scoring.definitions import PLANNING_SIGMA
from mtp_bench.scoring.driving import AgentDrives, DrivingRow, driving_rows, scene_scores
from mtp_bench.scoring.table import AgentTable, agent_table
from mtp_bench.scoring.weights_file import read_reference, write_reference
from mtp_bench.submission.objects import submission_of

TRUTH, STP = "truth_past", "stp"
AGENTS = (
    TRUTH, STP, "blind", "standing", "mtp", "stp_same_budget", "tracking_free", "mtp_modes", "stp_modes", "truth_modes",
)  # fmt: skip
REFERENCES = (TRUTH, "truth_modes", "blind", "standing")  # tau is given without them, too
RESAMPLES, HALVES = 2000, 200
POWER = 1.960 + 0.842  # standard errors of a difference that a two-sided test at 5 % finds four times out of five
MOST_SCENES = 200  # of a card, for which the smallest difference is foretold
Array = NDArray[np.float64]
Kept = dict[str, Any]  # of a scene: rollout of TRUTH, drives and scores by agent


def measure_scene(card: Card, name: str, agents: list[str], folder: Path) -> None:
    """Let agents drive in a scene, and forecast the one in which ground-truth tracks drove."""
    path = folder / f"{name}.pickle"
    kept: Kept = pickle.loads(path.read_bytes()) if path.is_file() else {"drives": {}, "scores": {}}
    for agent in dict.fromkeys([TRUTH, *agents]):
        if agent not in kept["drives"]:
            (rollout,) = _played(agent, card, name)
            kept["drives"][agent] = replace(rollout.drive, world={})
            if agent == TRUTH:
                kept["truth"] = rollout
    recorded = recorded_card(card, [kept["truth"]])
    for agent in agents:
        if agent not in kept["scores"] and agent not in ATTACKS:
            (kept["scores"][agent],) = _played(agent, recorded, name, score_scene)
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(kept))
    part.rename(path)


def _played(agent: str, card: Card, name: str, finish: Any = None) -> list[Any]:
    setting = setting_of(submission_of(ATTACKS.get(agent, agent)), card)
    keywords = setting.env_keywords(card)
    return run_jobs(jobs_of(setting.submission, card, keywords, [name], 0, setting.parameters), finish=finish)


def measured(given: argparse.Namespace) -> None:
    given.output.mkdir(parents=True, exist_ok=True)
    (given.output / "env.txt").write_text(given.env, encoding="utf-8")
    agents = [*(given.agents.split(",") if given.agents else AGENTS), *(ATTACKS if given.attacks else ())]
    card, start = load_card(given.env), time.perf_counter()
    names = MTPEnv(card).scene_names[: given.scenes]
    calls = [(card, name, agents, given.output) for name in names]
    done = iter(range(1, len(names) + 1))
    told = lambda place: print(next(done), "of", len(names), f"{time.perf_counter() - start:.0f} s", flush=True)  # noqa: E731
    parallel_map(measure_scene, calls, Workers(given.jobs), told)


class Measured:
    """The scenes of a folder that hold all of their agents."""

    def __init__(self, folder: Path) -> None:
        files = {path.stem: pickle.loads(path.read_bytes()) for path in sorted(folder.glob("*.pickle"))}
        drivers = list(dict.fromkeys(agent for kept in files.values() for agent in kept["drives"]))
        self.scenes = {name: kept for name, kept in files.items() if all(each in kept["drives"] for each in drivers)}
        self.agents = [agent for agent in drivers if agent not in ATTACKS]
        self.card = load_card((folder / "env.txt").read_text(encoding="utf-8"))
        self.way = {name: kept["drives"][TRUTH].way for name, kept in self.scenes.items()}
        self.drives = {
            agent: AgentDrives(agent, {name: [kept["drives"][agent]] for name, kept in self.scenes.items()})
            for agent in drivers
        }
        self._folder = folder

    def score(self, agents: list[str]) -> Array:
        """Drive score [A, S] of each scene."""
        return np.array([scene_scores(self.drives[agent], self.way) for agent in agents])

    def rows(self) -> list[DrivingRow]:
        """The table of driving, attacks included."""
        return driving_rows(list(self.drives.values()), self.way, self.drives[STP])

    def reference(self) -> Reference:
        """Event weights of the recorded scenes."""
        card, path = recorded_card(self.card, [kept["truth"] for kept in self.scenes.values()]), self._folder / "w.json"
        if path.is_file() and (stored := read_reference(path)).card == card.digest:
            return stored
        made = reference_for(card, tuple(self.scenes), RunOptions())
        write_reference(path, made)
        return made

    def errors(self) -> dict[str, tuple[Array, Array]]:
        """Per measure the errors [A, S] summed over the targets of each scene, and their weights [S]."""
        reference, found = self.reference(), dict[str, list[tuple[Array, Array]]]()
        for agent in self.agents:
            scores = tuple(kept["scores"][agent] for kept in self.scenes.values())
            table = agent_table(AgentScores(agent, 0, scores[0].samples, "equal", (scores,)), reference)
            for name, sums in _sums(table, len(self.scenes)).items():
                found.setdefault(name, []).append(sums)
        return {name: (np.array([error for error, _ in rows]), rows[0][1]) for name, rows in found.items()}


def _sums(table: AgentTable, scenes: int) -> dict[str, tuple[Array, Array]]:
    """Per measure the sums [S] of weighted errors and of weights over the targets of each scene."""
    near = np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))
    measures = {
        "bADE": (table.bade("all").error, table.weight["all"]),
        "bADE, identity switches": (table.bade("ids").error, table.weight["ids"]),
        "bADE near the ego": (table.bade("all").error, near),
        "PI-ADE": (table.capped, near),
    }

    def summed(values: Array) -> Array:
        return np.bincount(table.scene, weights=values, minlength=scenes).astype(np.float64)

    return {name: (summed(error * weight), summed(weight)) for name, (error, weight) in measures.items()}


def kendall_tau(first: Array, second: Array) -> Array:
    """Kendall's tau-b [B] over the agents of each column of ``first`` and ``second`` [A, B]; 0 for constant columns."""
    i, j = np.triu_indices(len(first), 1)
    a, b = np.sign(first[i] - first[j]), np.sign(second[i] - second[j])
    size = np.sqrt((a != 0).sum(0) * (b != 0).sum(0))
    return np.asarray((a * b).sum(0) / np.maximum(size, 1e-9))


def _means(sums: Array, weight: Array, drawn: NDArray[np.intp]) -> Array:
    """Means [A, B] over the scenes of each of the ``drawn`` [B, S]."""
    return np.asarray(sums[:, drawn].sum(2) / np.maximum(weight[drawn].sum(1), 1e-9))


def agreement(score: Array, sums: Array, weight: Array) -> dict[str, float]:
    """Tau of drive score [A, S] with less error [A, S], and its interval over scenes."""
    scenes = score.shape[1]
    whole, drawn = np.arange(scenes)[None], np.random.default_rng(0).integers(scenes, size=(RESAMPLES, scenes))
    ones = np.ones(scenes)
    tau, resampled = (kendall_tau(_means(score, ones, rows), -_means(sums, weight, rows)) for rows in (whole, drawn))
    low, high = np.quantile(resampled, [0.025, 0.975])
    return {"tau": float(tau[0]), "low": float(low), "high": float(high)}


def between_halves(score: Array) -> float:
    """Mean tau of drive score [A, S] in one half of the scenes with that in the other: more is not to be had."""
    rng, half = np.random.default_rng(1), score.shape[1] // 2
    order = np.array([rng.permutation(score.shape[1]) for _ in range(HALVES)])
    return float(kendall_tau(score[:, order[:, :half]].mean(2), score[:, order[:, half:]].mean(2)).mean())


def figures(found: Measured) -> dict[str, Any]:
    """All aggregate figures: a row per agent, tau per measure, and the smallest differences that can be seen."""
    errors, scenes = found.errors(), len(found.scenes)
    groups = {"all": found.agents, "without references": [a for a in found.agents if a not in REFERENCES]}
    order = {agent: row for row, agent in enumerate(found.agents)}
    spread = (found.score([*found.drives]) - found.score([STP])).std(axis=1, ddof=1)
    rows = {row.agent: row.__dict__ for row in found.rows()}
    for agent, sigma in zip(found.drives, spread, strict=True):
        rows[agent]["seen"] = {str(n): POWER * float(sigma) / n**0.5 for n in (scenes, MOST_SCENES)}
    for agent in found.agents:
        rows[agent]["errors"] = {
            name: float(sums[order[agent]].sum() / weight.sum()) for name, (sums, weight) in errors.items()
        }
    taus = {
        group: {
            "agents": len(agents),
            "between halves": between_halves(found.score(agents)),
            **{
                name: agreement(found.score(agents), sums[[order[agent] for agent in agents]], weight)
                for name, (sums, weight) in errors.items()
            },
        }
        for group, agents in groups.items()
    }
    return {"env": found.card.id, "card": found.card.digest, "scenes": scenes, "rows": rows, "tau": taus}


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
        found = {name: tau for name, tau in taus.items() if isinstance(tau, dict)}
        cells = [f"{name} {tau['tau']:.2f} [{tau['low']:.2f}, {tau['high']:.2f}]" for name, tau in found.items()]
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
    one.add_argument("--scenes", type=int)
    one.add_argument("--agents", help="separated by commas; else all")
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
