"""Intake: check a proposed change of the leaderboard. Files are read; no code of a submission is run."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from .._bundle import baseline_names
from ..errors import MtpBenchError, RecordError
from .attestation import LEVELS, SignedLevel, level_path, read_level
from .consistency import checked_record
from .eligibility import why_unranked
from .record import Record
from .shipped import shipped
from .storage import LEVEL_SUFFIX, MOST_BYTES, ROLLOUTS
from .trust import Trust, read_owners

OWNERS = Path("owners.toml")
_RECORDS = "records"
_LOOK_ALIKE = str.maketrans({"0": "o", "1": "l", "i": "l", "5": "s", "_": None, "-": None, ".": None})
_DEPTH, _MOST_FILES = 3, 10_000


@dataclass(frozen=True)
class Intake:
    """Outcome of checking a pull request: accepted records, refusals, notes."""

    accepted: tuple[Path, ...]
    refused: tuple[str, ...]
    notes: tuple[str, ...]


def take_in(folder: Path, trust: Trust, owner: str | None = None) -> Intake:
    """Check a proposed leaderboard at ``folder`` against the trusted one.

    Args:
        folder: A folder ``leaderboard``, or its records, or one of them.
        trust: The leaderboard that it would be merged into.
        owner: Login of the author of the proposal; None: names are not compared with it.

    Only records, trusted levels of them, and new names in owners.toml are accepted. Raises RecordError if there is no
    such folder, or the trusted leaderboard is broken.
    """
    root = _root(folder)
    try:
        files = _files(root)
        names = _owners(root / OWNERS, trust, owner)
    except MtpBenchError as error:
        return Intake((), (str(error),), ())
    refused = _refused_as_a_whole(root, files, names, trust, owner, whole=folder.absolute() == root.absolute())
    accepted: list[Path] = []
    notes: list[str] = []
    for name in sorted(files):
        path = root / name
        if name == OWNERS or _same(path, trust.folder / name) or not _within(path, folder):
            continue
        try:
            record = _check_file(path, name, names, trust, owner)
        except MtpBenchError as error:
            refused.append(str(error))
            continue
        if record is not None:
            accepted.append(path)
            notes += _notes(path, record)
    return Intake(tuple(accepted), tuple(refused), tuple(notes))


def _root(folder: Path) -> Path:
    """The folder ``leaderboard`` that holds ``folder``."""
    if folder.is_symlink() or not folder.exists():
        raise RecordError(f"{folder}: expected a folder leaderboard, not a link")
    parts = folder.absolute().parts
    if _RECORDS not in parts or (folder / _RECORDS).is_dir():
        return folder
    return Path(*parts[: len(parts) - 1 - parts[::-1].index(_RECORDS)])


def _refused_as_a_whole(
    root: Path, files: set[Path], names: Mapping[str, str], trust: Trust, owner: str | None, whole: bool
) -> list[str]:
    """Refusals of stored rollouts, and in a ``whole`` leaderboard also of removed files and names without a record."""
    refused = [
        f"{path.relative_to(root)}: stored rollouts stay with their makers (of recorded scenes they must not be "
        "published), expected records alone: take the folder out of the proposal"
        for path in sorted(root.rglob(f"*{ROLLOUTS}"))
    ]
    if not whole:
        return refused
    refused += [
        f"{name}: is removed; only maintainers remove files (if the proposal did not: bring it up to date with the "
        "branch that it is for)"
        for name in sorted(_files(trust.folder) - files)
        if not _outdated_level(name, root, trust)
    ]
    if owner is not None:
        used = {name.parts[1] for name in files if name.parts[0] == _RECORDS and len(name.parts) == _DEPTH}
        refused += [
            f"{OWNERS}: {name[:40]!r} has no record: a name comes with the first record of it"
            for name in sorted(names.keys() - trust.owners.keys() - used)
        ]
    return refused


def _within(path: Path, folder: Path) -> bool:
    return path.absolute() == folder.absolute() or folder.absolute() in path.absolute().parents


def _files(root: Path) -> set[Path]:
    """Names of all files below ``root`` but stored rollouts; RecordError for links and special files."""
    files: set[Path] = set()
    for parent, folders, names in os.walk(root, followlinks=False):
        folders[:] = [name for name in folders if not name.endswith(ROLLOUTS) or Path(parent, name).is_symlink()]
        for name in (*folders, *names):
            path = Path(parent, name)
            mode = path.lstat().st_mode
            if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)):
                raise RecordError(f"{path.relative_to(root)}: neither a file nor a folder, such as a link")
            if stat.S_ISREG(mode):
                files.add(path.relative_to(root))
            if len(files) > _MOST_FILES:
                raise RecordError(f"{root}: more than {_MOST_FILES} files")
    return files


def _same(path: Path, other: Path) -> bool:
    """True if both are files of equal content."""
    if not other.is_file() or path.stat().st_size != other.stat().st_size:
        return False
    return path.read_bytes() == other.read_bytes()


def _outdated_level(name: Path, root: Path, trust: Trust) -> bool:
    """True if a removed file was the level of a record that changes."""
    record = name.with_name(name.name.removesuffix(LEVEL_SUFFIX) + ".json")
    proposed = root / record
    return name.name.endswith(LEVEL_SUFFIX) and proposed.is_file() and not _same(proposed, trust.folder / record)


def _owners(path: Path, trust: Trust, owner: str | None) -> Mapping[str, str]:
    """Proposed owners; RecordError for any change but new names of ``owner``."""
    trusted_owners = trust.owners
    if path.is_file() and path.stat().st_size > MOST_BYTES:
        raise RecordError(f"{OWNERS}: larger than {MOST_BYTES >> 20} MiB")
    proposed = read_owners(path)
    changed = [name for name in trusted_owners if proposed.get(name) != trusted_owners[name]]
    if changed:
        name, login = changed[0], trusted_owners[changed[0]]
        raise RecordError(f"{OWNERS}: {name!r} belongs to {login!r}: only maintainers change that")
    for name in [name for name in proposed if name not in trusted_owners]:
        if owner is not None and proposed[name].lower() != owner.lower():
            raise RecordError(f"{OWNERS}: gives {name!r} to {proposed[name]!r}, expected {owner!r} who asks for it")
        others = (*baseline_names(), *(other for other in proposed if other != name))
        taken = next((other for other in others if _look(other) == _look(name)), None)
        if taken is not None:
            why = "is taken" if taken == name else f"looks like {taken!r}, which is taken"
            raise RecordError(f"{OWNERS}: {name!r} {why}: choose another name")
    return proposed


def _look(name: str) -> str:
    return name.lower().translate(_LOOK_ALIKE)


def _check_file(path: Path, name: Path, names: Mapping[str, str], trust: Trust, owner: str | None) -> Record | None:
    """The record in a file, None for a level; RecordError unless the file can be accepted."""
    if name.parts[0] != _RECORDS or len(name.parts) != _DEPTH or name.suffix != ".json":
        raise RecordError(f"{name}: expected {_RECORDS}/<submission>/<env id>.json and {OWNERS} alone in a proposal")
    if path.stat().st_size > MOST_BYTES:
        raise RecordError(f"{name}: has {path.stat().st_size} bytes, expected at most {MOST_BYTES >> 20} MiB")
    if name.name.endswith(LEVEL_SUFFIX):
        if owner is not None:  # else an old one could come back, or the best of many
            newer = (trust.folder / name).is_file()
            advice = "bring the proposal up to date with the main branch" if newer else "leave it out of the proposal"
            raise RecordError(f"{name}: levels are written by those who check records: {advice}")
        _check_level(path, name, trust)
        return None
    record = checked_record(path)
    stated, env = record.submission.name, record.env
    ships = shipped(env.id)
    if name.parts[1:] != (stated, f"{env.id}.json"):
        raise RecordError(f"{name}: holds {stated!r} on {env.id}, expected it at {stated}/{env.id}.json")
    if record.earlier_version:
        raise RecordError(f"{name}: made by version {record.earlier_version}: make it again with `mtp-bench submit`")
    if ships is None or ships.card != env.card_digest:
        raise RecordError(f"{name}: {env.id} with card {env.card_digest} does not ship")
    if stated in baseline_names():
        raise RecordError(f"{name}: {stated!r} is a baseline, only maintainers make its records")
    if stated not in names:
        raise RecordError(
            f'{name}: the name {stated!r} does not have an owner: add `"{stated}" = "LOGIN"` to {OWNERS}, with yours'
        )
    if owner is not None and names[stated].lower() != owner.lower():
        raise RecordError(f"{name}: the name {stated!r} belongs to {names[stated]!r}, not to {owner!r}")
    return record


def _check_level(path: Path, name: Path, trust: Trust) -> None:
    """Raise RecordError unless a level is signed, of the record beside it, and higher than the trusted one."""
    of = path.with_name(path.name.removesuffix(LEVEL_SUFFIX) + ".json")
    if not of.is_file() or level_path(of) != path:
        raise RecordError(f"{name}: a level without its record")
    record = checked_record(of)
    signed, why = read_level(of, record, trust)
    if signed is None:
        raise RecordError(f"{name.parent}/{why}")
    trusted_record = trust.folder / name.parent / of.name
    trusted_level = read_level(trusted_record, record, trust)[0] if trusted_record.is_file() else None
    if trusted_level is not None and _strength(signed) <= _strength(trusted_level):
        raise RecordError(f"{name}: {signed.level} of {signed.statement.date} is not above the level that is there")


def _strength(signed: SignedLevel) -> tuple[int, str]:
    return LEVELS.index(signed.level), signed.statement.date


def _notes(path: Path, record: Record) -> Iterator[str]:
    why = why_unranked(record)
    if why is not None:
        yield f"{path}: not ranked yet: {why}"
    if not record.submission.source:
        yield f"{path}: does not name a source, so others cannot run it: state `source` in submission.toml"
