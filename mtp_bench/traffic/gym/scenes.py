"""Scenes of highway-env's environments, without those in which vehicles crash."""

from functools import cached_property

from ...cards import Card
from ...core import DataError, long_work, say_once
from ...sources import Dataset, section_of
from ..highway.source import TrafficScenes, stride_of
from ..highway.store import WorldStore
from ..highway.world import World
from .source import GymSource, GymTraffic, traffic_of

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
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
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

        The first ones may crash. Raises CardError if their simulation does not have the
        card's rate.
        """
        seeds = super().missing()
        if seeds:
            from .simulate import simulation_rate  # imports highway-env

            advice = "; or set config = { simulation_frequency = ... }"
            stride_of(self.card, simulation_rate(self.store.traffic), advice)
        return seeds


def _simulate(traffic: GymTraffic, seed: int) -> World:
    from .simulate import simulate  # imports highway-env

    return simulate(traffic, seed)
