"""Agreement of two environments on the order of agents, from the records of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks.kendall import Array, kendall_tau
from mtp_bench.core import Column, Table, Value
from mtp_bench.core.errors import UnknownNameError
from mtp_bench.scoring.definitions import Subset
from mtp_bench.scoring.rank import why_not_on
from mtp_bench.viz.board.entries import Entry, by_board

AGENTS = (  # neither references, nor those that come last everywhere
    "stp",
    "mtp",
    "stp_min_score",
    "mtp_min_score",
    "ab3dmot",
    "stp_same_samples",
    "stp_hedged",
    "stp_modes",
    "mtp_modes",
    "stp_modes_tracklets",
    "mtp_modes_tracklets",
    "tracking_free",
    "affinity",
    "stp_ptp",
    "mtp_ptp",
)
RESAMPLES = 2000


class Agreement(NamedTuple):
    """Entries of the same agents in two environments, in the same order."""

    one: list[Entry]
    other: list[Entry]

    def tau(self, subset: Subset) -> tuple[float, float, float] | None:
        """Kendall's tau of bADE and its 95 % interval over units of both; None where one does not rank the subset."""
        rng = np.random.default_rng(0)
        one, other = (_drawn(entries, subset, rng) for entries in self)
        if one is None or other is None:
            return None
        (tau,), resampled = (
            kendall_tau(here, there) for here, there in zip(one, other, strict=True)
        )
        low, high = np.quantile(resampled, [0.025, 0.975])
        return float(tau), float(low), float(high)


def agreement_table(
    env_id: str,
    others: Sequence[str],
    entries: Sequence[Entry],
    where: dict[Subset, str],
) -> Table:
    """Kendall's tau of the order of agents with that of an environment: a row for each other, a column per subset.

    Raises UnknownNameError for an environment without records of at least two of `AGENTS`.
    """
    known: dict[str, dict[str, Entry]] = {}
    for listed in by_board(entries).values():
        of = {
            entry.name: entry
            for entry in listed
            if entry.name in AGENTS and entry.compared
        }
        if len(of) > 1:
            known.setdefault(listed[0].env, of)
    if missing := {env_id, *others} - {*known}:
        raise UnknownNameError("environment", min(missing), sorted(known))
    rows = [_agreement(known[env_id], known[other]) for other in others]
    columns = [
        Column("environment", key="env", read=lambda row: row.other[0].env),
        Column("agents", key="agents", read=lambda row: len(row.other)),
    ]
    for subset, heading in where.items():
        columns += [
            Column(
                heading,
                key=subset,
                format=".2f",
                read=partial(_part, subset, lambda found: found[0]),
            ),
            Column(
                interval=True,
                key=f"{subset}_interval",
                format=".2f",
                read=partial(_part, subset, lambda f: f[1:]),
            ),
        ]
    return Table("agreement", f"Agreement with {env_id}", "", rows, columns)


def _agreement(one: dict[str, Entry], other: dict[str, Entry]) -> Agreement:
    names = [name for name in AGENTS if name in one and name in other]
    return Agreement([one[name] for name in names], [other[name] for name in names])


def _part(
    subset: Subset, of: Callable[[tuple[float, float, float]], Value], row: Agreement
) -> Value:
    found = row.tau(subset)
    return None if found is None else of(found)


def _drawn(
    entries: Sequence[Entry], subset: Subset, rng: np.random.Generator
) -> tuple[Array, Array] | None:
    """BADE of entries over all units [A, 1], and over units drawn again [A, B]; None where the subset is not ranked."""
    weight = entries[0].sums_on(subset).weight
    if why_not_on(subset, entries[0].sums_on(subset)) is not None:
        return None
    errors, units = (
        np.array([entry.sums_on(subset).error for entry in entries]),
        len(weight),
    )
    whole, drawn = np.arange(units)[None], rng.integers(units, size=(RESAMPLES, units))
    one, other = (
        errors[:, rows].sum(2) / np.maximum(weight[rows].sum(1), 1e-9)
        for rows in (whole, drawn)
    )
    return one, other
