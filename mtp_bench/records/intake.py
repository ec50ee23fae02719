"""Intake: whether a change of the leaderboard can be taken in. Files are read; nothing of a submission is run."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from .._bundle import baseline_names
from ..errors import MtpBenchError, RecordError
from .attestation import LEVELS, SignedLevel, level_path, read_level
from .bounds import MOST_BYTES
from .eligibility import why_unranked
from .shipped import shipped
from .storage import LEVEL_SUFFIX, ROLLOUTS, load_record
from .trust import Trust, read_owners

OWNERS = Path("owners.toml")
_RECORDS = "records"
_LOOK_ALIKE = str.maketrans({"0": "o", "1": "l", "i": "l", "5": "s", "_": None, "-": None, ".": None})
_DEEPEST, _MOST_FILES = 3, 10_000


@dataclass(frozen=True)
class Intake:
    """What a change holds."""

    accepted: tuple[Path, ...]  # records
    refused: tuple[str, ...]  # why it cannot be taken in, each in a sentence
    notes: tuple[str, ...]


def take_in(folder: Path, trust: Trust, owner: str | None = None) -> Intake:
    """Check the leaderboard at ``folder``, as somebody proposes it, against the one that is trusted.

    Args:
        folder: A folder ``leaderboard``, or its records, or one of them.
        trust: The leaderboard that it would be merged into.
        owner: Login of whoever asks; None: names are not compared with it.

    Only records, trusted levels of them, and new names in owners.toml can be taken in. Raises RecordError where there
    is no such folder, or what is trusted is broken.
    """
    root = _root(folder)
    accepted: list[Path] = []
    refused: list[str] = []
    notes: list[str] = []
    try:
        files = _files(root)
        names = _owners(root / OWNERS, trust, owner)
    except MtpBenchError as error:
        return Intake((), (str(error),), ())
    gone = sorted(_files(trust.folder) - files) if _whole(folder, root) else []
    gone = [name for name in gone if not _stale_level(name, root, trust)]
    refused += [
        f"{path.relative_to(root)}: stored rollouts stay with whoever made them (of recorded scenes they must not be "
        "published), expected records alone: take the folder out of the proposal"
        for path in sorted(root.rglob(f"*{ROLLOUTS}"))
    ]
    refused += [
        f"{name}: is removed; only maintainers remove files (where the proposal did not: bring it up to date with "
        "the branch that it is for)"
        for name in gone
    ]
    if owner is not None and _whole(folder, root):
        used = {name.parts[1] for name in files if name.parts[0] == _RECORDS and len(name.parts) == _DEEPEST}
        refused += [
            f"{OWNERS}: {name[:40]!r} has no record: a name comes with the first record of it"
            for name in sorted(names.keys() - trust.owners.keys() - used)
        ]
    for name in sorted(files):
        path = root / name
        if name == OWNERS or _same(path, trust.folder / name) or not _within(path, folder):
            continue
        try:
            _take(path, name, names, trust, owner)
        except MtpBenchError as error:
            refused.append(str(error))
            continue
        if not name.name.endswith(LEVEL_SUFFIX):
            accepted.append(path)
            notes += _notes(path)
    return Intake(tuple(accepted), tuple(refused), tuple(notes))


def _root(folder: Path) -> Path:
    """The folder ``leaderboard`` that holds ``folder``."""
    if folder.is_symlink() or not folder.exists():
        raise RecordError(f"{folder}: expected a folder leaderboard, no link")
    parts = folder.absolute().parts
    if _RECORDS not in parts or (folder / _RECORDS).is_dir():
        return folder
    return Path(*parts[: len(parts) - 1 - parts[::-1].index(_RECORDS)])


def _whole(folder: Path, root: Path) -> bool:
    return folder.absolute() == root.absolute()


def _within(path: Path, folder: Path) -> bool:
    """Whether a file is asked about."""
    return path.absolute() == folder.absolute() or folder.absolute() in path.absolute().parents


def _files(root: Path) -> set[Path]:
    """Names of all files below ``root`` but stored rollouts; RecordError for links and odd kinds."""
    found: set[Path] = set()
    for at, folders, names in os.walk(root, followlinks=False):
        folders[:] = [name for name in folders if not name.endswith(ROLLOUTS) or Path(at, name).is_symlink()]
        for name in (*folders, *names):
            path = Path(at, name)
            mode = path.lstat().st_mode
            if not (stat.S_ISDIR(mode) or stat.S_ISREG(mode)):
                raise RecordError(f"{path.relative_to(root)}: neither a file nor a folder, such as a link")
            if stat.S_ISREG(mode):
                found.add(path.relative_to(root))
            if len(found) > _MOST_FILES:
                raise RecordError(f"{root}: more than {_MOST_FILES} files")
    return found


def _same(path: Path, other: Path) -> bool:
    """Whether both are files of equal content."""
    if not other.is_file() or path.stat().st_size != other.stat().st_size:
        return False
    return path.read_bytes() == other.read_bytes()


def _stale_level(name: Path, root: Path, trust: Trust) -> bool:
    """Whether a file that is gone was the level of a record that changes: it is of the earlier one."""
    record = name.with_name(name.name.removesuffix(LEVEL_SUFFIX) + ".json")
    here = root / record
    return name.name.endswith(LEVEL_SUFFIX) and here.is_file() and not _same(here, trust.folder / record)


def _owners(path: Path, trust: Trust, owner: str | None) -> Mapping[str, str]:
    """Owners as they would be; RecordError where another line was changed than one that adds a name of ``owner``."""
    known = trust.owners
    if path.is_file() and path.stat().st_size > MOST_BYTES:
        raise RecordError(f"{OWNERS}: larger than {MOST_BYTES >> 20} MiB")
    proposed = read_owners(path)
    changed = [name for name in known if proposed.get(name) != known[name]]
    if changed:
        raise RecordError(f"{OWNERS}: {changed[0]!r} belongs to {known[changed[0]]!r}: only maintainers change that")
    for name in proposed:
        if name in known:
            continue
        if owner is not None and proposed[name].lower() != owner.lower():
            raise RecordError(f"{OWNERS}: gives {name!r} to {proposed[name]!r}, expected {owner!r} who asks for it")
        others = (*baseline_names(), *(other for other in proposed if other != name))
        taken = next((other for other in others if _looks(other) == _looks(name)), None)
        if taken is not None:
            why = "is taken" if taken == name else f"looks like {taken!r}, which is taken"
            raise RecordError(f"{OWNERS}: {name!r} {why}: choose another name")
    return proposed


def _looks(name: str) -> str:
    return name.lower().translate(_LOOK_ALIKE)


def _take(path: Path, name: Path, names: Mapping[str, str], trust: Trust, owner: str | None) -> None:
    """Raise RecordError unless the file can be taken in."""
    if name.parts[0] != _RECORDS or len(name.parts) != _DEEPEST or name.suffix != ".json":
        raise RecordError(f"{name}: expected {_RECORDS}/<submission>/<env id>.json and {OWNERS} alone in a proposal")
    if path.stat().st_size > MOST_BYTES:
        raise RecordError(f"{name}: has {path.stat().st_size} bytes, expected at most {MOST_BYTES >> 20} MiB")
    if name.name.endswith(LEVEL_SUFFIX):
        if owner is not None:  # else an old one could come back, or the best of many
            newer = (trust.folder / name).is_file()
            what = "bring the proposal up to date with the main branch" if newer else "leave it out of the proposal"
            raise RecordError(f"{name}: levels are written by whoever checks records: {what}")
        _take_level(path, name, trust)
        return
    record = load_record(path)
    said, ships = record.submission.name, shipped(record.env.id)
    if name.parts[1:] != (said, f"{record.env.id}.json"):
        raise RecordError(f"{name}: holds {said!r} on {record.env.id}, expected it at {said}/{record.env.id}.json")
    if record.earlier_version:
        raise RecordError(f"{name}: made by version {record.earlier_version}: make it again with `mtp-bench submit`")
    if ships is None or ships.card != record.env.card_digest:
        raise RecordError(f"{name}: {record.env.id} with card {record.env.card_digest} does not ship")
    if said in baseline_names():
        raise RecordError(f"{name}: {said!r} is a baseline, only maintainers make its records")
    if said not in names:
        raise RecordError(f'{name}: the name {said!r} has no owner: add `"{said}" = "LOGIN"` to {OWNERS}, with yours')
    if owner is not None and names[said].lower() != owner.lower():
        raise RecordError(f"{name}: the name {said!r} belongs to {names[said]!r}, not to {owner!r}")


def _take_level(path: Path, name: Path, trust: Trust) -> None:
    of = path.with_name(path.name.removesuffix(LEVEL_SUFFIX) + ".json")
    if not of.is_file() or level_path(of) != path:
        raise RecordError(f"{name}: a level without its record")
    record, there = load_record(of), trust.folder / name.parent / of.name
    signed, why = read_level(of, record, trust)
    if signed is None:
        raise RecordError(f"{name.parent}/{why}")
    known = read_level(there, record, trust)[0]
    if known is not None and _strength(signed) <= _strength(known):
        raise RecordError(f"{name}: {signed.level} of {signed.statement.date} is no more than the level that is there")


def _strength(signed: SignedLevel) -> tuple[int, str]:
    return LEVELS.index(signed.level), signed.statement.date


def _notes(path: Path) -> Iterator[str]:
    record = load_record(path)
    why = why_unranked(record)
    if why is not None:
        yield f"{path}: not ranked yet: {why}"
    if not record.submission.source:
        yield f"{path}: names no source, so nobody else can run it: say `source` in submission.toml"
