"""Entries of a leaderboard: records with their places, and the order in which they stand."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby
from typing import Any

from ...agent import ON_SCORED
from ...cards import load_card
from ...core import NetworkState, baseline_names, card_ids
from ...judge import (
    Checked,
    Level,
    Record,
    Standing,
    standings,
    why_not_genuine,
)
from ...scoring import (
    SIGNIFICANT,
    SUBSETS,
    DrivingRow,
    PairedDifference,
    Row,
    Subset,
)

_NETWORK = re.compile(
    r"(\w+-(?:truth|tracklets))-(MTP-[\w-]+)\.safetensors"
)  # as `networks.file_name` writes it
_LAST = 1000  # behind all envs whose card states a place
LEVEL_TEXT: dict[Level, str] = {
    "scored": "checked by its authors alone",
    "re-scored": "scored again from the stored rollouts",
    "re-run": "run again from the submission",
    "hidden": "run again, and on scenes that were not public",
}


@dataclass(frozen=True, eq=False)
class Found(Checked):
    """A record of a leaderboard with its addresses."""

    link: str | None = None  # relative address of its file
    added: bool = False  # not part of the leaderboard, shown at its place there
    note: str = ""  # reason why the level beside it is not shown
    code: str | None = None  # relative address of its folder, where that ships


@dataclass(frozen=True, eq=False, kw_only=True)
class Entry(Found):
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
        """Its place by bADE over all targets; None: shown, not ranked."""
        return self.standing.places["all"].place

    @property
    def rank(self) -> str | None:
        """Its place with the ranks that the tests leave open, "2 (1–3)"; None: shown, not ranked."""
        return self.standing.places["all"].rank

    @property
    def among_best(self) -> bool:
        """True if it is ranked and not significantly worse than the best."""
        span = self.standing.places["all"].span
        return span is not None and span[0] == 1

    @property
    def part(self) -> str:
        """The scenes of a partial record, "1/10 scenes"; empty for a whole one."""
        scenes = len(self.record.scenes)
        scenes_of_split = self.record.env.scenes_of_split
        if scenes == scenes_of_split or not scenes_of_split:
            return ""
        return f"{scenes}/{scenes_of_split} scenes"

    @property
    def why(self) -> str:
        """Reason why it has no place; empty where it has one."""
        return self.standing.places["all"].why

    @property
    def compared(self) -> bool:
        """True in the main ranking of its environment, even where that has too few recordings to rank."""
        return self.standing.compared

    @property
    def saw_truth(self) -> bool:
        """True for a reference that was given true objects or their labels."""
        return self.record.env.observe != "detections"

    @property
    def seal(self) -> str:
        """The seal of its hidden scenes, and the date of its retirement; empty without hidden scenes."""
        seal = None if self.signed is None else self.signed.seal
        if seal is None:
            return ""
        return f"{seal.name} of {seal.made}" + (
            f", retired {seal.retired}" if seal.retired else ""
        )

    @property
    def trained_on_scored(self) -> str:
        """The part of it that was trained on the scored scenes, as it declares; empty where no part was."""
        return next(
            (text for text in self.record.training_data if text.endswith(ON_SCORED)), ""
        )

    @property
    def trainings(self) -> list[NetworkState]:
        """Networks that a command trains before it runs; empty where all of its weights ship."""
        files = (_NETWORK.fullmatch(name) for name in self.record.submission.networks)
        return [
            NetworkState(file[1], file[2], trained=False, ships=False)
            for file in files
            if file
        ]

    @property
    def weights(self) -> str | None:
        """The text "ships" or "train in 4 min"; None for another submission than a baseline without such networks."""
        minutes = [network.minutes for network in self.trainings]
        if not minutes:
            return "ships" if is_baseline(self.record) else None
        return (
            "train" if None in minutes else f"train in {sum(filter(None, minutes))} min"
        )

    @property
    def checked(self) -> str:
        """Date and signer of its level, and the seal; empty where it was not checked."""
        if self.signed is None:
            return ""
        by = f"{self.signed.statement.date} by {self.signed.signer}"
        before = self.record.converted_from
        if self.converted and before is not None:
            converted = f"converted {by}, not run again"
            if before.date is None:
                return converted
            by = f"{before.date} by {before.signer}; {converted}"
        return f"{by}; seal {self.seal}" if self.seal else by

    @property
    def row(self) -> Row:
        """The ranking numbers of all targets."""
        return self.row_of("all")

    @property
    def driving(self) -> DrivingRow | None:
        """Ranking numbers of a closed loop with the difference to STP; None elsewhere."""
        row = self.sums.driving
        if row is None:
            return None
        changes: dict[str, Any] = {"agent": self.name}
        difference = self.standing.differences.get("all")
        if difference is not None:
            # of scores, not of errors
            interval = difference.interval
            changes |= {
                "difference": -difference.mean,
                "difference_interval": interval and (-interval[1], -interval[0]),
                "p": difference.p,
            }
        return row.model_copy(update=changes)

    @property
    def error(self) -> float | None:
        """BADE over all targets, metres; of a closed loop 1 - drive score."""
        return self.row.error

    @property
    def public_error(self) -> float | None:
        """The error on the public scenes, metres, where hidden ones rank."""
        return (
            self.record.row.error if self.on_hidden and self.driving is None else None
        )

    def difference(self, subset: Subset = "all") -> PairedDifference | None:
        """Its error minus that of STP beside it, metres; None for STP, without a record of STP and in closed loops."""
        return (
            self.standing.differences.get(subset) if self.sums.driving is None else None
        )

    @property
    def verdict(self) -> str:
        """Return "better" or "worse" than STP by the test that ranks; empty where that cannot tell."""
        difference = self.standing.differences.get("all")
        if difference is None or difference.p >= SIGNIFICANT:
            return ""
        return "better" if difference.mean < 0 else "worse"

    def same_predictor_gap(self, subset: Subset) -> float | None:
        """Share that it closes of the gap between references with its own predictor, where that is known."""
        return self.standing.own_gaps.get(subset)

    def association_blank(self, subset: Subset) -> str | None:
        """Reason why its association gap is missing on a subset; None where it is not."""
        return (
            None
            if subset in self.standing.association_gaps
            else self.standing.association_gap_blank
        )


def entries_of(
    found: Sequence[Found], subsets: Sequence[Subset] = SUBSETS
) -> list[Entry]:
    """The entries in their order: by definitions, environment, place, bADE and name; partial ones behind whole ones.

    ``subsets``: those of their standings; without a page "all" is enough.
    """
    levels = {
        each.record.digest: each.signed for each in found if each.signed is not None
    }
    places = standings([each.record for each in found], levels, subsets=subsets)
    entries = (
        Entry(**vars(each), standing=places[each.record.digest]) for each in found
    )
    return sorted(entries, key=_order)


def is_baseline(record: Record) -> bool:
    """Return True if a record is of a baseline that ships, and not of another submission of its name."""
    return (
        record.submission.name in baseline_names() and why_not_genuine(record) is None
    )


def empty_error(entries: Sequence[Entry]) -> float | None:
    """Error in one environment if nothing is predicted, metres; None where it is not known."""
    return next(
        (entry.sums.targets.nothing_predicted for entry in entries if entry.compared),
        None,
    )


def by_board(entries: Sequence[Entry]) -> dict[str, list[Entry]]:
    """The entries of each environment, in their order."""
    return {
        env_id: list(listed)
        for env_id, listed in groupby(entries, lambda entry: entry.env)
    }


def _order(entry: Entry) -> tuple[object, ...]:
    rank = math.inf if entry.place is None else entry.place
    error = math.inf if entry.error is None else entry.error
    record, section = (
        entry.record,
        (rank, not entry.compared, not entry.saw_truth, error),
    )
    return _env_place(entry.env), entry.part != "", *section, entry.name, record.digest


@cache
def _env_place(env_id: str) -> tuple[bool, int, str]:
    """Sort key of environments: those without a map; of each the place that the card states, recorded, simulated."""
    place = load_card(env_id).board if env_id in card_ids() else None
    return (
        has_map(env_id),
        _LAST + simulated(env_id) if place is None else place,
        env_id,
    )


@cache
def has_map(env_id: str) -> bool:
    """Return True if agents see lanes in an environment; False for one that does not ship."""
    return env_id in card_ids() and load_card(env_id).lanes is not None


@cache
def simulated(env_id: str) -> bool:
    """Return True if the scenes of an environment are simulated; False for one that does not ship."""
    return env_id in card_ids() and load_card(env_id).simulated
