"""Entries of a leaderboard: records with their places, and their order."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import groupby
from typing import Any

from ...agent import ON_SCORED
from ...cards import load_card
from ...core import NetworkState, card_ids
from ...judge import Checked, Level, Standing, is_baseline, standings
from ...scoring import (
    SIGNIFICANT,
    SUBSETS,
    DrivingRow,
    PairedDifference,
    Row,
    Subset,
)

# as `networks.file_name` writes it
_NETWORK_FILE = re.compile(r"(\w+-(?:truth|tracklets))-(MTP-[\w-]+)\.safetensors")
_LAST_PLACE = 1000  # behind all envs whose card states a place on the page
LEVEL_TEXT: dict[Level, str] = {
    "scored": "checked by its authors alone",
    "re-scored": "scored again from the stored rollouts",
    "re-run": "run again from the submission",
    "hidden": "run again, and on scenes that were not public",
}


@dataclass(frozen=True, eq=False)
class LinkedRecord(Checked):
    """A record of a leaderboard with its addresses."""

    link: str | None = None  # relative address of its file
    added: bool = False  # not part of the leaderboard, shown at its place there
    note: str = ""  # reason why the level beside it is not shown
    code: str | None = None  # relative address of its folder, where that ships


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry(LinkedRecord):
    """One line of a leaderboard."""

    standing: Standing

    @property
    def env(self) -> str:
        """Id of the environment."""
        return self.record.env.id

    @property
    def name(self) -> str:
        """Name of the submission."""
        return self.record.submission.name

    @property
    def place(self) -> int | None:
        """Its place by bADE over all targets.

        None if it is shown, but not ranked.
        """
        return self.standing.places["all"].place

    @property
    def among_best(self) -> bool:
        """True if it is ranked and not significantly worse than the best."""
        span = self.standing.places["all"].span  # of ranks that tests leave open
        return span is not None and span[0] == 1

    @property
    def part(self) -> str:
        """The scenes of a partial record, "1/10 scenes".

        Empty for a whole one.
        """
        scenes = len(self.record.scenes)
        scenes_of_split = self.record.env.scenes_of_split
        if scenes == scenes_of_split or not scenes_of_split:
            return ""
        return f"{scenes}/{scenes_of_split} scenes"

    @property
    def why(self) -> str:
        """Reason why it has no place, or an empty text."""
        return self.standing.places["all"].why

    @property
    def compared(self) -> bool:
        """True in the main ranking.

        Even where that has too few recordings to rank.
        """
        return self.standing.compared

    @property
    def saw_truth(self) -> bool:
        """True for a reference that was given true objects or their labels."""
        return self.record.env.observe != "detections"

    @property
    def seal(self) -> str:
        """Its seal and the date of its retirement.

        Empty without hidden scenes.
        """
        if self.signed is None or self.signed.seal is None:
            return ""
        seal = self.signed.seal
        text = f"{seal.name} of {seal.made}"
        return f"{text}, retired {seal.retired}" if seal.retired else text

    @property
    def trained_on_scored(self) -> str:
        """The part that was trained on scored scenes, as declared.

        Empty without one.
        """
        for text in self.record.training_data:
            if text.endswith(ON_SCORED):  # as `Submission.note_on` writes it
                return text
        return ""

    @property
    def trainings(self) -> list[NetworkState]:
        """Networks that a command trains before it runs.

        Empty if all weights ship.
        """
        trainings = []
        for name in self.record.submission.networks:
            if file := _NETWORK_FILE.fullmatch(name):
                network, env_id = file.groups()
                state = NetworkState(network, env_id, trained=False, ships=False)
                trainings.append(state)
        return trainings

    @property
    def weights(self) -> str | None:
        """State of the weights: "ships", "train" or "train in 4 min".

        None for submissions other than baselines.
        """
        if not self.trainings:
            return "ships" if is_baseline(self.record) else None
        minutes = 0
        for network in self.trainings:
            if network.minutes is None:
                return "train"
            minutes += network.minutes
        return f"train in {minutes} min"

    @property
    def checked(self) -> str:
        """Date and signer of its level, and the seal.

        Empty where it was not checked.
        """
        if self.signed is None:
            return ""
        check = f"{self.signed.statement.date} by {self.signed.signer}"
        earlier = self.record.converted_from
        if self.converted and earlier is not None:
            conversion = f"converted {check}, not run again"
            if earlier.date is None:
                return conversion
            check = f"{earlier.date} by {earlier.signer}; {conversion}"
        return f"{check}; seal {self.seal}" if self.seal else check

    @property
    def row(self) -> Row:
        """The ranking numbers of all targets."""
        return self.row_of("all")

    @cached_property
    def driving(self) -> DrivingRow | None:
        """Ranking numbers of a closed loop with the difference to STP.

        None elsewhere.
        """
        row = self.sums.driving
        if row is None:
            return None
        changes: dict[str, Any] = {"agent": self.name}
        difference = self.standing.differences.get("all")
        if difference is not None:
            # the standing has that of errors, 1 - score: its sign is the opposite
            changes |= {"difference": -difference.mean, "p": difference.p}
            if difference.interval is not None:
                low, high = difference.interval
                changes["difference_interval"] = (-high, -low)
        return row.model_copy(update=changes)

    @property
    def error(self) -> float | None:
        """BADE over all targets, metres.

        In a closed loop it is 1 - drive score.
        """
        return self.row.error

    @property
    def public_error(self) -> float | None:
        """The error on the public scenes, metres, where hidden ones rank."""
        if not self.on_hidden or self.record.drives is not None:
            return None
        return self.record.row.error

    @property
    def difference(self) -> PairedDifference | None:
        """Its error minus that of STP beside it, metres.

        None for STP, without a record of STP and in closed loops.
        """
        if self.record.drives is not None:
            return None
        return self.standing.differences.get("all")

    @property
    def verdict(self) -> str:
        """Text "better" or "worse" than STP.

        Empty where the test cannot tell.
        """
        difference = self.standing.differences.get("all")
        if difference is None or difference.p >= SIGNIFICANT:
            return ""
        return "better" if difference.mean < 0 else "worse"


def entries_of(
    linked_records: Sequence[LinkedRecord], subsets: Sequence[Subset] = SUBSETS
) -> list[Entry]:
    """Return the entries of records in their order.

    The order is by environment, place, bADE and name, with partial records last.
    ``subsets``: those on which entries are ranked. Only a page needs more than "all".
    """
    ranked = standings(linked_records, subsets)
    entries = [
        Entry(**vars(linked), standing=ranked[linked.record.digest])
        for linked in linked_records
    ]
    return sorted(entries, key=_sort_key)


def empty_error(entries: Sequence[Entry]) -> float | None:
    """Return the error in one env if nothing is predicted, metres.

    None if it is unknown.
    """
    for entry in entries:
        if entry.compared:
            return entry.sums.targets.nothing_predicted
    return None


def by_board(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """Return the entries of each environment, in their order."""
    groups = groupby(entries, lambda entry: entry.env)
    return {env_id: list(group) for env_id, group in groups}


def _sort_key(entry: Entry) -> tuple[object, ...]:
    """Return a key for the order of `entries_of`.

    Entries outside the main ranking are last, references first among them.
    """
    return (
        env_order(entry.env),
        entry.part != "",
        entry.place or math.inf,
        not entry.compared,
        not entry.saw_truth,
        entry.error if entry.error is not None else math.inf,
        entry.name,
        entry.record.digest,
    )


@cache
def env_order(env_id: str) -> tuple[bool, int, str]:
    """Return a sort key of environments: those without a map first.

    Then by the place that the card states. Of those without a place the recorded ones
    come before the simulated.
    """
    place = None
    if env_id in card_ids():
        place = load_card(env_id).board
    if place is None:
        place = _LAST_PLACE
        if is_simulated(env_id):
            place += 1
    return has_map(env_id), place, env_id


@cache
def has_map(env_id: str) -> bool:
    """Return True if agents see lanes in an environment that ships."""
    return env_id in card_ids() and load_card(env_id).lanes is not None


@cache
def is_simulated(env_id: str) -> bool:
    """Return True if the scenes of an environment that ships are simulated."""
    return env_id in card_ids() and load_card(env_id).simulated
