"""The pools of samples that objects have, from what is said of the tracks that stand for them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Bools, Floats, Ints, Task
from .protocols import Forecasts, Sampler


class Pool(NamedTuple):
    """Forecast rows of O objects, each once however many hypotheses hold it: E entries, the objects one after another.

    Most objects have one entry. Those with several are what the sampler is for.
    """

    start: Ints  # [O + 1]
    row: Ints  # [E] of the forecasts
    log_mass: Floats  # [E] of the hypotheses that hold it


def pool_of(row: Ints, log_weight: Floats) -> Pool:
    """The pool of objects that the hypotheses, weighted ``log_weight`` [H], hold as ``row`` [O, H]; -1: not at all."""
    holder, hypothesis = np.nonzero(row >= 0)
    held = row[holder, hypothesis]
    order = np.lexsort((hypothesis, held, holder))
    holder, held, mass = holder[order], held[order], log_weight[hypothesis[order]]
    first = np.flatnonzero(np.append(True, (np.diff(holder) != 0) | (np.diff(held) != 0))[: len(held)])
    start = np.searchsorted(holder[first], np.arange(len(row) + 1))
    # As logarithms: an object of very unlikely hypotheses must not come to a mass of 0.
    total = np.logaddexp.reduceat(mass, first) if len(first) else mass
    return Pool(start, held[first], total)


def reduced(
    pool: Pool, said: Forecasts, task: Task, sampler: Sampler, rng: np.random.Generator, at_once: int
) -> tuple[Floats, Floats]:
    """Samples [O, K, T, 2] and log-weights [O, K] of the objects of a pool; -inf for samples that are not there.

    Only objects with more than K samples go through the sampler, as pools of ``at_once`` samples at most.
    """
    each, future = said.samples.shape[1:3]
    weight = normalised(said)
    size = np.diff(pool.start) * each
    samples = np.zeros((len(size), task.samples, future, 2))
    log_weight = np.full(samples.shape[:2], -np.inf)
    few = size <= task.samples
    owner, place = _places(pool.start, few)
    entry, slot = pool.start[owner] + place, place[:, None] * each + np.arange(each)
    samples[owner[:, None], slot] = said.samples[pool.row[entry]]
    log_weight[owner[:, None], slot] = weight[pool.row[entry]] + pool.log_mass[entry][:, None]
    for objects in _chunks(np.flatnonzero(~few), size, at_once):
        found = sampler.reduce(*_padded(pool, objects, said.samples, weight), task.samples, rng)
        samples[objects], log_weight[objects] = found
    return samples, log_weight


def normalised(said: Forecasts) -> Floats:
    """Log-weights [R, S] whose weights sum to 1 in each row; -inf throughout where nothing is said."""
    if said.log_weight is None:
        return np.full(said.samples.shape[:2], -np.log(max(said.samples.shape[1], 1)))
    total = np.logaddexp.reduce(said.log_weight, axis=1, keepdims=True)
    return np.where(np.isfinite(total), said.log_weight - np.where(np.isfinite(total), total, 0.0), -np.inf)


def _places(start: Ints, wanted: Bools) -> tuple[Ints, Ints]:
    """The owner and the place among its entries of every entry of the ``wanted`` [O] objects."""
    count = np.where(wanted, np.diff(start), 0)
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def _padded(pool: Pool, objects: Ints, samples: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """The pool of some objects as a table: samples [o, S, T, 2] and log-weights [o, S], -inf where there is none."""
    wanted = np.zeros(len(pool.start) - 1, dtype=bool)
    wanted[objects] = True
    owner, place = _places(pool.start, wanted)
    entry, at = pool.start[owner] + place, np.searchsorted(objects, owner)
    each, future = samples.shape[1:3]
    table = np.zeros((len(objects), place.max(initial=-1) + 1, each, future, 2))
    log_weight = np.full(table.shape[:3], -np.inf)
    table[at, place] = samples[pool.row[entry]]
    log_weight[at, place] = weight[pool.row[entry]] + pool.log_mass[entry][:, None]
    return table.reshape(len(objects), -1, future, 2), log_weight.reshape(len(objects), -1)


def _chunks(objects: Ints, size: Ints, at_once: int) -> list[Ints]:
    """The objects in groups whose tables have ``at_once`` samples at most, or a single object."""
    if len(objects) == 0:
        return []
    each = max(1, at_once // int(size[objects].max()))
    return np.array_split(objects, range(each, len(objects), each))
