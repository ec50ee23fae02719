"""Intake: check the proposed leaderboard of a pull request. Files are read; no code of a submission is run."""

import filecmp
import os
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...core import MtpBenchError, RecordError, baseline_names, file_kind, read_json
from .canonical import today
from .consistency import checked_record
from .eligibility import may_observe, why_scored_otherwise, why_unranked
from .record import Record
from .shipped import FOR_BASELINES, shipped
from .storage import ROLLOUTS, usable_record
from .trust import OWNERS, Trust, read_owners

_RECORDS = "records"
_LOOK_ALIKE = str.maketrans(
    {"0": "o", "1": "l", "i": "l", "5": "s", "_": None, "-": None, ".": None}
)
_DEPTH = 3
_MOST_FILES, _MOST_NEW = 100_000, 20  # of a leaderboard; new names of a proposal
_PLAIN = "100644"  # git's mode of a regular file that cannot be executed


@dataclass(frozen=True)
class Intake:
    """Outcome of checking a pull request: accepted records, refusals, notes."""

    accepted: tuple[Path, ...]
    refused: tuple[str, ...]
    notes: tuple[str, ...]


def take_in(folder: Path, trust: Trust, owner: str) -> Intake:
    """Check the proposed leaderboard at ``folder`` against the trusted one, into which it would be merged.

    Only records and names of the author, whose login is ``owner``, are accepted. Raises RecordError if there is no such
    folder, or the trusted leaderboard is broken.
    """
    if folder.is_symlink() or not folder.is_dir():
        raise RecordError(
            f"{folder}: expected a folder leaderboard, not a link or a file"
        )
    trusted_files, trusted_names = _files(trust.folder), trust.owners
    try:
        files = _files(folder)
        odd = [
            f"{name}: {kind}, expected a file of mode {_PLAIN}"
            for name, kind in sorted(files.items())
            if kind
        ]
        if odd:  # none of them is read
            return Intake((), tuple(odd), ())
        names = _proposed_owners(folder / OWNERS, trusted_names, owner)
    except MtpBenchError as error:
        return Intake((), (str(error),), ())
    refused = [
        f"{path.relative_to(folder)}: stored rollouts stay with their makers (of recorded scenes they must not be "
        "published), expected records alone: take the folder out of the proposal"
        for path in sorted(folder.rglob(f"*{ROLLOUTS}"))
    ]
    refused += [
        f"{name}: is removed; only maintainers remove files (if the proposal did not: bring it up to date with the "
        "branch that it is for)"
        for name in sorted(trusted_files.keys() - files.keys())
    ]
    used = {
        name.parts[1]
        for name in files
        if name.parts[0] == _RECORDS and len(name.parts) == _DEPTH
    }
    refused += [
        f"{OWNERS}: {name[:40]!r} has no record: a name comes with the first record of it"
        for name in sorted(names.keys() - trusted_names.keys() - used)
    ]
    accepted, notes = list[Path](), list[str]()
    for name in sorted(files.keys() - {Path(OWNERS)}):
        path = folder / name
        if (trust.folder / name).is_file() and filecmp.cmp(
            path, trust.folder / name, shallow=False
        ):
            continue
        try:
            record = _acceptable(path, name, trust, names, owner)
        except MtpBenchError as error:
            refused.append(str(error))
            continue
        accepted.append(path)
        notes += _notes(path, record)
    return Intake(tuple(accepted), tuple(refused), tuple(notes))


def _files(root: Path) -> dict[Path, str]:
    """Names of all files and empty folders below ``root`` but stored rollouts, and what is odd about each.

    Odd is everything but a regular file of mode 100644. RecordError for too many.
    """
    files = _odd_in_git(root)
    for parent, folders, names in os.walk(root, followlinks=False):
        if not (folders or names):
            files[Path(parent).relative_to(root)] = "empty folder or submodule"
        folders[:] = [
            name
            for name in folders
            if not name.endswith(ROLLOUTS) or Path(parent, name).is_symlink()
        ]
        for path in (Path(parent, name) for name in (*folders, *names)):
            mode = path.lstat().st_mode
            kind = file_kind(mode) or ("executable file" if mode & 0o111 else "")
            if kind != "folder":
                files.setdefault(path.relative_to(root), kind)
        if len(files) > _MOST_FILES:
            raise RecordError(f"{root}: more than {_MOST_FILES} files")
    return files


def _odd_in_git(root: Path) -> dict[Path, str]:
    """Odd modes in git's commit of ``root``: a submodule need not have a folder on disk. Empty without git."""
    command = [
        "git",
        "-c",
        "protocol.allow=never",
        "-C",
        str(root),
        "ls-tree",
        "-r",
        "-z",
        "HEAD",
    ]
    try:
        listed = os.fsdecode(
            subprocess.run(command, capture_output=True, check=False).stdout
        )
    except FileNotFoundError:
        return {}
    entries = [
        entry.split("\t", 1)
        for entry in listed.split("\0")
        if entry and not entry.startswith(_PLAIN)
    ]
    return {Path(name): f"git mode {about.split()[0]}" for about, name in entries}


def _proposed_owners(
    path: Path, trusted_names: Mapping[str, str], owner: str
) -> Mapping[str, str]:
    """Proposed owners; RecordError for any change but new names of ``owner``."""
    proposed = read_owners(path)
    for name, login in trusted_names.items():
        if proposed.get(name) != login:
            raise RecordError(
                f"{OWNERS}: {name!r} belongs to {login!r}: only maintainers change that"
            )
    new = [name for name in proposed if name not in trusted_names]
    if len(new) > _MOST_NEW:
        raise RecordError(
            f"{OWNERS}: {len(new)} new names, expected at most {_MOST_NEW} in one proposal"
        )
    taken = {_look(name): name for name in (*baseline_names(), *trusted_names)}
    for name in new:
        if proposed[name].lower() != owner.lower():
            raise RecordError(
                f"{OWNERS}: gives {name!r} to {proposed[name]!r}, expected {owner!r} who asks for it"
            )
        other = taken.get(_look(name))
        if other is not None:
            why = (
                "is taken" if other == name else f"looks like {other!r}, which is taken"
            )
            raise RecordError(f"{OWNERS}: {name!r} {why}: choose another name")
        taken[_look(name)] = name
    return proposed


def _look(name: str) -> str:
    return name.lower().translate(_LOOK_ALIKE)


def _acceptable(
    path: Path, name: Path, trust: Trust, names: Mapping[str, str], owner: str
) -> Record:
    """The record in a file; RecordError unless it can be accepted."""
    if name.parts[0] != _RECORDS or len(name.parts) != _DEPTH or name.suffix != ".json":
        raise RecordError(
            f"{name}: expected {_RECORDS}/<submission>/<env id>.json and {OWNERS} alone in a proposal"
        )
    record = checked_record(path)
    # else an old one could come back, or the best of many
    if "level" in read_json(path, RecordError) or record == usable_record(
        trust.folder / name
    ):
        raise RecordError(
            f"{name}: levels are written and removed by those who check records: leave `level` out, or bring the "
            "proposal up to date with the branch that it is for"
        )
    if record.converted_from is not None:
        raise RecordError(
            f"{name}: only maintainers convert records: make it with `mtp-bench submit`"
        )
    stated, env = record.submission.name, record.env
    ships = shipped(env.id)
    if name.parts[1:] != (stated, f"{env.id}.json"):
        raise RecordError(
            f"{name}: holds {stated!r} on {env.id}, expected it at {stated}/{env.id}.json"
        )
    if why := why_scored_otherwise(record):
        raise RecordError(f"{name}: {why}: make it again with `mtp-bench submit`")
    if record.measured.made > today(1):
        raise RecordError(
            f"{name}: made on {record.measured.made}, expected a day up to {today()}: set the clock"
        )
    if ships is None or ships.card != env.card_digest:
        raise RecordError(f"{name}: {env.id} with card {env.card_digest} does not ship")
    if not may_observe(record):
        raise RecordError(f"{name}: {FOR_BASELINES}")
    if stated in baseline_names():
        raise RecordError(
            f"{name}: {stated!r} is a baseline, only maintainers make its records"
        )
    if stated not in names:
        raise RecordError(
            f'{name}: the name {stated!r} does not have an owner: add `"{stated}" = "LOGIN"` to {OWNERS}, with yours'
        )
    if names[stated].lower() != owner.lower():
        raise RecordError(
            f"{name}: the name {stated!r} belongs to {names[stated]!r}, not to {owner!r}"
        )
    return record


def _notes(path: Path, record: Record) -> Iterator[str]:
    why = why_unranked(record)
    if why is not None:
        yield f"{path}: not ranked yet: {why}"
    if not (record.submission.source and record.submission.commit):
        yield f"{path}: a round needs `source` in submission.toml, and the commit: `mtp-bench submit --commit`"
    if not record.training_data:
        yield f'{path}: `training_data` in submission.toml is empty: state what it was trained on, or "nothing"'
    digests = [
        value.encode() for value in (record.hashes.seals, record.hashes.rollouts)
    ]
    for other in sorted(path.parents[1].glob(f"*/{path.name}")):
        content = b"" if other == path else other.read_bytes()
        if any(digest in content for digest in digests):
            yield f"{path}: gives the same answers as {other.parent.name}"
