"""Intake: check the proposed leaderboard of a pull request.

Files are read; no code of a submission is run.
"""

import filecmp
import os
import subprocess
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from string import digits

from ...core import (
    MtpBenchError,
    RecordError,
    baseline_names,
    clean_text,
    file_kind,
    read_json,
)
from .canonical import today
from .consistency import checked_record
from .eligibility import may_observe, why_scored_otherwise, why_unranked
from .record import Record
from .shipped import FOR_BASELINES, shipped
from .storage import ROLLOUTS_SUFFIX, usable_record
from .trust import OWNERS, Trust, read_owners

_RECORDS = "records"
_LOOK_ALIKE = str.maketrans(
    {"0": "o", "1": "l", "i": "l", "5": "s", "_": None, "-": None, ".": None}
)
_MOST_OUTPUT = 300  # characters of a message of git
_CLOSE = 0.8  # share of equal letters from which names are close
_DEPTH = 3  # parts of records/<submission>/<env id>.json
_MAX_FILES = 100_000  # of a leaderboard
_MAX_NEW_NAMES = 20  # of a proposal
_PLAIN_MODE = "100644"  # git's mode of a regular file that cannot be executed


@dataclass(frozen=True)
class Intake:
    """Outcome of checking a pull request: accepted records, refusals, notes."""

    accepted: tuple[Path, ...]
    refused: tuple[str, ...]
    notes: tuple[str, ...]


def take_in(folder: Path, trust: Trust, owner: str) -> Intake:
    """Check the proposed leaderboard at ``folder`` against the trusted one.

    The first would be merged into the second. Only records and names of the author,
    whose login is ``owner``, are accepted. Raises RecordError if there is no such
    folder, or the trusted leaderboard is broken.
    """
    if folder.is_symlink() or not folder.is_dir():
        raise RecordError(
            f"{folder}: expected a folder leaderboard, not a link or a file"
        )
    trusted_files = _files(trust.folder)
    trusted_names = trust.owners
    try:
        files = _files(folder)
        odd_files = [
            f"{name}: {kind}, expected a file of mode {_PLAIN_MODE}"
            for name, kind in sorted(files.items())
            if kind
        ]
        if odd_files:  # none of them is read
            return Intake((), tuple(odd_files), ())
        names = _proposed_owners(folder / OWNERS, trusted_names, owner)
    except MtpBenchError as error:
        return Intake((), (str(error),), ())
    refused = _refused_files(folder, files, trusted_files)
    new_names = names.keys() - trusted_names.keys()
    refused += _names_without_record(files, new_names)
    accepted: list[Path] = []
    notes = _notes_on_names(new_names, names)
    for name in sorted(files.keys() - {Path(OWNERS)}):
        path = folder / name
        if _is_unchanged(path, trust.folder / name):
            continue
        try:
            record = _accepted_record(path, name, trust, names, owner)
        except MtpBenchError as error:
            refused.append(str(error))
            continue
        accepted.append(path)
        notes += _notes(path, record)
    return Intake(tuple(accepted), tuple(refused), tuple(notes))


def _refused_files(
    folder: Path, files: Mapping[Path, str], trusted_files: Mapping[Path, str]
) -> list[str]:
    """Return why rollouts and removed files of the leaderboard are refused."""
    rollouts = [
        f"{path.relative_to(folder)}: stored rollouts stay with their makers (of "
        "recorded scenes they must not be published), expected records alone: take the "
        "folder out of the proposal"
        for path in sorted(folder.rglob(f"*{ROLLOUTS_SUFFIX}"))
    ]
    removed = [
        f"{name}: is removed; only maintainers remove files (if the proposal did not: "
        "bring it up to date with the branch that it is for)"
        for name in sorted(trusted_files.keys() - files.keys())
    ]
    return rollouts + removed


def _names_without_record(files: Mapping[Path, str], new_names: set[str]) -> list[str]:
    """Return why names are refused that have no record."""
    used_names = set()
    for name in files:
        if name.parts[0] == _RECORDS and len(name.parts) == _DEPTH:
            used_names.add(name.parts[1])
    return [
        f"{OWNERS}: {name[:40]!r} has no record: a name comes with the first record "
        "of it"
        for name in sorted(new_names - used_names)
    ]


def _is_unchanged(path: Path, trusted_path: Path) -> bool:
    return trusted_path.is_file() and filecmp.cmp(path, trusted_path, shallow=False)


def _files(root: Path) -> dict[Path, str]:
    """Return all files and empty folders, and what is odd about each.

    Odd is everything but a regular file of mode 100644. Stored rollouts are left out.
    Raises RecordError for too many.
    """
    modes = _modes_in_git(root)
    files = {
        name: f"git mode {mode}"
        for name, mode in (modes or {}).items()
        if mode != _PLAIN_MODE
    }
    for name, kind in _files_on_disk(root):
        is_unknown = modes is not None and not kind and name not in modes
        files.setdefault(
            name, "file that is not in git's commit" if is_unknown else kind
        )
        if len(files) > _MAX_FILES:
            raise RecordError(f"{root}: more than {_MAX_FILES} files")
    return files


def _files_on_disk(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield all files and empty folders, and what is odd about each."""
    for parent, folders, names in os.walk(root, followlinks=False):
        if not (folders or names):
            yield Path(parent).relative_to(root), "empty folder or submodule"
        for folder_name in tuple(folders):
            is_link = Path(parent, folder_name).is_symlink()
            if folder_name.endswith(ROLLOUTS_SUFFIX) and not is_link:
                folders.remove(folder_name)
        for file_name in (*folders, *names):
            file = Path(parent, file_name)
            kind = _kind_of(file)
            if kind != "folder":
                yield file.relative_to(root), kind


def _kind_of(path: Path) -> str:
    """Return what is odd about a file, or "folder".

    It is empty for a regular file.
    """
    mode = path.lstat().st_mode
    kind = file_kind(mode)
    if not kind and mode & 0o111:
        return "executable file"
    return kind


def _modes_in_git(root: Path) -> dict[Path, str] | None:
    """Return the modes of the files of ``root`` in git's commit.

    None outside a repository. A submodule need not have a folder on disk. Raises
    RecordError where git cannot tell.
    """
    folder = root.resolve()
    if not any(os.path.lexists(each / ".git") for each in (folder, *folder.parents)):
        return None
    command = ["git", "--no-replace-objects", "-c", "protocol.allow=never"]
    command += ["-C", str(root), "ls-tree", "-r", "-z", "HEAD"]
    # such as GIT_DIR, which would list another repository
    others = {key: text for key, text in os.environ.items() if key[:4] != "GIT_"}
    try:
        result = subprocess.run(command, capture_output=True, check=True, env=others)
    except FileNotFoundError:
        raise RecordError(f"{root} is a clone: install git to check it") from None
    except subprocess.CalledProcessError as error:
        lines = error.stderr.decode(errors="replace").split("\n", 1)
        reason = clean_text(lines[0], _MOST_OUTPUT) or f"status {error.returncode}"
        raise RecordError(
            f"{root}: git cannot list its files ({reason}): make a clone of your own "
            "and take that in"
        ) from None
    modes = {}
    for entry in os.fsdecode(result.stdout).split("\0"):
        if entry:
            about, name = entry.split("\t", 1)
            modes[Path(name)] = about.split()[0]
    return modes


def _proposed_owners(
    path: Path, trusted_names: Mapping[str, str], owner: str
) -> Mapping[str, str]:
    """Return proposed owners.

    Raises RecordError for any change but new names of ``owner``.
    """
    proposed = read_owners(path)
    for name, login in trusted_names.items():
        if proposed.get(name) != login:
            raise RecordError(
                f"{OWNERS}: {name!r} belongs to {login!r}: only maintainers change that"
            )
    new_names = [name for name in proposed if name not in trusted_names]
    if len(new_names) > _MAX_NEW_NAMES:
        raise RecordError(
            f"{OWNERS}: {len(new_names)} new names, expected at most "
            f"{_MAX_NEW_NAMES} in "
            "one proposal"
        )
    _require_free(new_names, [*baseline_names(), *trusted_names])
    for name in new_names:
        login = proposed[name]
        if login.lower() != owner.lower():
            raise RecordError(
                f"{OWNERS}: gives {name!r} to {login!r}, expected {owner!r} who asks "
                "for it"
            )
    return proposed


def _require_free(new_names: Sequence[str], taken_names: Sequence[str]) -> None:
    """Raise RecordError for a name that is taken, or looks like another one."""
    known_looks = {_look(name): name for name in taken_names}
    for name in new_names:
        if name in taken_names:
            raise RecordError(f"{OWNERS}: {name!r} is taken: choose another name")
        similar_name = known_looks.setdefault(_look(name), name)
        if similar_name != name:
            raise RecordError(
                f"{OWNERS}: {name!r} looks like {similar_name!r}, which is taken: "
                "choose "
                "another name"
            )


def _look(name: str) -> str:
    """Return a text that is equal for names that look alike."""
    text = name.lower().replace("rn", "m").replace("vv", "w")
    return text.translate(_LOOK_ALIKE)


def _notes_on_names(new_names: Collection[str], names: Iterable[str]) -> list[str]:
    """Return a note for each new name that is close to a name of ``names``."""
    notes = []
    all_names = [*baseline_names(), *(name for name in names if name not in new_names)]
    looks = {_look(name).rstrip(digits): name for name in all_names}
    for name in sorted(new_names):
        look = _look(name).rstrip(digits)
        if close := get_close_matches(look, looks, 1, _CLOSE):
            notes.append(
                f"{OWNERS}: {name!r} is close to {looks[close[0]]!r}: may readers take "
                "one for the other?"
            )
    return notes


def _accepted_record(
    record_file: Path,
    file_name: Path,
    trust: Trust,
    owners: Mapping[str, str],
    owner: str,
) -> Record:
    """Return the record in a file.

    Raises RecordError unless it can be accepted.
    """
    if (
        file_name.parts[0] != _RECORDS
        or len(file_name.parts) != _DEPTH
        or file_name.suffix != ".json"
    ):
        raise RecordError(
            f"{file_name}: expected {_RECORDS}/<submission>/<env id>.json and "
            f"{OWNERS} alone "
            "in a proposal"
        )
    record = checked_record(record_file)
    # else an old one could come back, or the best of many
    has_level = "level" in read_json(record_file, RecordError)
    if has_level or record == usable_record(trust.folder / file_name):
        raise RecordError(
            f"{file_name}: levels are written and removed by those who check "
            "records: leave "
            "`level` out, or bring the proposal up to date with the branch that it is "
            "for"
        )
    _require_current(record, file_name)
    _require_owner(record, file_name, owners, owner)
    return record


def _require_current(record: Record, file_name: Path) -> None:
    """Raise RecordError unless a record fits what ships and its path."""
    submission = record.submission.name
    env = record.env
    if file_name.parts[1:] != (submission, f"{env.id}.json"):
        raise RecordError(
            f"{file_name}: holds {submission!r} on {env.id}, expected it at "
            f"{submission}/{env.id}.json"
        )
    if record.converted_from is not None:
        raise RecordError(
            f"{file_name}: only maintainers convert records: make it with `mtp-bench "
            "submit`"
        )
    if why := why_scored_otherwise(record):
        raise RecordError(f"{file_name}: {why}: make it again with `mtp-bench submit`")
    if record.measured.made > today(days=1):  # clocks differ a little
        raise RecordError(
            f"{file_name}: made on {record.measured.made}, expected a day up to "
            f"{today()}: "
            "set the clock"
        )
    shipped_env = shipped(env.id)
    if shipped_env is None or shipped_env.card != env.card_digest:
        raise RecordError(
            f"{file_name}: {env.id} with card {env.card_digest} does not ship"
        )
    if not may_observe(record):
        raise RecordError(f"{file_name}: {FOR_BASELINES}")


def _require_owner(
    record: Record, file_name: Path, owners: Mapping[str, str], owner: str
) -> None:
    """Raise RecordError unless the submission of a record belongs to ``owner``."""
    submission = record.submission.name
    if submission in baseline_names():
        raise RecordError(
            f"{file_name}: {submission!r} is a baseline, only maintainers make its "
            "records"
        )
    login = owners.get(submission)
    if login is None:
        raise RecordError(
            f"{file_name}: the name {submission!r} does not have an owner: add "
            f'`"{submission}" = "LOGIN"` to {OWNERS}, with yours'
        )
    if login.lower() != owner.lower():
        raise RecordError(
            f"{file_name}: the name {submission!r} belongs to {login!r}, not to "
            f"{owner!r}"
        )


def _notes(record_file: Path, record: Record) -> Iterator[str]:
    """Yield sentences for the author of a record that is accepted."""
    why = why_unranked(record)
    if why is not None:
        yield f"{record_file}: not ranked yet: {why}"
    if not (record.submission.source and record.submission.commit):
        yield (
            f"{record_file}: a round needs `source` in submission.toml, and the "
            "commit: "
            "`mtp-bench submit --commit`"
        )
    if not record.training_data:
        yield (
            f"{record_file}: `training_data` in submission.toml is empty: state what "
            "it was "
            'trained on, or "nothing"'
        )
    seals = record.hashes.seals.encode()
    rollouts = record.hashes.rollouts.encode()
    # records of other submissions on this env
    for record_path in sorted(record_file.parents[1].glob(f"*/{record_file.name}")):
        content = record_path.read_bytes()
        if record_path != record_file and (seals in content or rollouts in content):
            yield f"{record_file}: gives the same answers as {record_path.parent.name}"
