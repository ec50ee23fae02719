"""Records on disk: JSON with digests and the signed level, and the stored rollouts."""

import glob
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...agent import PART_SUFFIX as PART_SUFFIX, ROLLOUTS_SUFFIX as ROLLOUTS_SUFFIX
from ...core import ABSENT, RecordError, Rollout, SectionT, read_bounded, validate_json
from ...running import load_run
from .canonical import digest_of
from .record import Record
from .results import require_units
from .targets import NO_TARGETS, read_targets, require_digest, ships

MAX_BYTES = 8 << 20  # of a file
NO_RECORD = "no such record; `mtp-bench submit` makes one"
_NOT_DIGESTED = ("digest", "measured", "level", "targets")


def load_record(path: str | Path) -> Record:
    """Read the record at ``path``, without the checks of `consistency.checked_record`.

    Raises RecordError, naming the file, if it is missing, too large or of another
    schema, or if its targets are missing or others than it names.
    """
    path = Path(path)
    return with_targets(read_as(Record, path, NO_RECORD), path)


def usable_record(path: Path) -> Record | None:
    """Return the record at ``path``.

    None if it is missing, or cannot be read.
    """
    try:
        return load_record(path)
    except RecordError:
        return None


def with_targets(record: Record, record_file: Path) -> Record:
    """Return the record with its targets, from its own file or the leaderboard's.

    Raises RecordError if they are missing, others than the record names, or of other
    units than its errors.
    """
    sha256 = record.targets_sha256
    if record.targets == NO_TARGETS:
        targets = read_targets(record_file, record.env.id, sha256)
        record = record.model_copy(update={"targets": targets})
    else:
        require_digest(record.targets, sha256, str(record_file))
    if not record.scenes:
        raise RecordError(
            f"{record_file}: its targets name no scene, expected one or more"
        )
    require_units(record, str(record_file))
    return record


def read_as(model: type[SectionT], path: Path, absent: str = ABSENT) -> SectionT:
    """Read a JSON file as ``model``.

    ``absent`` is the reason if there is no such file. Raises RecordError.
    """
    text = read_bounded(path, MAX_BYTES, RecordError, absent)
    return validate_json(model, text, str(path), RecordError)


def content_digest(content: Mapping[str, Any]) -> str:
    """Return the hex sha256 of the content of a record as canonical JSON.

    Digest, measurements and level are left out. So are the targets, since the content
    names them by their digest.
    """
    return digest_of(
        {name: value for name, value in content.items() if name not in _NOT_DIGESTED}
    )


def measured_digest(content: Mapping[str, Any]) -> str:
    """Return the hex sha256 of measurements: it shows accidental changes only."""
    measured = content["measured"].items()
    return digest_of({name: value for name, value in measured if name != "digest"})


def with_digests(record: Record) -> Record:
    """Return ``record`` with the digests of its content and of its measurements."""
    content = record.model_dump(mode="json", exclude={"targets"})
    measured = record.measured.model_copy(update={"digest": measured_digest(content)})
    return record.model_copy(
        update={"digest": content_digest(content), "measured": measured}
    )


def record_text(record: Record, record_file: Path) -> tuple[Record, str]:
    """Return ``record`` with its digests, and the text of its file.

    The text has no level. Targets that the leaderboard does not have go into it. Raises
    RecordError if the record cannot be written as JSON, or would be too large to be
    read again.
    """
    try:
        record = with_digests(record)
        shared = ships(record.env.id, record.targets_sha256)
        omitted = {"targets"} if shared else set[str]()
        content = record.model_dump(mode="json", exclude=omitted)
        return record, text_of(content, record_file)
    except (TypeError, ValueError, RecursionError) as error:
        raise RecordError(
            f"{record_file}: the record cannot be stored as JSON: {error}"
        ) from None


def text_of(content: Mapping[str, Any], record_file: Path) -> str:
    """Return the text of the file ``record_file`` with this record as JSON.

    Raises RecordError if it would be too large to be read again.
    """
    text = json.dumps(
        content, separators=(",", ":"), ensure_ascii=False, allow_nan=False
    )
    size = len(text.encode()) + 1
    if size > MAX_BYTES:
        raise RecordError(
            f"{record_file}: the record has {size >> 10} KiB, expected at most "
            f"{MAX_BYTES >> 10} KiB"
        )
    return f"{text}\n"


def record_paths(folder: str | Path, env_id: str = "") -> list[Path]:
    """Return the files of the records in ``folder`` and below it, sorted.

    Rollouts, unfinished submits and temporary files (.*) are left out. ``env_id``: only
    its records, as a record's file is named by its env.
    """
    folder = Path(folder)
    paths = []
    for path in folder.rglob(f"{glob.escape(env_id) or '*'}.json"):
        parts = path.relative_to(folder).parts
        is_other = any(
            p[0] == "." or p.endswith((ROLLOUTS_SUFFIX, PART_SUFFIX)) for p in parts
        )
        if not is_other:
            paths.append(path)
    return sorted(paths)


def seed_folder(folder: Path, seed: int) -> Path:
    """Return the folder of one seed in the folder of all rollouts."""
    return folder / f"seed-{seed}"


def stored_rollouts(record_file: Path, record: Record) -> dict[int, list[Rollout]]:
    """Read the stored rollouts of each seed, in the order of scenes.

    Raises RecordError if they are missing or not those of the record, RolloutError if a
    file is broken.
    """
    return {seed: _seed_rollouts(record_file, record, seed) for seed in record.seeds}


def _seed_rollouts(record_file: Path, record: Record, seed: int) -> list[Rollout]:
    rollout_folder = seed_folder(record_file.with_suffix(ROLLOUTS_SUFFIX), seed)
    if not rollout_folder.is_dir():
        raise RecordError(
            f"{record_file}: its rollouts of seed {seed} are not stored at "
            f"{rollout_folder}; run the "
            "submission again with --rerun"
        )
    stored_run = load_run(rollout_folder)
    for what, stored, expected in (
        ("card", stored_run.info.card_digest, record.env.card_digest),
        ("submission", stored_run.info.submission_digest, record.submission.digest),
        ("seed", stored_run.info.seed, seed),
        ("observe", stored_run.info.observe, record.env.observe),
    ):
        if stored != expected:
            raise RecordError(
                f"{rollout_folder}: made with {what} {stored!r}, the record "
                f"{record_file.name} says "
                f"{expected!r}"
            )
    rollouts = {rollout.scene: rollout for rollout in stored_run.rollouts}
    if sorted(record.scenes) != sorted(rollouts):
        unmatched = ", ".join(sorted(set(record.scenes) ^ set(rollouts))[:5])
        raise RecordError(
            f"{rollout_folder}: its scenes are not those of the record: "
            f"{unmatched or 'one occurs twice'}"
        )
    return [rollouts[scene] for scene in record.scenes]
