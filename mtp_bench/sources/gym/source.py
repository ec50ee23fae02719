"""Scenes of highway-env's Gymnasium environments: worlds from the cache, without those in which vehicles crash."""

from functools import cached_property
from typing import Annotated, Any

from pydantic import Field

from ... import notice
from ...cards import Card
from ...cards.source import SourceSection, Traits
from ...errors import DataError
from ...strict import rule
from ...types import Scene
from ..base import Work, require_classes, section_of
from ..dataset import Dataset, DataStatus
from ..highway.source import scene_name, scene_of, seed_of, stride_of
from ..highway.store import WorldStore
from ..highway.world import CLASSES, SeedRanges
from .traffic import traffic_of

DATASET = Dataset.of(__file__)
_POLICY = rule(lambda name: name in ("idm", "idle") or ":" in name, "expected 'idm', 'idle' or 'module:function'")


class GymSource(SourceSection):
    """An environment of highway-env by its Gymnasium id, one scene per seed; needs a ``[detector]``."""

    splits = ("train", "val", "test")

    id: Annotated[str, Field(min_length=1)]  # such as "intersection-v1", or "my_module:MyEnv-v0"
    module: str | None = None  # Python module that registers the id, if the id does not name it
    config: dict[str, Any] = Field(default_factory=dict)  # of the environment
    policy: Annotated[str, _POLICY] = (
        "idm"  # of the vehicle with the sensor: "idm", "idle", or "my_module:function" of the observation
    )
    seconds: Annotated[float, Field(gt=0, le=600)] = 20.0
    seeds: SeedRanges = SeedRanges(train=(0, 100), val=(10000, 10030), test=(20000, 20030))

    @property
    def traits(self) -> Traits:
        """Abilities of the source."""
        return Traits(without_detections="an environment of highway-env", scene_seconds=self.seconds, lanes=True)


class GymScenes:
    """Scenes of one split, named by id and seed: of all seeds without a crash.

    Frame of reference and targets are those of `sources.highway`. The first controlled vehicle carries the sensor.
    """

    def __init__(self, card: Card, data: object = None) -> None:
        """``data``: not needed. Raises CardError for a class or module that there is not."""
        self.card, section = card, section_of(card, GymSource)
        require_classes(card, DATASET.name, CLASSES)
        self.traffic = traffic_of(section.id, section.module, section.config, section.policy, section.seconds)
        self.store = WorldStore(self.traffic)
        self.seeds = range(*getattr(section.seeds, section.split))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes; simulates the seeds that are not in the cache. Raises DataError if none is left."""
        kept = []
        with notice.work(f"simulating {self.traffic.id}") as work:
            work.started(len(self.missing()))
            for seed in self.seeds:
                kept += [self.name_of(seed)] if len(self.store.get(seed).time) else []
                work.done(self.name_of(seed))
        crashed = f"{self.card.id}: vehicles crash in {len(self.seeds) - len(kept)} of {len(self.seeds)} scenes"
        if not kept:
            raise DataError(f"{crashed}, expected one without; ask for fewer seconds or vehicles, or other seeds")
        if len(kept) < len(self.seeds):
            notice.say(f"{crashed}, which are left out")
        return tuple(kept)

    def load(self, name: str) -> Scene:
        """One scene, from the cache or simulated now."""
        return scene_of(name, self.store.get(seed_of(name)), self.card)

    def name_of(self, seed: int) -> str:
        """Name of the scene of one seed."""
        return scene_name(self.traffic.scenario, seed)

    def missing(self) -> list[int]:
        """Seeds that are not in the cache; raises CardError if their simulation does not have the card's rate."""
        seeds = [seed for seed in self.seeds if self.store.read(seed) is None]
        if seeds:
            from .simulate import simulation_rate  # imports highway-env

            advice = "; or set config = { simulation_frequency = ... }"
            stride_of(self.card, simulation_rate(self.traffic), advice)
        return seeds

    def discard(self) -> None:
        """Remove all scenes of the split from the cache."""
        for seed in self.seeds:
            self.store.path(seed).unlink(missing_ok=True)


def generate(card: Card, data: object, scenes: int | None, workers: int) -> Work:
    """Simulate the seeds of the card that are not in the cache: all, since some of them crash."""
    source = GymScenes(card)
    seeds = source.missing()
    return len(seeds), (source.name_of(seed) for seed in source.store.make(seeds, workers))


def gym_status(card: Card, data: object = None) -> DataStatus:
    """Status of the cache; scenes are never missing, as each is simulated when it is first used."""
    source = GymScenes(card)
    return DataStatus(DATASET, source.store.folder, (source.store.folder,))
