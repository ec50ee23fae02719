"""The records that figures may come from, by agent and environment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, get_args

from ..._bundle import baseline_names, card_ids
from ...errors import RecordError, UnknownNameError
from ...records.attestation import Checked, SignedLevel
from ...records.eligibility import Ships, why_not_comparable
from ...records.ranking import OTHERS, STP, Place, Standing, conditions, standings
from ...records.record import Record
from ...records.shipped import Shipped, shipped
from ...scoring.rows import Row
from ...scoring.subsets import SUBSETS, Subset

if TYPE_CHECKING:
    from ..board.entries import Entry


@dataclass(frozen=True, eq=False, kw_only=True)
class Scored(Checked):
    """A record whose figures may be told."""

    standing: Standing

    @cached_property
    def conditions(self) -> tuple[object, ...]:
        """What it must share with another one to be compared with it."""
        return conditions(self.sums)

    def row(self, subset: str) -> Row:
        """Its numbers on a subset; UnknownNameError for another name."""
        return self.sums.row_of(subset_of(subset))

    def place(self, subset: str) -> Place:
        """Where it stands on a subset."""
        return self.standing.places[subset_of(subset)]


class Known:
    """Records by agent and environment."""

    def __init__(
        self,
        records: Sequence[Record],
        levels: Mapping[str, SignedLevel] | None = None,
        ships: Ships = shipped,
        places: Mapping[str, Standing] | None = None,
    ) -> None:
        """``levels``: signed levels by the digest of the record; ``ships``: what ships for an env, by its id.

        ``places``: where the records stand, by their digest, if that is known.
        Only finished records of what ships today are taken: others have other scenes, or another scorer. Where a round
        was held, on hidden scenes, records that came after it wait for the next one, and those of an earlier one are
        left out.
        """
        levels = levels or {}
        places = standings(records, levels, ships) if places is None else places
        self._agents = {*baseline_names(), *(record.submission.name for record in records)}
        self._envs = {*card_ids(), *(record.env.id for record in records)}
        self._found: dict[tuple[str, str], Scored] = {}
        self._twice: set[tuple[str, str]] = set()
        self._unfit: dict[tuple[str, str], str] = {}
        checked = [Checked(record, levels.get(record.digest)) for record in records]
        rounds = {each.record.env.id for each in checked if each.on_hidden}
        for each in checked:
            record, key = each.record, (each.record.submission.name, each.record.env.id)
            why = _why_not_taken(each, ships)
            if why is None and record.env.id in rounds and not each.on_hidden:
                why = "not run on the hidden scenes of the last round"
            if why:
                self._unfit[key] = why
                continue
            if key in self._found:
                self._twice.add(key)
            self._found[key] = Scored(record, each.signed, standing=places[record.digest])
        self._drop(lambda scored: scored.place("all").why == OTHERS)
        self._drop(self._unlike_stp)

    def _drop(self, other: Callable[[Scored], bool]) -> None:
        """Leave out records that are of other scenes than those that rank."""
        for key in [key for key, scored in self._found.items() if other(scored)]:
            self._unfit[key] = OTHERS
            del self._found[key]

    def _unlike_stp(self, scored: Scored) -> bool:
        """Whether the record of STP is of other scenes, data or event weights, as one of the open division may be."""
        stp = self._found.get((STP, scored.record.env.id))
        return stp is not None and scored.conditions != stp.conditions

    def __len__(self) -> int:
        return len(self._found)

    @property
    def unused(self) -> list[str]:
        """Records whose figures are not told, each with the reason."""
        return [f"{agent} on {env_id}: {why}" for (agent, env_id), why in sorted(self._unfit.items())]

    def has(self, agents: str | Sequence[str], env_id: str) -> bool:
        """Whether there are records of an agent, or of all of several; UnknownNameError for a misspelt name."""
        names = [agents] if isinstance(agents, str) else agents
        return all(self._get(name, env_id) is not None for name in names)

    def present(self, agents: Sequence[str], env_id: str) -> list[str]:
        """Those of the agents that have a record."""
        return [agent for agent in agents if self._get(agent, env_id) is not None]

    def complete(self, envs: Sequence[tuple[str, str]], agents: Sequence[str]) -> list[tuple[str, str]]:
        """Those of the pairs of a heading and an env in which all of the agents have a record."""
        return [(heading, env_id) for heading, env_id in envs if self.has(agents, env_id)]

    def of(self, agent: str, env_id: str) -> Scored:
        """The record of an agent; RecordError where there is none, UnknownNameError for a misspelt name."""
        found = self._get(agent, env_id)
        if (agent, env_id) in self._twice:
            raise RecordError(f"two records of {agent!r} on {env_id}, expected one")
        if found is not None:
            return found
        why = self._unfit.get((agent, env_id))
        if why is not None:
            raise RecordError(f"the record of {agent!r} on {env_id} cannot be used: {why}")
        raise RecordError(
            f"no record of {agent!r} on {env_id}: make it with `mtp-bench submit`, or write the sentence inside "
            f'{{% if has("{agent}", "{env_id}") %}}'
        )

    def beside(self, env_id: str, *agents: str) -> list[Scored]:
        """The records of several agents, which have the same scenes, data and event weights, else RecordError."""
        found = [self.of(agent, env_id) for agent in agents]
        for agent, each in zip(agents, found, strict=True):
            if each.conditions != found[0].conditions:
                raise RecordError(
                    f"the records of {agents[0]!r} and {agent!r} on {env_id} are of other scenes, data or event "
                    "weights, expected the same: no difference of them means anything"
                )
        return found

    def all_of(self, env_id: str) -> list[Scored]:
        """All records of an environment, by agent."""
        self._require_env(env_id)
        return [self._found[key] for key in sorted(self._found) if key[1] == env_id]

    def _get(self, agent: str, env_id: str) -> Scored | None:
        self._require_env(env_id)
        if agent not in self._agents:
            raise UnknownNameError("agent", agent, self._agents)
        return self._found.get((agent, env_id))

    def _require_env(self, env_id: str) -> None:
        if env_id not in self._envs:
            raise UnknownNameError("environment", env_id, self._envs)


def known_of(entries: Sequence[Entry]) -> Known:
    """The records of a board."""
    levels = {entry.record.digest: entry.signed for entry in entries if entry.signed is not None}
    places = {entry.record.digest: entry.standing for entry in entries}
    return Known([entry.record for entry in entries], levels, places=places)


def subset_of(name: str) -> Subset:
    """The subset of that name; UnknownNameError where there is none."""
    found: Subset | None = next((subset for subset in get_args(Subset) if subset == name), None)
    if found is None:
        raise UnknownNameError("subset", name, SUBSETS)
    return found


def _why_not_taken(each: Checked, ships: Ships) -> str | None:
    """Why the numbers of a record stand beside no others."""
    record = each.record
    if record.status != "finished":
        return f"{record.status}: {record.status_reason}"
    return why_not_comparable(record, each.signed, ships if each.on_hidden else partial(_public, ships))


def _public(ships: Ships, env_id: str) -> Shipped | None:
    """As it ships, with its public scenes: of a simulated env they rank nobody, but may be told of."""
    found = ships(env_id)
    return found and replace(found, simulated=False)
