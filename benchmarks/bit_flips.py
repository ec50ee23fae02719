"""Flip single bits of the files of a cache, and count what becomes of them: nothing may differ.

    python benchmarks/bit_flips.py [--rounds 4] [--flips 3] [--seed 0] [--json FILE]

Each round flips bits at random places of random files of each kind and starts a new process, which runs `mtp` in the
sandbox on a simulated scene and on a scene of a small nuScenes root, and reads all scenes and images of that root. The
cache lies in a temporary folder. No data is needed. A bit can be flipped unnoticed where its file is not read, or where
the content of the file remains the same.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from mtp_bench import load_card
from mtp_bench.judge.gateway.layout import compiled_kernels
from mtp_bench.judge.gateway.run import run_isolated_scenes
from mtp_bench.running.playing import compile_kernels
from mtp_bench.sources import camera_images, open_source
from mtp_bench.sources.cache import scene_digest
from tests.support.camera_images import write_cameras
from tests.support.nuscenes_root import SCENES, write_root

KINDS = {
    "compiled kernel": "kernels/*/*/*",
    "simulated world": "cache/worlds/*/*.npz",
    "nuScenes tables": "cache/nuscenes/v1.0-mini-" + 16 * "?" + "/*.npz",
    "nuScenes detections": "cache/nuscenes/v1.0-mini-"
    + 16 * "?"
    + "-"
    + 16 * "?"
    + "/*.npz",
    "nuScenes cameras": "cache/nuscenes/*-cameras-*/*.npz",
}
REPORT = "mtp_bench: "  # begins a line on stderr


def use_cache(folder: Path) -> None:
    """Print what runs and images say, as JSON: a digest, and the reasons of agents that failed."""
    digest, failed = hashlib.sha256(), []
    for env, keywords, scenes in (
        (
            "MTP-Intersection-v0",
            {},
            open_source(load_card("MTP-Intersection-v0")).names[:1],
        ),
        ("MTP-nuScenes-mini-v0", {"data": str(folder / "data")}, SCENES[:1]),
    ):
        for run in run_isolated_scenes("mtp", env, keywords, scenes=scenes):
            failed += [run.reason] * (run.status != "finished")
            digest.update(run.scene_digest.encode())
            for name, value in sorted(vars(run.rollout).items()):
                if isinstance(value, np.ndarray) and name != "seconds":
                    digest.update(value.tobytes())
    card = load_card("MTP-nuScenes-mini-v0")
    for name in SCENES:
        scene = open_source(card, folder / "data").load(name)
        digest.update(scene_digest(scene).encode())
        notes: list[str] = []
        for image in camera_images(scene, card, folder / "data", notes.append):
            digest.update(
                repr(
                    (
                        image.frame,
                        image.camera,
                        image.path,
                        image.size,
                        image.projection.tolist(),
                    )
                ).encode()
            )
        digest.update("".join(notes).encode())
    print(json.dumps({"digest": digest.hexdigest(), "failed": failed}))


def answer_of(folder: Path) -> tuple[dict[str, Any] | None, str]:
    """Output of a new process with this cache, None if it fails, and its stderr."""
    places = {
        "MTP_BENCH_CACHE": str(folder / "cache"),
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
    }
    command = [sys.executable, __file__, "--use", str(folder)]
    root = Path(__file__).resolve().parent.parent
    environment = {**os.environ, **places, "PYTHONPATH": str(root)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False
    )
    return (json.loads(done.stdout) if done.returncode == 0 else None), done.stderr


def flip(file: Path, chance: random.Random) -> None:
    """Flip one bit."""
    content = bytearray(file.read_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    file.write_bytes(content)


def main() -> int:
    """Flip bits as the command line says; exit status 1 after a crash, another number or a failed agent."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--flips", type=int, default=3, help="of each kind in a round")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--use", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.use:
        use_cache(given.use)
        return 0
    chance, counts = random.Random(given.seed), {kind: Counter[str]() for kind in KINDS}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_cameras(write_root(folder / "data"))
        compile_kernels()
        for compiled in compiled_kernels():
            shutil.copytree(compiled, folder / "kernels" / compiled.name)
        expected, said = answer_of(folder)
        if expected is None or expected["failed"]:
            print(said, expected)
            return 1
        for _ in range(given.rounds):
            flipped = [
                (kind, chance.choice(sorted(folder.glob(KINDS[kind]))))
                for kind in KINDS
                for _ in range(given.flips)
            ]
            for _, file in flipped:
                flip(file, chance)
            answer, said = answer_of(folder)
            lines = [line for line in said.splitlines() if line.startswith(REPORT)]
            print(
                f"{len(flipped)} bits flipped: {answer}",
                *lines,
                sep="\n  ",
                file=sys.stderr,
                flush=True,
            )
            for kind, file in flipped:
                place = file.parent.parent if kind == "compiled kernel" else file.parent
                counts[kind]["flips"] += 1
                counts[kind]["noticed"] += any(str(place) in line for line in lines)
                counts[kind]["crashed"] += answer is None
                counts[kind]["other numbers"] += (
                    answer is not None and answer["digest"] != expected["digest"]
                )
                counts[kind]["agent blamed"] += answer is not None and bool(
                    answer["failed"]
                )
    columns = ("flips", "noticed", "crashed", "other numbers", "agent blamed")
    print(f"{'':20}" + "".join(f"{column:>15}" for column in columns))
    for kind, row in counts.items():
        print(f"{kind:20}" + "".join(f"{row[column]:15}" for column in columns))
    if given.json:
        given.json.write_text(json.dumps(counts, indent=1) + "\n")
    return int(any(row[column] for row in counts.values() for column in columns[2:]))


if __name__ == "__main__":
    sys.exit(main())
