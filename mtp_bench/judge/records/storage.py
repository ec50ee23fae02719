"""Records on disk: JSON with digests and the signed level, and the stored rollouts beside it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...agent import PARTS as PARTS, ROLLOUTS as ROLLOUTS
from ...core import ABSENT, RecordError, Rollout, SectionT, explain, read_bounded
from ...running import load_run
from .canonical import digest_of
from .record import Record

MOST_BYTES = 8 << 20  # of a file
_NOT_DIGESTED = ("digest", "measured", "level")


def load_record(path: str | Path) -> Record:
    """Read the record at ``path``, without the checks of `consistency.checked_record`.

    Raises RecordError, naming the file, if it is missing, too large or of another schema.
    """
    return read_as(Record, Path(path), "no such record; `mtp-bench submit` makes one")


def usable_record(path: Path) -> Record | None:
    """The record at ``path``; None if it is missing, or cannot be read."""
    try:
        return load_record(path)
    except RecordError:
        return None


def read_as(model: type[SectionT], path: Path, absent: str = ABSENT) -> SectionT:
    """Read a JSON file as ``model``; raises RecordError, with the reason ``absent`` if there is no such file."""
    return parse_as(
        model, read_bounded(path, MOST_BYTES, RecordError, absent), str(path)
    )


def parse_as(model: type[SectionT], text: str, where: str) -> SectionT:
    """Parse JSON as ``model``; raises RecordError naming ``where`` the text is from."""
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        raise RecordError(
            f"{where}: {explain(error.errors(), model).removeprefix(': got ')}"
        ) from None


def content_digest(content: Mapping[str, Any]) -> str:
    """Hex sha256 of the canonical JSON of a record, without its digest, measurements and level."""
    return digest_of(
        {name: value for name, value in content.items() if name not in _NOT_DIGESTED}
    )


def measured_digest(content: Mapping[str, Any]) -> str:
    """Hex sha256 of the measurements of a record: it shows accidental changes only."""
    return digest_of(
        {name: value for name, value in content["measured"].items() if name != "digest"}
    )


def sealed(record: Record) -> Record:
    """``record`` with the digests of its content and of its measurements."""
    content = record.model_dump(mode="json")
    measured = record.measured.model_copy(update={"digest": measured_digest(content)})
    return record.model_copy(
        update={"digest": content_digest(content), "measured": measured}
    )


def record_text(record: Record, path: Path) -> tuple[Record, str]:
    """``record`` with its digests, and the text of the file ``path`` that stores it, without a level.

    Raises RecordError if it cannot be written as JSON, or would be too large to be read again.
    """
    try:
        record = sealed(record)
        return record, text_of(record.model_dump(mode="json"), path)
    except (TypeError, ValueError, RecursionError) as error:
        raise RecordError(
            f"{path}: the record cannot be stored as JSON: {error}"
        ) from None


def text_of(content: Mapping[str, Any], path: Path) -> str:
    """The text of the file ``path`` with this record as JSON; RecordError if it would be too large to be read again."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if (size := len(text.encode())) > MOST_BYTES:
        raise RecordError(
            f"{path}: the record has {size >> 10} KiB, expected at most {MOST_BYTES >> 10} KiB"
        )
    return text


def record_paths(folder: str | Path, env_id: str = "") -> list[Path]:
    """Files of the records in ``folder`` and below it, sorted; those of ``env_id`` alone if one is given.

    Rollouts, unfinished submits and temporary files (.*) are left out. A record's file is named by its env.
    """
    folder = Path(folder)
    aside = (ROLLOUTS, PARTS)  # ends of names
    paths = {
        path: path.relative_to(folder).parts
        for path in folder.rglob("*.json")
        if env_id in ("", path.stem)
    }
    return sorted(
        path
        for path, parts in paths.items()
        if not any(p[0] == "." or p.endswith(aside) for p in parts)
    )


def seed_folder(folder: Path, seed: int) -> Path:
    """The folder of one seed within ``folder``, which holds the rollouts of all seeds."""
    return folder / f"seed-{seed}"


def stored_rollouts(path: Path, record: Record) -> dict[int, list[Rollout]]:
    """Read the stored rollouts of each seed of the record at ``path``, in the order of ``per_scene``.

    Raises RecordError if they are missing or not those of the record, RolloutError if a file is broken.
    """
    runs = {}
    names = [scene.scene for scene in record.per_scene]
    for seed in record.seeds:
        folder = seed_folder(path.with_suffix(ROLLOUTS), seed)
        if not folder.is_dir():
            raise RecordError(
                f"{path}: its rollouts of seed {seed} are not stored at {folder}; run the submission again with --rerun"
            )
        run = load_run(folder)
        for what, stored, expected in (
            ("card", run.info.card_digest, record.env.card_digest),
            ("submission", run.info.submission_digest, record.submission.digest),
            ("seed", run.info.seed, seed),
            ("observe", run.info.observe, record.env.observe),
        ):
            if stored != expected:
                raise RecordError(
                    f"{folder}: made with {what} {stored!r}, the record {path.name} says {expected!r}"
                )
        rollouts = {rollout.scene: rollout for rollout in run.rollouts}
        if sorted(names) != sorted(rollouts):
            others = ", ".join(sorted(set(names) ^ set(rollouts))[:5])
            raise RecordError(
                f"{folder}: its scenes are not those of the record: {others or 'one occurs twice'}"
            )
        runs[seed] = [rollouts[name] for name in names]
    return runs
