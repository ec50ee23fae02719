"""The records of a whole leaderboard: every baseline that ships, on every environment where it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .._bundle import baseline_names, bundled, card_ids
from ..cards import load_card
from ..env.environment import MTPEnv
from ..errors import MtpBenchError
from ..gateway import Limits
from ..running.options import DEFAULTS, RunOptions
from ..running.run import agent_task
from ..submission.loader import Submission, load_submission
from .ranking import STP, TRUTH
from .record import Record
from .running import plan_run
from .stated import finished_record, stated_before
from .storage import ROLLOUTS
from .submitting import RECORDS, declared_data, record_path


@dataclass(frozen=True, eq=False)
class Piece:
    """A record that there is or could be."""

    submission: Submission
    env: str  # id, or path of a card
    target: Path  # its file

    @property
    def size(self) -> int:
        """Bytes of the record and its rollouts; 0 where there is none."""
        files = [self.target, *self.target.with_suffix(ROLLOUTS).rglob("*")]
        return sum(path.stat().st_size for path in files if path.is_file())


def inventory(env_ids: Sequence[str] = (), names: Sequence[str] = (), folder: Path | None = None) -> list[Piece]:
    """What a leaderboard has, in the order in which it is made.

    Recorded environments come before simulated ones, and in each `stp` and `truth_past`, between which gaps are
    measured, before the others. Submissions that observe stored tracks have none: they need tracks of somebody.

    Args:
        env_ids: Only these environments; none: all that ship.
        names: Only these submissions; none: all baselines that ship.
        folder: Of the records; None: leaderboard/records below the working folder.

    Raises UnknownNameError for an id or a name that does not ship.
    """
    cards = {env_id: load_card(env_id) for env_id in env_ids or card_ids()}
    found = [load_submission(name) for name in sorted(names or baseline_names(), key=_ends_first)]
    return [
        Piece(each, env_id, record_path(each, cards[env_id], (folder or RECORDS) / each.name))
        for env_id in sorted(cards, key=lambda env_id: cards[env_id].simulated)
        for each in found
        if each.compare.observe != "tracks"
    ]


def standing_record(piece: Piece, options: RunOptions = DEFAULTS) -> Record | None:
    """The record of a piece where nothing is left to do: of this submission, card, seeds, limits and versions.

    Unlike a submit that goes on it asks for no rollouts: a checkout does not hold them.
    """
    plan = plan_run(piece.submission, piece.env, options)
    declared = declared_data(piece.submission, plan.card.id)
    return finished_record(piece.target, stated_before(plan, Limits(), "closed", declared), rollouts=False)


def why_impossible(piece: Piece, data: str | None = None) -> str | None:
    """Why there is no record to be made here, such as weights that nobody has trained; None where there is.

    For that a baseline is built in this process. What does not ship is never run outside the sandbox: of it None is
    said, and a record that cannot be made says why. Raises DataError where the data of the env is missing.
    """
    submission = piece.submission
    if submission.path.parent != bundled("baselines"):
        return None
    env = MTPEnv(piece.env, evaluation=True, data=data, observe=submission.compare.observe)
    task = agent_task(env, 0)
    try:
        submission.build(task, **submission.parameters).reset(task)
    except MtpBenchError as error:
        return str(error)
    return None


def _ends_first(name: str) -> tuple[bool, bool, str]:
    return name != STP, name != TRUTH, name
