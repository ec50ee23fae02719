"""Environments of highway-env: ``[source]``, and scenes in which no vehicle crashes."""

import hashlib
import importlib.util
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ...cards import Card, SourceSection, Traits
from ...core import CardError, DataError, long_work, rule, say_once
from ...sources import Dataset, section_of
from ..highway.source import TrafficScenes, WorldStore, stride_of
from ..highway.world import GymTraffic, SeedRanges, World

_POLICY = rule(
    lambda name: name in ("idm", "idle") or ":" in name,
    "expected 'idm', 'idle' or 'module:function'",
)


class GymSource(SourceSection):
    """An environment of highway-env by its Gymnasium id, one scene per seed.

    It needs a ``[detector]``.
    """

    splits = ("train", "val", "test")

    # such as "intersection-v1", or "my_module:MyEnv-v0"
    id: Annotated[str, Field(min_length=1)]
    # Python module that registers the id, if the id does not name it
    module: str | None = None
    # configuration of the environment
    config: dict[str, Any] = Field(default_factory=dict)
    # driver of the vehicle with the sensor: "idm", "idle", or "my_module:function", a
    # function of the observation
    policy: Annotated[str, _POLICY] = "idm"
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


def traffic_of(section: GymSource) -> GymTraffic:
    """Return the traffic of a card's section.

    Raises CardError for a missing module.
    """
    texts = [text for text in (section.id, section.policy) if ":" in text]
    modules = [text.partition(":")[0] for text in texts]
    if section.module:
        modules.append(section.module)
    contents = [_file_of(module).read_bytes() for module in modules]
    return GymTraffic(
        section.id,
        tuple(modules),
        tuple(hashlib.sha256(content).hexdigest() for content in contents),
        section.config,
        section.policy,
        section.seconds,
    )


def _file_of(module: str) -> Path:
    with suppress(ImportError):
        spec = importlib.util.find_spec(module)
        if spec is not None and spec.has_location and spec.origin:
            return Path(spec.origin)
    raise CardError(
        f"no module {module!r}, which [source] names;"
        " install it, or name its folder in PYTHONPATH"
    )


DATASET = Dataset.of(__file__)


class GymScenes(TrafficScenes):
    """Scenes of all seeds without a crash.

    The first controlled vehicle carries the sensor.
    """

    def __init__(self, card: Card) -> None:
        """Raise CardError for a class or module that is missing."""
        section = section_of(card, GymSource)
        store = WorldStore(traffic_of(section), _simulate)
        super().__init__(card, store, section.seeds)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scenes without a crash.

        Simulates the seeds that are not in the cache. Raises DataError if no scene is
        left.
        """
        return self._whole_scenes

    @cached_property
    def _whole_scenes(self) -> tuple[str, ...]:
        names = []
        with long_work(f"simulating {self.store.traffic.id}") as work:
            work.started(len(self.missing()))
            for seed in self.seeds:
                name = self.name_of(seed)
                if len(self.store.get(seed).time):
                    names.append(name)
                work.done(name)
        total = len(self.seeds)
        crashes = f"vehicles crash in {total - len(names)} of {total} scenes"
        if not names:
            raise DataError(
                f"{self.card.id}: {crashes}, expected one without;"
                " ask for fewer seconds or vehicles, or other seeds"
            )
        if len(names) < total:
            say_once(f"{self.card.id}: {crashes}, which are left out")
        return tuple(names)

    def missing(self, scenes: int | None = None) -> list[int]:
        """Return all seeds that are not in the cache.

        ``scenes`` does not limit them, since the first seeds may crash. Raises
        CardError if their simulation does not have the card's rate.
        """
        seeds = super().missing()
        if seeds:
            from .simulate import checked_rate  # imports highway-env

            advice = "; or set config = { simulation_frequency = ... }"
            rate = checked_rate(self.store.traffic, seeds[0])
            stride_of(self.card, rate, advice)
        return seeds


def _simulate(traffic: GymTraffic, seed: int) -> World:
    from .simulate import simulate  # imports highway-env

    return simulate(traffic, seed)
