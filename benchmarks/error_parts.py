"""Split bADE of three agents into its parts on several environments, and write the figures for RESULTS.md.

    python benchmarks/error_parts.py --data ROOT -o leaderboard/error_parts.json
    python benchmarks/error_parts.py --data ROOT --env MTP-nuScenes-v0 --seeds 1 -o leaderboard/error_parts.json

Agents are run with their own references. Each row says how many scenes and seeds it is of; the rows of an environment
replace those that the file has of it. ``MTP_BENCH_WEIGHTS`` names the folder of networks that do not ship.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from mtp_bench.agent.loader import load_submission
from mtp_bench.core.files import write_text
from mtp_bench.core.parallel import Workers
from mtp_bench.running.evaluation import EnvEvaluation
from mtp_bench.running.options import RunOptions
from mtp_bench.running.settings import references_of, setting_of
from mtp_bench.scoring import References
from mtp_bench.scoring.parts import PART_NAMES

ENVS = ("MTP-nuScenes-v0", "MTP-KITTI-v0", "MTP-PETS-v0", "MTP-Intersection-v0")
AGENTS = ("stp", "mtp", "tracking_free")
DIGITS = 12  # after the point: parts add up to bADE within 1e-9


def measure(env_id: str, options: RunOptions) -> list[dict[str, Any]]:
    """A row per agent: the conditions, bADE over all targets and its parts, in metres."""
    with EnvEvaluation.opened("splitting the error", env_id, options, {}) as evaluation:
        settings = [
            setting_of(load_submission(name), evaluation.card) for name in AGENTS
        ]
        known = {
            setting.label: references_of(setting, evaluation.card)
            for setting in settings
        }
        runs = {
            run.key: run
            for name in known
            for run in (known[name]["associated"], known[name]["tracks"])
        }
        runs |= {setting.key: setting for setting in settings}
        scored: list[Any] = evaluation.scores(list(runs.values()), caught=False)
        scores = dict(zip(runs, scored, strict=True))
        own = {
            name: References(
                associated=scores[found["associated"].key],
                tracks=scores[found["tracks"].key],
            )
            for name, found in known.items()
        }
        report, _ = evaluation.report(
            [scores[setting.key] for setting in settings], settings, references=own
        )
    conditions = {
        "env": env_id,
        "definitions": report.definitions,
        "split": report.condition["split"],
        "card": report.condition["card"],
        "detections": report.condition["detections"],
        "trained": report.condition.get("trained", ""),
    }
    return [
        {
            **conditions,
            "agent": row.agent,
            "scenes": row.scenes,
            "seeds": row.seeds,
            "targets": row.targets,
            "error": round(row.error or 0.0, DIGITS),
            "parts": {
                key: round(getattr(row, f"cost_{key}") or 0.0, DIGITS)
                for key in PART_NAMES
            },
        }
        for row in report.rows
        if row.subset == "all"
    ]


def main() -> None:
    """Measure the environments one after the other; the file is written after each."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--env", action="append", choices=ENVS, help="may be repeated; default: all"
    )
    parser.add_argument("--data", help="data root; else MTP_BENCH_DATA")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--scenes", type=int, help="only the first N; default: all")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    for env_id in given.env or ENVS:
        rows = (
            json.loads(given.output.read_text(encoding="utf-8"))
            if given.output.is_file()
            else []
        )
        options = RunOptions(
            given.data,
            given.scenes,
            seeds=tuple(range(given.seeds)),
            workers=Workers(given.jobs),
        )
        rows = [row for row in rows if row["env"] != env_id] + measure(env_id, options)
        rows.sort(key=lambda row: (ENVS.index(row["env"]), AGENTS.index(row["agent"])))
        write_text(given.output, json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
