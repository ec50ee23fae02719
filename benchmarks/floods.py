"""Floods: STP's forecasts of the last three frames stated again, against STP on all targets.

    mtp-bench run stp --env MTP-PETS-v0 -o runs/pets
    python benchmarks/floods.py runs/pets [RUN ...] [--data ROOT] [--jobs N]

Each run has a whole split of a card. It is scored as it was stored and with each of the floods of `attacks.py`. The
table in Markdown has bADE in metres, the difference to STP on the same targets, the interval that inverts the sign-flip
test, and its p. A flood loses where the difference is above 0.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.attacks import FLOODS
from mtp_bench.cards import Card
from mtp_bench.core import Rollout
from mtp_bench.core.parallel import Workers, cores, parallel_map
from mtp_bench.running.options import RunOptions
from mtp_bench.running.reference import reference_for
from mtp_bench.running.stored import open_run
from mtp_bench.scoring import AgentScores, SceneScore, score_scene, summarise
from mtp_bench.scoring.report import paired_row
from mtp_bench.scoring.table import AgentTable
from mtp_bench.sources import open_source

HONEST = "stp"


def scene_scores(
    card: Card, data: str | None, rollout: Rollout
) -> dict[str, SceneScore]:
    """Return the scores of a stored rollout by label, as it was stored and flooded."""
    scene = open_source(card, data).load(rollout.scene)
    scores = {HONEST: score_scene(scene, rollout, card)}
    for label, change in FLOODS.items():
        scores[label] = score_scene(scene, change(scene, rollout, card), card)
    return scores


def table_rows(folder: Path, options: RunOptions) -> list[str]:
    """Return the rows of the table for one stored run."""
    opened = open_run(folder, options.data)
    scenes = [rollout.scene for rollout in opened.run.rollouts]
    calls = [(opened.card, opened.data, rollout) for rollout in opened.run.rollouts]
    scored = parallel_map(
        scene_scores,
        calls,
        options.workers,
        lambda place: print(scenes[place], file=sys.stderr),
    )
    agents = []
    for label in scored[0]:
        seeds = (tuple(scores[label] for scores in scored),)
        agents.append(AgentScores(label, 1, opened.card.task.samples, "equal", seeds))
    report = summarise(agents, opened.card, reference_for(opened.card, scenes, options))
    honest = report.tables[0]
    rows = [row_start(report.env, honest) + " | | |"]
    for table in report.tables[1:]:
        difference = paired_row(table, honest, "all")
        interval = "no interval"
        if difference.interval is not None:
            interval = "[{:+.3f}, {:+.3f}]".format(*difference.interval)
        rows.append(
            f"{row_start(report.env, table)} {difference.error:+.4f} | {interval} | {difference.p:.3f} |"
        )
    return rows


def row_start(env: str, table: AgentTable) -> str:
    """Return the first cells of a row: environment, units, forecasts and bADE on all targets."""
    error = table.bade("all").error.mean()
    return f"| {env} | {table.units} | {table.setting.agent} | {error:.4f} |"


def main() -> None:
    """Print the table of the runs that are named."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "runs", nargs="+", type=Path, help="folders of stored runs of stp"
    )
    parser.add_argument("--data", help="data root; else MTP_BENCH_DATA")
    parser.add_argument("--jobs", type=int, default=cores(), help="processes")
    given = parser.parse_args()
    options = RunOptions(given.data, workers=Workers(given.jobs))
    print(
        "| environment | units | forecasts | bADE, m | less STP | 95 % | p |\n|---|--:|---|--:|--:|--:|--:|"
    )
    for folder in given.runs:
        print(*table_rows(folder, options), sep="\n", flush=True)


if __name__ == "__main__":
    main()
