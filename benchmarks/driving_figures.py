"""Figures of `benchmarks/driving.py show`: drive scores beside bADE, and Kendall's tau between them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.driving_attacks import ATTACKS
from benchmarks.driving_measure import (
    AGENTS,
    RECORDED,
    STP,
    TRUTH,
    Array,
    Kept,
    path_of,
    read_kept,
    read_rollout,
    read_scores,
)
from benchmarks.driving_switches import (
    POWER,
    RESAMPLES,
    Windows,
    cost_in_scenes,
    cost_in_windows,
)
from benchmarks.kendall import kendall_tau
from mtp_bench.cards import load_card
from mtp_bench.core.parallel import Workers
from mtp_bench.running.drives import recorded_card
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import AgentScores, Reference, SceneScore
from mtp_bench.scoring.definitions import PLANNING_SIGMA
from mtp_bench.scoring.driving import (
    AgentDrives,
    DrivingRow,
    driving_rows,
    scene_score,
    scene_scores,
)
from mtp_bench.scoring.statistics import paired_difference
from mtp_bench.scoring.table import AgentTable, agent_table
from mtp_bench.scoring.weights import read_reference, write_reference

REFERENCES = (
    TRUTH,
    "gt_tracks_modes",
    "gt_tracks_ptp",
    "blind",
    "standing",
)  # tau is given without them, too
PAIRS = (
    ("stp_same_samples", STP),
    ("mtp", "stp_same_samples"),
    ("perfect_association_same_samples", "stp_same_samples"),
    ("stp_modes_tracklets", "stp_modes"),
    ("mtp_modes_tracklets", "stp_modes_tracklets"),
    ("tracking_free", "mtp"),
    ("tracking_free", "stp_modes_tracklets"),
    ("tracking_free", "mtp_modes_tracklets"),
    (TRUTH, "tracking_free"),
)
SEEDS, ENOUGH = (0, 1, 2), 0.9
HALVES = 200
MOST_SCENES = 200  # of a card, for which the smallest difference is foretold


class Measured:
    """Drives and scores of a folder, in the scenes that all agents have driven in; seeds above 0 where complete.

    Left out, with a reason: agents that failed, and those with less than `ENOUGH` of the scenes of TRUTH.
    """

    def __init__(self, folder: Path, jobs: int = 1) -> None:
        self.folder, self.jobs, self.left_out = folder, jobs, dict[str, str]()
        self.card = load_card(
            (folder / "env.txt").read_text(encoding="utf-8").split(" ", 1)[1]
        )
        self.dt = 1.0 / self.card.task.rate
        kept = {
            seed: _kept(folder / f"seed{seed}")
            for seed in SEEDS
            if (folder / f"seed{seed}").is_dir()
        }
        first = kept[0]
        for agent, scenes in first.items():
            failed = next(
                (
                    f"{name}: {one.failure}"
                    for name, one in scenes.items()
                    if one.failure
                ),
                "",
            )
            if failed:
                self.left_out[agent] = failed
            elif agent not in ATTACKS and len(scenes) < ENOUGH * len(first[TRUTH]):
                self.left_out[agent] = (
                    f"has {len(scenes)} of {len(first[TRUTH])} scenes"
                )
        drivers = [
            agent
            for agent in (*AGENTS, *first)
            if agent in first and agent not in self.left_out
        ]
        self.agents = list(
            dict.fromkeys(agent for agent in drivers if agent not in ATTACKS)
        )
        self.attacks = [agent for agent in ATTACKS if agent in drivers]
        self.scenes = [
            name
            for name in first[TRUTH]
            if all(name in first[agent] for agent in self.agents)
        ]
        attacked = [
            name
            for name in self.scenes
            if all(name in first[agent] for agent in self.attacks)
        ]
        self.attacked = attacked if self.attacks else []
        self.kept: dict[
            str, dict[int, dict[str, Kept]]
        ] = {}  # by agent, seed and scene
        for agent in [*self.agents, *self.attacks]:
            names = self.scenes if agent in self.agents else self.attacked
            runs = {
                seed: scenes[agent] for seed, scenes in kept.items() if agent in scenes
            }
            whole = {
                seed: run
                for seed, run in runs.items()
                if all(n in run and not run[n].failure for n in names)
            }
            self.kept[agent] = {
                seed: {name: run[name] for name in names} for seed, run in whole.items()
            }
        truth = self.kept[TRUTH]
        self.way = {
            name: float(np.mean([run[name].drive.way for run in truth.values()]))
            for name in self.scenes
        }

    def drives(self, agent: str, names: Sequence[str]) -> AgentDrives:
        """Drives of an agent in some scenes, one per seed."""
        runs = self.kept[agent].values()
        return AgentDrives(
            agent, {name: [run[name].drive for run in runs] for name in names}
        )

    def score(self, agents: Sequence[str], names: Sequence[str] | None = None) -> Array:
        """Drive score [A, S] of each scene, mean over seeds."""
        names = self.scenes if names is None else names
        way = {name: self.way[name] for name in names}
        return np.array(
            [scene_scores(self.drives(agent, names), way) for agent in agents]
        )

    def rows(self, agents: Sequence[str], names: Sequence[str]) -> list[DrivingRow]:
        """The table of driving in some scenes."""
        drives = {
            agent: self.drives(agent, names) for agent in dict.fromkeys([STP, *agents])
        }
        return driving_rows(
            list(drives.values()), {name: self.way[name] for name in names}, drives[STP]
        )

    def reference(self) -> Reference:
        """Event weights of the recorded scenes."""
        paths = [
            path_of(self.folder, 0, name, TRUTH).with_name(RECORDED)
            for name in self.scenes
        ]
        card, path = (
            recorded_card(self.card, [read_rollout(each) for each in paths]),
            self.folder / "weights.json",
        )
        if path.is_file() and (stored := read_reference(path)).card == card.digest:
            return stored
        made = reference_for(
            card, tuple(self.scenes), RunOptions(workers=Workers(self.jobs))
        )
        write_reference(path, made)
        return made

    def errors(self) -> dict[str, tuple[Array, Array]]:
        """Per measure the errors [A, S] summed over the targets of each scene, and their weights [A, S]."""
        reference, found = self.reference(), dict[str, list[tuple[Array, Array]]]()
        for agent in self.agents:
            scores = [
                read_scores(path_of(self.folder, 0, name, agent))
                for name in self.scenes
            ]
            open_loop = tuple(
                one.open_loop for one in scores if one.open_loop is not None
            )
            own = _table(agent, tuple(one.own for one in scores), None)
            sums = _sums(_table(agent, open_loop, reference), len(self.scenes))
            sums["bADE, own episodes"] = _summed(
                own, own.bade("all").error, own.weight["all"], len(self.scenes)
            )
            for name, each in sums.items():
                found.setdefault(name, []).append(each)
        return {
            name: (np.array([e for e, _ in rows]), np.array([w for _, w in rows]))
            for name, rows in found.items()
        }


def _kept(folder: Path) -> dict[str, dict[str, Kept]]:
    """Kept drives of a seed, by agent and scene."""
    found: dict[str, dict[str, Kept]] = {}
    for path in sorted(folder.glob("*/*.pickle")):
        if (kept := read_kept(path)) is not None:
            found.setdefault(path.stem, {})[path.parent.name] = kept
    return found


def _table(
    agent: str, scores: tuple[SceneScore, ...], reference: Reference | None
) -> AgentTable:
    return agent_table(
        AgentScores(agent, 0, scores[0].samples, "equal", (scores,)), reference
    )


def _sums(table: AgentTable, scenes: int) -> dict[str, tuple[Array, Array]]:
    """Per measure the sums [S] of weighted errors and of weights over the targets of each scene."""
    near = np.exp(-(table.approach**2) / (2.0 * PLANNING_SIGMA**2))
    measures = {
        "bADE": (table.bade("all").error, table.weight["all"]),
        "bADE, identity switches": (table.bade("ids").error, table.weight["ids"]),
        "bADE near the ego": (table.bade("all").error, near),
        "PI-ADE": (table.capped, near),
    }

    return {
        name: _summed(table, error, weight, scenes)
        for name, (error, weight) in measures.items()
    }


def _summed(
    table: AgentTable, error: Array, weight: Array, scenes: int
) -> tuple[Array, Array]:
    sums = (
        np.bincount(table.scene, weights=each, minlength=scenes)
        for each in (error * weight, weight)
    )
    top, bottom = (each.astype(np.float64) for each in sums)
    return top, bottom


def _means(sums: Array, weight: Array, drawn: NDArray[np.intp]) -> Array:
    """Means [A, B] of sums over weights [A, S] over the scenes of each of the ``drawn`` [B, S]."""
    return np.asarray(sums[:, drawn].sum(2) / np.maximum(weight[:, drawn].sum(2), 1e-9))


def agreement(score: Array, sums: Array, weight: Array) -> dict[str, float]:
    """Tau of drive score [A, S] with less error, sums and weights [A, S], and its interval over scenes."""
    scenes = score.shape[1]
    whole, drawn = (
        np.arange(scenes)[None],
        np.random.default_rng(0).integers(scenes, size=(RESAMPLES, scenes)),
    )
    ones = np.ones_like(score)
    tau, resampled = (
        kendall_tau(_means(score, ones, rows), -_means(sums, weight, rows))
        for rows in (whole, drawn)
    )
    low, high = np.quantile(resampled, [0.025, 0.975])
    return {"tau": float(tau[0]), "low": float(low), "high": float(high)}


def between_halves(score: Array) -> float:
    """Mean tau of drive score [A, S] in one half of the scenes with that in the other: more is not to be had."""
    rng, half = np.random.default_rng(1), score.shape[1] // 2
    order = np.array([rng.permutation(score.shape[1]) for _ in range(HALVES)])
    return float(
        kendall_tau(
            score[:, order[:, :half]].mean(2), score[:, order[:, half:]].mean(2)
        ).mean()
    )


def figures(found: Measured) -> dict[str, Any]:
    """All aggregate figures: a row per agent, tau per measure, and the smallest differences that can be seen."""
    errors, order = (
        found.errors(),
        {agent: row for row, agent in enumerate(found.agents)},
    )
    rows = _rows(found, found.agents, found.scenes)
    for agent in found.agents:
        sums = {
            name: (top[order[agent]].sum(), bottom[order[agent]].sum())
            for name, (top, bottom) in errors.items()
        }
        rows[agent]["errors"] = {
            name: float(top / bottom) for name, (top, bottom) in sums.items()
        }
    attacks = _rows(found, found.attacks, found.attacked) if found.attacked else {}
    groups = {
        "all": found.agents,
        "without references": [a for a in found.agents if a not in REFERENCES],
    }
    taus = {group: _taus(found, agents, errors) for group, agents in groups.items()}
    return {
        "env": found.card.id,
        "card": found.card.digest,
        "scenes": len(found.scenes),
        "seeds": {agent: len(runs) for agent, runs in found.kept.items()},
        "left out": found.left_out,
        "rows": rows,
        "pairs": _pairs(found),
        "attacked scenes": len(found.attacked),
        "attacks": attacks,
        "tau": taus,
        "switches": switch_costs(found),
    }


def switch_costs(found: Measured) -> dict[str, Any]:
    """Costs of an identity switch near the ego, over the agents that have any."""
    parts: dict[bool, list[Windows]] = {
        False: [],
        True: [],
    }  # of switches near, and ahead
    rows: list[tuple[Array, Array, Array]] = []
    for number, agent in enumerate(found.agents):
        runs = found.kept[agent]
        switches = {
            seed: np.array([run[name].moments.switches().sum() for name in run])
            for seed, run in runs.items()
        }
        if not any(each.any() for each in switches.values()):
            continue
        for seed, run in runs.items():
            for ahead, own in parts.items():
                own += [
                    Windows.of(kept, found.dt, scene, number, ahead)
                    for scene, kept in enumerate(run.values())
                ]
            if (truth := found.kept[TRUTH].get(seed)) is not None:
                scores = [
                    [scene_score(each[n].drive, found.way[n]) for n in found.scenes]
                    for each in (run, truth)
                ]
                seconds = np.array([kept.drive.seconds for kept in run.values()])
                rows.append((switches[seed], seconds, np.subtract(*np.array(scores))))
    if not rows:
        return {}
    count, seconds, score = (np.array(column) for column in zip(*rows, strict=True))
    return {
        "per drive": float(count.mean()),
        "drives without": float((count == 0).mean()),
        "windows": cost_in_windows(Windows.joined(parts[False])),
        "ahead": cost_in_windows(Windows.joined(parts[True])),
        "scenes": cost_in_scenes(count, seconds, score),
    }


def _rows(
    found: Measured, agents: Sequence[str], names: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Rows by agent, each with the smallest difference to stp that can be seen."""
    rows = {row.agent: dict(row.__dict__) for row in found.rows(agents, names)}
    spread = (found.score([*rows], names) - found.score([STP], names)).std(
        axis=1, ddof=1
    )
    for agent, sigma in zip(rows, spread, strict=True):
        rows[agent]["seen"] = {
            str(n): POWER * float(sigma) / n**0.5 for n in (len(names), MOST_SCENES)
        }
    return rows


def _pairs(found: Measured) -> list[dict[str, Any]]:
    """Differences of drive scores in the same scenes, and the smallest ones that can be seen."""
    pairs = []
    for one, other in PAIRS:
        if one in found.agents and other in found.agents:
            mine, theirs = found.score([one])[0], found.score([other])[0]
            less = paired_difference(mine, theirs, np.ones(len(mine)))
            assert less is not None  # there are scenes
            seen = POWER * float((mine - theirs).std(ddof=1)) / len(mine) ** 0.5
            pairs.append(
                {
                    "one": one,
                    "other": other,
                    "mean": less.mean,
                    "interval": less.interval,
                    "p": less.p,
                    "seen": seen,
                }
            )
    return pairs


def _taus(
    found: Measured, agents: list[str], errors: dict[str, tuple[Array, Array]]
) -> dict[str, Any]:
    score, row = found.score(agents), [found.agents.index(agent) for agent in agents]
    taus = {
        name: agreement(score, sums[row], weight[row])
        for name, (sums, weight) in errors.items()
    }
    return {
        "agents": len(agents),
        "between halves": between_halves(score),
        "measures": taus,
    }
