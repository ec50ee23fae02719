"""Do simulated scenes rank agents as recorded ones do? Kendall's tau of all baselines, per subset.

    python benchmarks/rank_agreement.py measure --env MTP-nuScenes-v0 --split train --data ROOT -o real.npz
    python benchmarks/rank_agreement.py measure --env MTP-Intersection-v0 -o simulated.npz
    python benchmarks/rank_agreement.py show real.npz simulated.npz [simulated.npz ...]

`measure` runs the agents once each and keeps their errors, ranked (E) and plain, as sums over the targets of a unit.
``--fold 1/2`` measures half of the scenes: networks that learnt from the other half take part (``MTP_BENCH_WEIGHTS``
names them), and `show` joins files of the same env, all folds of it. `show` compares the agents that both files have.
Intervals are of tau over resampled units of both worlds.
"""

from __future__ import annotations

import argparse
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import kendalltau

from mtp_bench.env.environment import MTPEnv
from mtp_bench.errors import MtpBenchError
from mtp_bench.parallel import Workers
from mtp_bench.running.options import RunOptions, fold_of
from mtp_bench.running.reference import reference_for
from mtp_bench.running.run import jobs_of, run_jobs
from mtp_bench.running.settings import setting_of
from mtp_bench.scoring import AgentScores, Reference, score_scene
from mtp_bench.scoring.table import agent_table
from mtp_bench.submission.loader import load_submission

AGENTS = (
    "stp", "mtp", "stp_min_score", "mtp_min_score", "ab3dmot", "stp_same_samples", "stp_hedged", "stp_modes",
    "mtp_modes", "stp_modes_tracklets", "mtp_modes_tracklets", "tracking_free", "affinity", "stp_ptp", "mtp_ptp",
)  # fmt: skip
SUBSETS = ("all", "ids", "lost", "reacquired", "frag")
MOVING = ", moving"  # these of a subset alone: targets of nuScenes' prediction challenge move, most parked cars do not
MEASURES = ("E", "plain")
RESAMPLES = 2000
Sums = dict[str, np.ndarray]  # per subset [units]


def kendall_tau(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Kendall's tau-b [B] over the agents of each column of ``first`` and ``second`` [A, B]; 0 for constant columns."""
    found = [kendalltau(a, b).statistic for a, b in zip(first.T, second.T, strict=True)]
    return np.asarray(np.nan_to_num(np.array(found)))


def measure(env_id: str, agent: str, options: RunOptions, reference: Reference) -> dict[str, Sums]:
    """Sums of errors of an agent at equal k, per measure and subset, and under "weight" of the targets."""
    card, submission = options.card(env_id), load_submission(agent)
    setting = setting_of(submission, card)
    scenes = options.chosen(MTPEnv(env_id, **options.env_keywords).scene_names)
    keywords = {**options.env_keywords, **setting.env_keywords(card)}
    scores = run_jobs(jobs_of(submission, env_id, keywords, scenes, 0, setting.parameters), options, score_scene)
    table = agent_table(AgentScores(agent, 0, card.task.samples, "equal", (tuple(scores),)), reference)
    found: dict[str, Sums] = {"E": {}, "plain": {}, "weight": {}}
    for subset in SUBSETS:
        for name, weight in (
            (subset, table.weight[subset]),
            (f"{subset}{MOVING}", table.weight[subset] * table.moving),
        ):
            found["E"][name] = table.per_unit(table.bade(subset).error, weight)
            found["plain"][name] = table.per_unit(table.capped, weight)
            found["weight"][name] = table.unit_weight(weight)
    return found


def measured(given: argparse.Namespace) -> None:
    """Run the agents and write what they are worth, after each of them."""
    fold = None if given.fold is None else fold_of(given.fold)
    options = RunOptions(
        given.data, given.scenes, split=given.split, fold=fold, workers=Workers(given.jobs), detector=given.detector
    )
    scenes = options.chosen(MTPEnv(given.env, **options.env_keywords).scene_names)
    reference = reference_for(options.card(given.env), scenes, options)
    arrays: dict[str, Any] = {"name": np.array(given.name or given.env)}
    for agent in given.agents.split(",") if given.agents else AGENTS:
        try:
            found = measure(given.env, agent, options, reference)
        except MtpBenchError as error:
            print(f"{agent}: {error}", flush=True)
            continue
        arrays |= {f"{agent}/{kind}/{s}": sums for kind, part in found.items() for s, sums in part.items()}
        np.savez_compressed(given.output, **arrays)
        weight = found["weight"]
        means = (f"{s} {found['E'][s].sum() / max(weight[s].sum(), 1e-9):.3f}" for s in SUBSETS)
        print(f"{agent}: E {', '.join(means)}", flush=True)


def read(paths: list[Path]) -> dict[str, dict[str, np.ndarray]]:
    """Per env the arrays of its files, joined along the units."""
    envs: dict[str, dict[str, list[np.ndarray]]] = {}
    for path in paths:
        with np.load(path) as stored:
            parts = envs.setdefault(str(stored["name"]), {})
            for key in stored.files:
                if key != "name":
                    parts.setdefault(key, []).append(stored[key])
    most = {name: max(map(len, parts.values())) for name, parts in envs.items()}
    return {
        name: {key: np.concatenate(value) for key, value in parts.items() if len(value) == most[name]}
        for name, parts in envs.items()
    }


def means(arrays: dict[str, np.ndarray], agents: list[str], kind: str, subset: str, unit: np.ndarray) -> np.ndarray:
    """Mean errors [agents, resamples] over ``unit`` [resamples, units]."""
    every = np.array([arrays[f"{agent}/{kind}/{subset}"] for agent in agents])
    weight = arrays[f"{agents[0]}/weight/{subset}"][unit].sum(1)
    return np.asarray(every[:, unit].sum(2) / np.maximum(weight, 1e-9))


def agreement(
    real: dict[str, np.ndarray], made: dict[str, np.ndarray], kind: str, subset: str, moving: str
) -> dict[str, Any]:
    """Tau with its interval, and both worlds' errors; ``moving``: of the simulated targets these alone."""
    agents = [a for a in AGENTS if f"{a}/E/all" in real and f"{a}/E/all" in made]
    rng = np.random.default_rng(0)

    def sampled(arrays: dict[str, np.ndarray], subset: str) -> tuple[np.ndarray, np.ndarray]:
        units = len(arrays[f"{agents[0]}/weight/all"])
        every = np.arange(units)[None]
        drawn = rng.integers(units, size=(RESAMPLES, units))
        return means(arrays, agents, kind, subset, every), means(arrays, agents, kind, subset, drawn)

    (here, resampled), (there, again) = sampled(real, subset), sampled(made, subset + moving)
    low, high = np.quantile(kendall_tau(resampled, again), [0.025, 0.975])
    errors = {agent: (float(x), float(y)) for agent, x, y in zip(agents, here[:, 0], there[:, 0], strict=True)}
    own = np.quantile(
        kendall_tau(resampled, np.repeat(here, RESAMPLES, 1)), 0.05
    )  # the recorded scenes with themselves
    return {"tau": float(kendall_tau(here, there)[0]), "low": float(low), "high": float(high), "real": float(own),
            "errors": errors}  # fmt: skip


def shown(given: argparse.Namespace) -> None:
    """Tables of tau, and of the errors on the subset "ids"."""
    from rich.console import Console
    from rich.table import Table

    (name, real), *simulated = read(given.files).items()
    console = Console(width=140)
    table = Table(title=f"Kendall's tau with {name} [95 % over units of both] (5 % of its own resamples are below)")
    for column in ("simulated", "targets", "agents", "measure", *SUBSETS):
        table.add_column(column)
    kept: dict[str, Any] = {}
    for env, made in simulated:
        for kind, moving in itertools.product(MEASURES, ("", MOVING)):
            found = {subset: agreement(real, made, kind, subset, moving) for subset in SUBSETS}
            cells = [f"{f['tau']:.2f} [{f['low']:.2f}, {f['high']:.2f}] ({f['real']:.2f})" for f in found.values()]
            table.add_row(env, "moving" if moving else "all", str(len(found["all"]["errors"])), kind, *cells)
            kept[f"{env}/{kind}{moving}"] = found
    console.print(table)
    for subset in given.subsets.split(","):
        for key, found in kept.items():
            rows = sorted(found[subset]["errors"].items(), key=lambda row: row[1][0])
            console.print(f"{key}, {subset}: " + ", ".join(f"{agent} {a:.2f} | {b:.2f}" for agent, (a, b) in rows))
    if given.json:
        given.json.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("measure")
    one.add_argument("--env", required=True)
    one.add_argument("--name", help="of the env in tables; else its id")
    one.add_argument("--split")
    one.add_argument("--detector")
    one.add_argument("--scenes", type=int)
    one.add_argument("--fold")
    one.add_argument("--agents", help="separated by commas; else all")
    one.add_argument("--data")
    one.add_argument("--jobs", type=int, default=2)
    one.add_argument("-o", "--output", type=Path, required=True)
    one.set_defaults(run=measured)
    two = commands.add_parser("show")
    two.add_argument("files", type=Path, nargs="+", help="the recorded env first")
    two.add_argument("--subsets", default="ids", help="whose errors are listed")
    two.add_argument("--json", type=Path)
    two.set_defaults(run=shown)
    given = parser.parse_args()
    given.run(given)


if __name__ == "__main__":
    main()
