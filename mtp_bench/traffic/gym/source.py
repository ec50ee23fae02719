"""Scenes of highway-env's Gymnasium environments: worlds from the cache, without those in which vehicles crash."""

import hashlib
import importlib.util
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ...cards import Card, SourceSection, Traits
from ...core import CardError, DataError, long_work, rule, say_once
from ...sources import Dataset, section_of
from ..highway.source import TrafficScenes, stride_of
from ..highway.world import SeedRanges, World

DATASET = Dataset.of(__file__)
_POLICY = rule(
    lambda name: name in ("idm", "idle") or ":" in name,
    "expected 'idm', 'idle' or 'module:function'",
)


class GymSource(SourceSection):
    """An environment of highway-env by its Gymnasium id, one scene per seed; needs a ``[detector]``."""

    splits = ("train", "val", "test")

    id: Annotated[
        str, Field(min_length=1)
    ]  # such as "intersection-v1", or "my_module:MyEnv-v0"
    module: str | None = (
        None  # Python module that registers the id, if the id does not name it
    )
    config: dict[str, Any] = Field(default_factory=dict)  # of the environment
    policy: Annotated[str, _POLICY] = (
        "idm"  # of the vehicle with the sensor: "idm", "idle", or "my_module:function" of the observation
    )
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    seeds: SeedRanges = SeedRanges(
        train=(0, 100), val=(10000, 10030), test=(20000, 20030)
    )

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(
            without_detections="an environment of highway-env",
            scene_seconds=self.seconds,
            lanes=True,
        )


class GymScenes(TrafficScenes):
    """Scenes of all seeds without a crash; the first controlled vehicle carries the sensor."""

    def __init__(self, card: Card) -> None:
        """Raises CardError for a class or module that there is not."""
        section = section_of(card, GymSource)
        super().__init__(card, traffic_of(section), section.seeds)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes; simulates the seeds that are not in the cache. Raises DataError if none is left."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        kept = []
        with long_work(f"simulating {self.store.traffic.id}") as work:
            work.started(len(self.missing()))
            for seed in self.seeds:
                kept += [seed] if len(self.store.get(seed).time) else []
                work.done(self.name_of(seed))
        crashed = f"{self.card.id}: vehicles crash in {len(self.seeds) - len(kept)} of {len(self.seeds)} scenes"
        if not kept:
            raise DataError(
                f"{crashed}, expected one without; ask for fewer seconds or vehicles, or other seeds"
            )
        if len(kept) < len(self.seeds):
            say_once(f"{crashed}, which are left out")
        return tuple(map(self.name_of, kept))

    def missing(self, scenes: int | None = None) -> list[int]:
        """All seeds that are not in the cache; raises CardError if their simulation does not have the card's rate."""
        seeds = super().missing()  # some of the first ones may crash
        if seeds:
            from .simulate import simulation_rate  # imports highway-env

            stride_of(
                self.card,
                simulation_rate(self.store.traffic),
                "; or set config = { simulation_frequency = ... }",
            )
        return seeds


@dataclass(frozen=True)
class GymTraffic:
    """Everything that a simulation depends on."""

    id: str
    modules: tuple[
        str, ...
    ]  # that register the id or hold the policy; empty: highway-env, or the running program
    code: tuple[str, ...]  # sha256 of their files
    config: dict[str, Any]
    policy: str
    seconds: float

    @property
    def scenario(self) -> str:
        """The id without its module and namespace: begins the names of folders and scenes."""
        return self.id.rpartition(":")[2].rpartition("/")[2]

    def simulate(self, seed: int) -> World:
        """The world of a seed, see `simulate.simulate`."""
        from .simulate import simulate  # imports highway-env

        return simulate(self, seed)


def traffic_of(section: GymSource) -> GymTraffic:
    """The traffic of a card's section; raises CardError for a module that there is not."""
    named = [
        text.partition(":")[0] for text in (section.id, section.policy) if ":" in text
    ]
    modules = (*named, *filter(None, [section.module]))
    code = tuple(
        hashlib.sha256(_file_of(module).read_bytes()).hexdigest() for module in modules
    )
    return GymTraffic(
        section.id, modules, code, section.config, section.policy, section.seconds
    )


def _file_of(module: str) -> Path:
    with suppress(ImportError):
        found = importlib.util.find_spec(module)
        if found is not None and found.has_location and found.origin:
            return Path(found.origin)
    raise CardError(
        f"no module {module!r}, which [source] names; install it, or name its folder in PYTHONPATH"
    )
