"""Costs of the gateway: milliseconds per frame, and seconds until an agent is built.

    python benchmarks/gateway.py [--frames 300] [--json FILE]

Round trips are those of an agent that repeats an empty answer. The messages are as long as those of a full answer,
whatever it says: arrays are padded. Called directly, the agent takes no time, so all that is measured is the gateway.
No data is needed: observations are drawn from the cards' spaces.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mtp_bench import load_card, load_submission
from mtp_bench.env.environment import MTPEnv
from mtp_bench.env.spaces import ActionSpace, observation_space
from mtp_bench.judge import Limits, run_isolated
from mtp_bench.judge.gateway.exchange import Exchange, answer_bytes
from mtp_bench.judge.gateway.layout import image_of, layout_for
from mtp_bench.judge.gateway.process import AgentProcess, SandboxSpec
from mtp_bench.judge.gateway.sandbox import sandbox_backend

CARDS = ("MTP-KITTI-v0", "MTP-Intersection-v0", "MTP-nuScenes-mini-v0")
STARTED = ("stp", "mtp", "mtp_modes")
AGENT = """
import numpy as np

SHAPES = {shapes!r}


class Same:
    def reset(self, task):
        self.action = {{name: np.zeros(shape, dtype) for name, (shape, dtype) in SHAPES.items()}}

    def act(self, observation):
        return self.action


def build(task):
    return Same()
"""
MANIFEST = 'name = "same"\nauthors = ["mtp_bench"]\nagent = "agent:build"\n'


def measured(env_id: str, frames: int) -> dict[str, float]:
    card = load_card(env_id)
    task = MTPEnv(card).task
    space, observation = ActionSpace(task), observation_space(task).sample()
    shapes = {
        name: (part.shape, str(part.dtype)) for name, part in space.spaces.items()
    }
    limits = Limits()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "agent.py").write_text(AGENT.format(shapes=shapes))
        (folder / "submission.toml").write_text(MANIFEST)
        image = image_of(load_submission(folder), env_id)
        spec = SandboxSpec(layout_for(image, None), image, sandbox_backend())
        with AgentProcess(limits, spec, answer_bytes(space, limits)) as process:
            exchange = Exchange(process, limits, space, b"")
            exchange.open(process.setup({}), asdict(replace(task, seed=0)))
            seconds: list[float] = []
            action: dict[str, Any] | None = None
            for _ in range(frames):
                begin = time.perf_counter()
                action, _ = exchange.ask(observation)
                seconds.append(time.perf_counter() - begin)
                assert action, "the agent did not answer"
    size = sum(array.nbytes for array in (action or {}).values())
    ordered = sorted(seconds[10:])
    return {
        "median_ms": 1e3 * statistics.median(ordered),
        "p95_ms": 1e3 * ordered[int(0.95 * len(ordered))],
        "answer_kib": size / 1024,
        "observation_kib": sum(array.nbytes for array in observation.values()) / 1024,
    }


def start_seconds(
    name: str, env_id: str = "MTP-Intersection-v0", repeats: int = 5
) -> float:
    """Median seconds from the start of an agent's process until it is built."""
    scene = MTPEnv(env_id).scene_names[0]
    return statistics.median(
        run_isolated(name, env_id, {}, scene).started for _ in range(repeats)
    )


def sizes_of(card: Any) -> dict[str, int]:
    return {
        name: getattr(card.size, name)
        for name in ("tracks", "objects", "hypotheses", "detections")
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--json", type=Path, default=None)
    given = parser.parse_args()
    found = {env_id: measured(env_id, given.frames) for env_id in CARDS}
    for env_id, row in found.items():
        times = f"{row['median_ms']:6.2f} ms (p95 {row['p95_ms']:.2f})"
        print(
            f"{env_id:22} {times}  {row['observation_kib']:.0f} KiB asked, {row['answer_kib']:.0f} KiB answered"
        )
    starts = {name: start_seconds(name) for name in STARTED}
    print(
        "; ".join(
            f"{name} starts in {seconds:.2f} s" for name, seconds in starts.items()
        ),
        f"({sandbox_backend()})",
    )
    if given.json is not None:
        given.json.write_text(
            json.dumps({"frames": found, "start_s": starts}, indent=2) + "\n"
        )


if __name__ == "__main__":
    main()
