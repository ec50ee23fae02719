"""The records of a leaderboard: every baseline on every environment it can run on."""

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
from .submitting import RECORDS, finished_record, plan_content, record_path


@dataclass(frozen=True, eq=False)
class RecordPiece:
    """A record of the leaderboard, made or not."""

    submission: Submission
    env: str  # id, or path of a card
    target: Path  # its file


def inventory(
    env_ids: Sequence[str] = (), names: Sequence[str] = (), folder: Path | None = None
) -> list[RecordPiece]:
    """Return the records of a leaderboard in the order in which they are made.

    Recorded envs come first, STP and ground-truth tracks before others. Submissions
    that observe stored tracks are left out. ``env_ids``: only these environments,
    ``names``: only these submissions; empty: all that ship. ``folder``: of the records;
    None: leaderboard/records below the working folder. Raises UnknownNameError for an
    id or a name that does not ship.
    """
    open_loops = [name for name in card_ids() if load_card(name).drive is None]
    cards = {env_id: load_card(env_id) for env_id in env_ids or open_loops}
    submissions = _submissions(names or baseline_names())
    pieces = []
    for env_id in sorted(cards, key=lambda env_id: cards[env_id].simulated):
        for submission in submissions:
            output = (folder or RECORDS) / submission.name
            target = record_path(submission, cards[env_id], output)
            pieces.append(RecordPiece(submission, env_id, target))
    return pieces


def _submissions(names: Sequence[str]) -> list[Submission]:
    """Return submissions in the order in which their records are made."""
    submissions = []
    for name in sorted(names, key=lambda name: (name != STP, name != TRUTH, name)):
        submission = load_submission(name)
        if submission.compare.observe != "tracks":
            submissions.append(submission)
    return submissions


def standing_record(
    piece: RecordPiece, options: RunOptions = DEFAULTS
) -> Record | None:
    """Return the record of a piece if it would be made equally again.

    It must be complete, with the same submission, card, seeds, limits and versions. Its
    rollouts may be missing, as in a checkout.
    """
    plan = plan_run(piece.submission, piece.env, options)
    return finished_record(piece.target, plan_content(plan), needs_rollouts=False)


def why_impossible(piece: RecordPiece, data: str | None = None) -> str | None:
    """Return the reason why a baseline cannot run here, such as untrained weights.

    None if it can. The baseline is built in this process to find out. Other submissions
    are never built outside the sandbox: they give None, and an error shows when the
    record is made. Raises DataError if the data of the env is missing.
    """
    submission = piece.submission
    if submission.path.parent != bundled("baselines"):
        return None
    observe = submission.compare.observe
    env = MTPEnv(piece.env, evaluation=True, data=data, observe=observe)
    task = agent_task(env, 0)
    try:
        submission.build(task, **submission.parameters).reset(task)
    except MtpBenchError as error:
        return str(error)
    return None
