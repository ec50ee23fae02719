"""Compare two versions of the library: contents of rollouts and every number of `compare`.

    python benchmarks/same_results.py -o before.json --checkout ../old   # a checkout of the older commit
    python benchmarks/same_results.py -o after.json --against before.json

Eight baselines or more play a few scenes of each environment, with learned ones where weights ship; the arrays of
rollouts are read field by field, not by the digest, which a change of a record's form may change. Needs
MTP_BENCH_DATA or --data. --quick: few agents on few environments, in two minutes. Exit status 1: something differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
SCENES = {
    "MTP-Intersection-v0": 3,
    "MTP-KITTI-v0": 2,
    "MTP-nuScenes-mini-v0": 2,
    "MTP-WILDTRACK-v0": None,
    "MTP-PETS-v0": None,
    "MTP-Highway-v0": 2,
    "MTP-Merge-v0": 2,
    "MTP-Roundabout-v0": 2,
    "MTP-IntersectionRaw-v0": 2,
    "MTP-KITTI-5Hz-v0": 2,
    "MTP-KITTI-noego-v0": 2,
    "MTP-WILDTRACK-k10-v0": None,
    "MTP-AV2-v0": None,
    "MTP-AV2-10Hz-v0": 2,
    "MTP-nuScenes-v0": 2,
    "MTP-nuScenes-CenterPoint-v0": 2,  # with --env alone: it needs the validation scenes
}
AGENTS = (
    "gt_tracks", "stp", "stp_same_samples", "stp_hedged", "mtp", "ab3dmot", "stp_min_score", "mtp_min_score",
)  # fmt: skip
LEARNED = ("mtp_modes", "stp_modes_tracklets", "gt_tracks_modes", "mtp_ptp", "affinity", "tracking_free")
WEIGHTS = {"MTP-Intersection-v0": LEARNED, "MTP-Highway-v0": LEARNED[:4]}  # what ships with the package
TRAIN = ("MTP-nuScenes-v0",)  # on its training scenes, which the test data has
QUICK = ("MTP-Intersection-v0", "MTP-KITTI-v0", "MTP-nuScenes-mini-v0", "MTP-WILDTRACK-v0")
NOT_RESULTS = ("seconds", "scene")  # of a stored rollout
TIMES = ("ms_per_frame",)  # of a row
START = """
try:
    from mtp_bench.commands.app import main
except ImportError:  # version 0.1
    from mtp_bench.cli import main
main()
"""


def command(checkout: Path, *arguments: str) -> None:
    """Run `mtp-bench` of a checkout, whichever version is installed."""
    # -c puts the working folder before everything else: it must be the checkout too
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    program = [sys.executable, "-c", START, *arguments]
    subprocess.run(program, cwd=checkout, env=environment, check=True, stdout=subprocess.DEVNULL)


def rollouts(folder: Path) -> dict[str, str]:
    """A hash of each array of each stored scene, by `scene/array`; times are left out."""
    hashes = {}
    for path in sorted(folder.glob("*.npz")):
        with np.load(path) as arrays:
            for name in sorted(arrays.files):
                if name not in NOT_RESULTS:
                    array = np.ascontiguousarray(_as_planes(name, arrays[name]))
                    content = f"{array.dtype.str}{array.shape}".encode() + array.tobytes()
                    hashes[f"{path.stem}/{name}"] = hashlib.sha256(content).hexdigest()[:16]
    return hashes


def _as_planes(name: str, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """A stored array in the form of version 0.2: floats and differences of forecasts as planes of bytes."""
    if name == "forecast" and array.dtype == np.int16:
        array = (array << 1) ^ (array >> 15)
    elif array.dtype.kind != "f":
        return array
    return np.moveaxis(np.ascontiguousarray(array)[..., None].view(np.uint8), -1, 0)


def rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a comparison, without times."""
    found = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return [{key: value for key, value in row.items() if key not in TIMES} for row in found]


def results(
    checkout: Path, data: str, scenes: dict[str, int | None], file: Path, quick: bool = False
) -> dict[str, Any]:
    """Rollouts and scores of every baseline on every environment, from `run` and `compare` of a checkout.

    ``file`` has those of the finished environments.
    """
    made: dict[str, Any] = {}
    for env, count in scenes.items():
        some = [] if count is None else ["--scenes", str(count)]
        common = ["--env", env, "--data", data, *some, *(["--split", "train"] if env in TRAIN else [])]
        with tempfile.TemporaryDirectory() as folder:
            answers = {}
            agents = (*(AGENTS[:5] if quick else AGENTS), *WEIGHTS.get(env, ())[: 2 if quick else None])
            for agent in agents:
                print(f"{env}: {agent}", file=sys.stderr, flush=True)
                output = Path(folder, agent)
                command(checkout, "run", agent, "-o", str(output), *common)
                answers[agent] = rollouts(output)
            print(f"{env}: compare", file=sys.stderr, flush=True)
            table = Path(folder, "compare.json")
            command(checkout, "compare", *agents, "--json", str(table), *common)
            made[env] = {"rollouts": answers, "rows": rows(table)}
        file.write_text(json.dumps(made, indent=1, sort_keys=True), encoding="utf-8")
    return made


def differences(before: Any, after: Any, where: str = "") -> list[str]:
    """Places where two contents differ, a key that only one has included."""
    if isinstance(before, dict) and isinstance(after, dict):
        keys = sorted({*before, *after})
        return [line for key in keys for line in differences(before.get(key), after.get(key), f"{where}/{key}")]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = enumerate(zip(before, after, strict=True))
        return [line for place, pair in pairs for line in differences(*pair, f"{where}/{place}")]
    return [] if before == after else [f"{where}: {before!r} -> {after!r}"]


def main() -> None:
    """Make the results of a checkout and, with --against, list what differs from another's."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True, help="file for the results")
    parser.add_argument("--checkout", type=Path, default=ROOT, help="the version to run; default: this one")
    parser.add_argument("--data", default=os.environ.get("MTP_BENCH_DATA"), help="data root; else MTP_BENCH_DATA")
    parser.add_argument("--against", type=Path, help="results of another version")
    parser.add_argument("--env", choices=SCENES, action="append", help="only this environment")
    parser.add_argument("--quick", action="store_true", help="few agents on few environments")
    options = parser.parse_args()
    if options.data is None:
        parser.error("no data root: give --data or set MTP_BENCH_DATA")
    wanted = options.env or (QUICK if options.quick else tuple(SCENES)[:-1])
    chosen = {env: 1 if options.quick else count for env, count in SCENES.items() if env in wanted}
    made = results(options.checkout.resolve(), str(Path(options.data).resolve()), chosen, options.output, options.quick)
    if options.against is None:
        return
    before = {env: part for env, part in json.loads(options.against.read_text()).items() if env in chosen}
    found = differences(before, made)
    count = sum(len(arrays) for part in made.values() for arrays in part["rollouts"].values())
    numbers = sum(len(row) for part in made.values() for row in part["rows"])
    print("\n".join(found) if found else f"the same: {count} arrays of rollouts, {numbers} entries of rows")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
