"""The records of a whole leaderboard: every baseline that ships, on every environment that it can run on."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...agent import Submission, load_submission
from ...cards import load_card
from ...core import MtpBenchError, baseline_names, bundled, card_ids
from ...env import MTPEnv
from ...running import DEFAULTS, RunOptions, agent_task
from .ranking import STP, TRUTH
from .record import Record
from .running import plan_run
from .storage import ROLLOUTS
from .submitting import RECORDS, finished_record, plan_content, record_path


@dataclass(frozen=True, eq=False)
class Piece:
    """A record of the leaderboard, made or not."""

    submission: Submission
    env: str  # id, or path of a card
    target: Path  # its file

    @property
    def size(self) -> int:
        """Bytes of the record and its rollouts; 0 before it is made."""
        files = [self.target, *self.target.with_suffix(ROLLOUTS).rglob("*")]
        return sum(path.stat().st_size for path in files if path.is_file())


def inventory(
    env_ids: Sequence[str] = (), names: Sequence[str] = (), folder: Path | None = None
) -> list[Piece]:
    """The records of a leaderboard as they are made: recorded envs first; STP and ground-truth tracks before others.

    Submissions that observe stored tracks are left out. ``env_ids``: only these environments, ``names``: only these
    submissions; empty: all that ship. ``folder``: of the records; None: leaderboard/records below the working folder.
    Raises UnknownNameError for an id or a name that does not ship.
    """
    shipped = {env_id: load_card(env_id) for env_id in card_ids()}
    recordable = [env_id for env_id, card in shipped.items() if card.drive is None]
    cards = {env_id: load_card(env_id) for env_id in env_ids or recordable}
    ordered = sorted(
        names or baseline_names(), key=lambda name: (name != STP, name != TRUTH, name)
    )
    submissions = [load_submission(name) for name in ordered]
    return [
        Piece(
            each,
            env_id,
            record_path(each, cards[env_id], (folder or RECORDS) / each.name),
        )
        for env_id in sorted(cards, key=lambda env_id: cards[env_id].simulated)
        for each in submissions
        if each.compare.observe != "tracks"
    ]


def standing_record(piece: Piece, options: RunOptions = DEFAULTS) -> Record | None:
    """The record of a piece if it is complete and of the same submission, card, seeds, limits and versions.

    Its rollouts may be missing, as in a checkout.
    """
    plan = plan_run(piece.submission, piece.env, options)
    return finished_record(piece.target, plan_content(plan), rollouts=False)


def why_impossible(piece: Piece, data: str | None = None) -> str | None:
    """Reason why a baseline cannot run here, such as weights that were not trained; None if it can.

    The baseline is built in this process to find out. Other submissions are never built outside the sandbox: they
    give None, and an error shows when the record is made. Raises DataError if the data of the env is missing.
    """
    submission = piece.submission
    if submission.path.parent != bundled("baselines"):
        return None
    task = agent_task(
        MTPEnv(
            piece.env, evaluation=True, data=data, observe=submission.compare.observe
        ),
        0,
    )
    try:
        submission.build(task, **submission.parameters).reset(task)
    except MtpBenchError as error:
        return str(error)
    return None
