"""Variants of a profile of model 1: without memory, and harder."""

from __future__ import annotations

from ..sections import more
from .profile import ClassNoise, FalsePositives, PositionNoise, UndetectedNoise

MISSES = 1.0  # added to the log-odds that an object is undetected


def without_memory(noise: ClassNoise) -> ClassNoise:
    """The same recall and margins; every frame of an object is drawn anew."""
    white = {"bias": 0.0, "ar": 0.0, "white": 1.0}
    false = noise.false_positives
    return noise.model_copy(
        update={
            "miss": noise.miss.model_copy(update={"memory": False}),
            "radial": noise.radial.model_copy(update=white),
            "tangential": noise.tangential.model_copy(update=white),
            "heading": noise.heading.without_memory(),
            "size": noise.size.model_copy(update={"white": 1.0}),
            "score": noise.score.model_copy(update=white),
            "false_positives": None if false is None else false.model_copy(update={"survive": 0.0}),
        }
    )


def harder(noise: ClassNoise, worse: float) -> ClassNoise:
    """Log-odds of being undetected + 1; position errors and false positives x ``worse``."""
    false = noise.false_positives
    return noise.model_copy(
        update={
            "miss": _more_undetected(noise.miss),
            "radial": _wider(noise.radial, worse),
            "tangential": _wider(noise.tangential, worse),
            "false_positives": None if false is None else _more(false, worse),
        }
    )


def _more_undetected(miss: UndetectedNoise) -> UndetectedNoise:
    first, later = miss.first, miss.later
    return miss.model_copy(update={"first": (first[0] + MISSES, *first[1:]), "later": (later[0] + MISSES, *later[1:])})


def _wider(axis: PositionNoise, worse: float) -> PositionNoise:
    return axis.model_copy(update={"s0": worse * axis.s0, "s1": worse * axis.s1})


def _more(false: FalsePositives, factor: float) -> FalsePositives:
    return false.model_copy(update=more(false.rate, false.dispersion, factor))
