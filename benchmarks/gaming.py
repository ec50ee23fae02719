"""The gain from cheating: dishonest answers beside those of the honest agent that they come from, under bADE.

    python benchmarks/gaming.py --env MTP-nuScenes-mini-v0 [--scenes N] [--data ROOT] [--noises 4]

A dishonest row is what an honest agent answered, STP if no other is named, changed afterwards (`attacks.py`). Twins
are a second forecast beside each, with the samples of stp_hedged or of another seed. "blurred" and "dropping" rows are
STP that was shown worse detections, the mean of some draws of the noise; without draws they are left out. Differences
are to the honest agent, with the interval that inverts the sign-flip test. At the end: what gains outside of its
interval, whether silence is last, and which steps of the order of honest agents on ids are significant.
"""

from __future__ import annotations

import argparse
import json
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.attacks import CHANGES, in_crowds, joined
from mtp_bench import Action, Agent, Observation, make_action
from mtp_bench.agent import Frame
from mtp_bench.agent.loader import load_submission
from mtp_bench.core import Rollout, Task
from mtp_bench.core.parallel import Workers, cores, parallel_map
from mtp_bench.env.environment import MTPEnv
from mtp_bench.prediction import KinematicPredictor, LearnedPresence
from mtp_bench.running.options import RunOptions
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.reference import reference_for
from mtp_bench.scoring import AgentScores, Report, SceneScore, score_scene, summarise
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.report import paired_row
from mtp_bench.tracking import HypothesisTracker

HONEST: dict[str, tuple[str, dict[str, Any]]] = {
    "GT tracks, same samples": ("gt_tracks", {"draws": 20}),
    "perfect association, same samples": ("perfect_association_same_samples", {}),
    "mtp": ("mtp", {}),
    "same samples": ("stp_same_samples", {}),
    "stp": ("stp", {}),
    "stp_hedged": ("stp_hedged", {}),
    "gt_tracks": ("gt_tracks", {}),
}
ORDER = tuple(
    label for label in HONEST if label not in ("stp_hedged", "gt_tracks")
)  # on ids, from the best
RANKED: tuple[Subset, ...] = ("all", "ids", "reacquired")
EYES = {"blurred by 25 cm": (0.25, 0.0), "dropping 5 %": (0.0, 0.05)}
UNSURE = 0.07  # of twins and leaves


class Leaves:
    """The tracks that other hypotheses than the best hold, each as an object of its own with k samples."""

    def __init__(self, hypotheses: int = 20) -> None:
        self._tracker, self._predictor = (
            HypothesisTracker(hypotheses),
            KinematicPredictor(),
        )
        self._presence = LearnedPresence()

    def reset(self, task: Task) -> None:
        """A new scene."""
        self._task, self._number = task, 0
        for part in (self._tracker, self._predictor, self._presence):
            part.reset(task)

    def act(self, observation: Observation) -> Action:
        """The leaves, the likeliest first."""
        tracks = self._tracker.step(observation)
        mass = np.exp(tracks.log_weight) @ tracks.member
        leaf = np.flatnonzero(~tracks.member[0])
        leaf = leaf[np.argsort(mass[leaf], kind="stable")[::-1]]
        forecasts = self._predictor.predict(Frame(self._number, tracks, (observation,)))
        row = forecasts.rows_of(tracks)[tracks.member.argmax(axis=0)[leaf], leaf]
        self._number += 1
        box = tracks.box[leaf]
        samples = np.clip(
            forecasts.samples[row] - box[:, None, None, :2], -300.0, 300.0
        )
        sure = self._presence.probability(tracks, observation)[leaf]
        return make_action(
            self._task,
            box,
            tracks.class_id[leaf],
            samples,
            confidence=sure,
            tracks=tracks,
            checked=False,
        )


class WorseEyes:
    """An agent that sees its detections moved by noise, or not at all."""

    def __init__(self, agent: Agent, sigma: float, drop: float, seed: int) -> None:
        self._agent, self._sigma, self._drop, self._seed = agent, sigma, drop, seed

    def reset(self, task: Task) -> None:
        """A new scene; its noise depends on nothing but the seed."""
        self._rng = np.random.default_rng(self._seed)
        self._agent.reset(task)

    def act(self, observation: Observation) -> dict[str, Any]:
        """Answer what is seen."""
        box = observation["detection_box"].copy()
        box[:, :2] += (
            self._rng.normal(0.0, self._sigma, (len(box), 2)) if self._sigma else 0.0
        )
        kept = self._rng.random(len(box)) >= self._drop
        order = np.argsort(
            ~(kept & (observation["detection_valid"] == 1)), kind="stable"
        )  # valid rows come first
        shown = {**observation, "detection_box": box}
        shown["detection_valid"] = observation["detection_valid"] * kept.astype(np.int8)
        rows = (
            "detection_box",
            "detection_velocity",
            "detection_score",
            "detection_class",
            "detection_valid",
        )
        return self._agent.act({**shown, **{name: shown[name][order] for name in rows}})


def play(
    env_id: str, options: RunOptions, noises: int, scene: str
) -> dict[str, list[SceneScore]]:
    """Scores of every row on one scene, one per seed of the noise."""
    env = MTPEnv(env_id, **options.env_keywords, evaluation=True)
    said: dict[str, Rollout] = {}
    for label, (name, parameters) in HONEST.items():
        submission = load_submission(name)
        seen = MTPEnv(
            env_id,
            **options.env_keywords,
            observe=submission.compare.observe,
            evaluation=True,
        )
        said[label] = run_scene(
            submission.build(agent_task(seen, 0), **parameters), seen, scene, 0
        )
    agent = load_submission("stp").build(agent_task(env, 0))
    seed, hedged = (
        run_scene(agent, env, scene, 1),
        said["stp_hedged"],
    )  # the same tracks with other samples
    leaves = run_scene(Leaves(), env, scene, 0)
    worse = {
        label: [
            run_scene(WorseEyes(agent, *how, seed), env, scene, 0)
            for seed in range(noises)
        ]
        for label, how in EYES.items()
        if noises
    }
    said |= {
        label: change(env.scene, said["stp"], env.card)
        for label, change in CHANGES.items()
    }
    beside = {
        "twins": ("stp", hedged),
        "twins of another seed": ("stp", seed),
        "twins in crowds": ("stp", in_crowds(env.scene, hedged)),
        "mtp: leaves as objects": ("mtp", leaves),
    }
    for label, (honest, other) in beside.items():
        said[f"{label}, unsure"] = joined(
            said[honest], other, lambda c: np.full_like(c, UNSURE)
        )
        said[f"{label}, half as sure"] = joined(said[honest], other, lambda c: 0.5 * c)
    scores = {
        label: [score_scene(env.scene, one, env.card)] * max(1, noises)
        for label, one in said.items()
    }
    return scores | {
        label: [score_scene(env.scene, one, env.card) for one in rows]
        for label, rows in worse.items()
    }


def report_of(env_id: str, options: RunOptions, noises: int) -> Report:
    card = options.card(env_id)
    scenes = MTPEnv(env_id, **options.env_keywords).scene_names[: options.scenes]
    reference = reference_for(card, scenes, options)
    done = iter(range(1, len(scenes) + 1))
    calls = [(env_id, options, noises, scene) for scene in scenes]
    played = parallel_map(
        play,
        calls,
        options.workers,
        lambda place: print(next(done), "of", len(scenes), flush=True),
    )
    agents = [
        AgentScores(
            label,
            0,
            card.task.samples,
            "equal",
            tuple(zip(*(p[label] for p in played), strict=True)),
            observe=load_submission(HONEST[label][0]).compare.observe
            if label in HONEST
            else "detections",
        )
        for label in played[0]
    ]
    return summarise(agents, card, reference)


def honest_of(label: str) -> str:
    """The agent that a row is compared with; for faint samples the same samples at equal weights."""
    return (
        "mtp"
        if label.startswith("mtp: ")
        else "honest: two widths"
        if label == "two widths, one faint"
        else "stp"
    )


def differences(report: Report, label: str, other: str) -> list[dict[str, Any]]:
    """Difference of a row to another on each ranked number, with what it shows."""
    table, of = (
        {each.setting.agent: each for each in report.tables}[name]
        for name in (label, other)
    )
    rows = [paired_row(table, of, subset) for subset in RANKED]
    return [
        {
            "row": label,
            "to": other,
            "subset": row.subset,
            "difference": row.error,
            "interval": row.interval,
            "p": row.p,
        }
        for row in rows
    ]


def significant(row: dict[str, Any]) -> bool:
    return row["p"] is not None and row["p"] < 0.05


def verdicts(report: Report, rows: list[dict[str, Any]]) -> list[str]:
    """Gains of dishonest rows, the place of silence, and the order of honest agents on ids."""
    dishonest = [
        row
        for row in rows
        if row["row"] not in HONEST and not row["row"].startswith("honest: ")
    ]
    gains = [row for row in dishonest if significant(row) and row["difference"] < 0]
    lines = [
        f"gains: {row['row']} on {row['subset']}: {cell(row)}" for row in gains
    ] or ["gains: none"]
    for subset in RANKED:
        errors = {
            row.agent: row.error
            for row in report.rows
            if row.subset == subset and row.error is not None
        }
        last = all(error <= errors["silence"] + 1e-9 for error in errors.values())
        lines.append(f"silence is {'' if last else 'NOT '}last on {subset}")
    for better, worse in pairwise(ORDER):
        step = next(
            row for row in differences(report, worse, better) if row["subset"] == "ids"
        )
        kind = (
            "not significant"
            if not significant(step)
            else "holds"
            if step["difference"] > 0
            else "REVERSED"
        )
        lines.append(f"ids: {better} < {worse}: {cell(step)}, {kind}")
    return lines


def cell(row: dict[str, Any]) -> str:
    """A difference with its interval and p; 0 if it is exactly that."""
    if not row["difference"]:
        return "0" if row["difference"] == 0 else "-"
    interval = (
        ""
        if row["interval"] is None
        else " [{:+.3f}, {:+.3f}]".format(*row["interval"])
    )
    return f"{row['difference']:+.3f}{interval} p {row['p']:.3f}"


def show(report: Report, rows: list[dict[str, Any]]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(
        title=f"{report.env}, definitions {report.definitions}: {report.condition['weights']}"
    )
    for column in (
        "row",
        "all",
        "- honest",
        "ids",
        "- honest",
        "reacq.",
        "- honest",
        "lost",
        "energy",
    ):
        table.add_column(column, justify="left" if column == "row" else "right")
    for label in dict.fromkeys(row.agent for row in report.rows):
        found = {row.subset: row for row in report.rows if row.agent == label}
        cells = []
        for one in (row for row in rows if row["row"] == label):
            cells += [shown(found[one["subset"]].error, 3), cell(one)]
        table.add_row(
            label,
            *cells,
            shown(found["lost"].error, 2),
            shown(found["all"].energy_score, 2),
        )
    Console(width=190).print(table)


def shown(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--env", required=True)
    parser.add_argument("--scenes", type=int)
    parser.add_argument("--data")
    parser.add_argument("--jobs", type=int, default=cores())
    parser.add_argument("--noises", type=int, default=4)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    start = time.perf_counter()
    report = report_of(
        given.env,
        RunOptions(given.data, given.scenes, workers=Workers(given.jobs)),
        given.noises,
    )
    labels = dict.fromkeys(row.agent for row in report.rows)
    rows = [
        row for label in labels for row in differences(report, label, honest_of(label))
    ]
    show(report, rows)
    lines = verdicts(report, rows)
    print(*lines, f"{time.perf_counter() - start:.0f} s", sep="\n")
    if given.json:
        content = {
            **report.to_json("condition", "details"),
            "differences": rows,
            "verdicts": lines,
        }
        given.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
