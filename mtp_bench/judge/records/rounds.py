"""Rounds: submissions of many records, and the levels that their checks sign."""

from pathlib import Path

from ...agent import MANIFEST
from ...core import RecordError
from .attestation import SignedLevel, Statement, read_level, write_level
from .canonical import today
from .fields import LEVELS, Level
from .record import Record
from .seal import Sealed
from .storage import load_record
from .trust import Trust, trusted
from .verifying import Verification


def submission_of(record: Record, folder: Path | None) -> Path | None:
    """Return the submission of a record.

    None: it is the baseline of that name. ``folder``: a submission, or a folder of
    submissions by their names.
    """
    if folder is None or (folder / MANIFEST).is_file():
        return folder
    submission = folder / record.submission.name
    return submission if (submission / MANIFEST).is_file() else None


def level_reached(
    path: Path, record: Record, trust: Trust, rerun: bool, sealed: Sealed | None
) -> SignedLevel | None:
    """Return the signed level of a record if `verify` can reach no higher one.

    None without a level, for a converted one, and for one of another seal.
    """
    signed, _ = read_level(path, record, trust)
    if signed is None or signed.statement.converted:
        return None
    if sealed is not None:
        hidden = signed.statement.hidden
        if hidden is None or hidden.commitment != sealed.commitment:
            return None
        return signed
    goal: Level = "re-run" if rerun else "re-scored"
    return None if _is_below(signed.statement.level, goal) else signed


def attest(
    checked: Verification,
    key: Path,
    signer: str,
    trust: Trust | None = None,
    looked_at: bool = False,
) -> None:
    """Sign the level that a check reached, in the file of the record.

    ``trust``: the trusted leaderboard; None: the one that ships. ``looked_at``: a
    maintainer found that the record may be better than ground truth; it stays so.
    Raises RecordError if the record does not hold, has a higher level or was replaced
    since, MtpBenchError if it cannot be signed.
    """
    record = checked.record
    signed, _ = read_level(checked.path, record, trust or trusted())
    if signed is not None:
        earlier = signed.statement
        if _is_below(checked.level, earlier.level):
            raise RecordError(
                f"{checked.path}: reached {checked.level}, and is {earlier.level} "
                "since "
                f"{earlier.date}: that is kept"
            )
        looked_at = looked_at or earlier.looked_at
    if checked.level == "scored" or not checked.holds:
        raise RecordError(
            f"{checked.path}: does not hold, so there is no level to sign"
        )
    if load_record(checked.path) != record:
        raise RecordError(
            f"{checked.path}: was replaced while it was checked: check it again"
        )
    statement = Statement(
        level=checked.level,
        record=record.digest,
        measured=record.measured.digest,
        isolation=(checked.isolation or record.isolation).mechanism,
        date=today(),
        hidden=checked.hidden,
        looked_at=looked_at,
    )
    write_level(checked.path, statement, key, signer)


def _is_below(level: Level, goal: Level) -> bool:
    return LEVELS.index(level) < LEVELS.index(goal)
