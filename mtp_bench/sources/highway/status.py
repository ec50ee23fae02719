"""How much of the simulated traffic is generated, for ``mtp-bench data``."""

from __future__ import annotations

from collections import Counter

from ...cards import Card
from ..cache import VARIABLE
from ..dataset import DataCheck, Dataset, DataStatus
from .source import HighwayTraffic, seed_of

DATASET = Dataset(
    name="simulated traffic",
    folders=(),
    layout="",
    licence="simulated with highway-env (MIT); detector noise fitted to real detectors, see the profile's source",
    citation="E. Leurent: An environment for autonomous driving decision-making. 2018 (highway-env)",
    how_to_get=f"nothing to get: generated once and kept in the folder that {VARIABLE} names",
    generated=True,
)


def highway_status(card: Card, data: object = None) -> DataStatus:
    """What is in the cache; nothing is ever missing, since a scene is made when it is first used."""
    source = HighwayTraffic(card)
    found = DataStatus(DATASET, source.store.folder, (source.store.folder,))
    worlds = [world for world in (source.store.read(seed_of(name)) for name in source.names) if world is not None]
    found.notes.append("simulated scenes are generated when they are first used, and kept")
    if worlds:
        reasons = Counter(reason for world in worlds for reason in world.rejected)
        attempts = len(worlds) + sum(reasons.values())
        listed = f" ({', '.join(f'{reason} {count}' for reason, count in sorted(reasons.items()))})" if reasons else ""
        share = 100 * sum(reasons.values()) / attempts
        found.notes.append(f"{share:.0f} % of {attempts} attempts rejected{listed}; all scenes are crash-free")
    found.checks.append(DataCheck("scenes generated", len(worlds), len(source.names)))
    return found
