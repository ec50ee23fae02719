"""What tests of simulated worlds share: a hash, a look for overlaps, and worlds of another process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from shapely import STRtree
from shapely.geometry import Polygon

from mtp_bench.geometry import bev_corners
from mtp_bench.sources.cache import content_hash
from mtp_bench.sources.highway.store import pack
from mtp_bench.sources.highway.world import World
from mtp_bench.types import Truth


def digest(world: World) -> str:
    return content_hash(pack(world))


def touching(truth: Truth, every: int = 1) -> int:
    """How many pairs of boxes intersect, in every so-manieth frame."""
    found = 0
    for t in range(0, truth.frames, every):
        shapes = [Polygon(corners) for corners in bev_corners(truth.box[truth.rows(t)])]
        a, b = STRtree(shapes).query(shapes, predicate="intersects")
        found += int((a < b).sum())
    return found


def digests_elsewhere(module: str, names: list[str], seed: int) -> list[str]:
    """Digests of the worlds of ``module.CASES`` made in another process with another hash seed."""
    code = (
        f"from tests.{module} import CASES\n"
        "from tests.support.highway_worlds import digest\n"
        "from mtp_bench.sources.highway.simulate import simulate_world\n"
        f"for name in {names!r}: print(digest(simulate_world(CASES[name], {seed})))"
    )
    command = [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    root = Path(__file__).parents[2]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=root).stdout.split()
