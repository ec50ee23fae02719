"""Records on disk: canonical JSON with a digest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..errors import MtpBenchError, RecordError
from ..files import require_folder, write_text
from ..strict import SectionT, read_json, validate
from ..submission.manifest import PARTS as PARTS
from ..submission.manifest import ROLLOUTS as ROLLOUTS
from .bounds import MOST_BYTES, out_of_bounds, refuse
from .canonical import digest_of
from .consistency import inconsistencies
from .record import Record

OUTSIDE = ("digest", "measured")  # no part of the digest
LEVEL_SUFFIX = ".level.json"  # of the file beside a record that says how far it was checked
_MOVED = dict.fromkeys(("verification", "hidden"), "levels are in a signed file of their own, never in a record")


def sealed(record: Record) -> Record:
    """``record`` with the digests of its content and of what was measured."""
    plain = _plain(record)
    measured = record.measured.model_copy(update={"digest": measured_digest(plain)})
    return record.model_copy(update={"digest": content_digest(plain), "measured": measured})


def content_digest(content: dict[str, Any]) -> str:
    """Hex sha256 over the canonical JSON of a record without OUTSIDE."""
    return digest_of({name: value for name, value in content.items() if name not in OUTSIDE})


def measured_digest(content: dict[str, Any]) -> str:
    """Hex sha256 over what was measured: it tells of accidents alone."""
    return digest_of({name: value for name, value in content["measured"].items() if name != "digest"})


def save_record(record: Record, path: str | Path) -> Record:
    """Write ``record`` with its digest and return it so; folders are made. The file appears complete or not at all.

    Raises MtpBenchError where it cannot be written, RecordError where its content is no JSON.
    """
    path = Path(path)
    record, text = written(record, path)
    require_folder(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None
    write_text(path, text)
    return record


def written(record: Record, path: Path) -> tuple[Record, str]:
    """``record`` with its digests, and the content of the file ``path`` that holds it.

    Raises RecordError where it is no JSON, or too large to be read again.
    """
    try:
        record = sealed(record)
        text = json.dumps(_plain(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        size = len(text.encode())
    except (TypeError, ValueError, RecursionError) as error:
        raise RecordError(f"{path}: the record cannot be stored as JSON: {error}") from None
    if size > MOST_BYTES:
        raise RecordError(f"{path}: the record has {size >> 10} KiB, expected at most {MOST_BYTES >> 10} KiB")
    return record, text


def load_record(path: str | Path) -> Record:
    """The record at ``path``.

    Raises RecordError, naming the file, where it is missing, too large, of another format or schema, does not fit its
    digest, or says what does not follow from the rest of it.
    """
    return checked(read_table(Path(path), "no such record; `mtp-bench submit` makes one"), str(path))


def checked(content: dict[str, Any], path: str) -> Record:
    """The record that is ``content``, as JSON was read from ``path``. Raises RecordError as `load_record`."""
    refuse(out_of_bounds(content), path)
    if content.get("format") != 2:
        raise RecordError(
            f"{path}: format {content.get('format')!r}, expected 2: those of definitions 1.0 rank no more; make it "
            "again with `mtp-bench submit`"
        )
    for name, advice in _MOVED.items():
        if name in content:
            raise RecordError(f"{path}: has the key {name!r}: {advice}")
    record = validate(Record, content, path, RecordError)
    for what, found, said in (
        ("its content", content_digest(content), record.digest),
        ("its section 'measured'", measured_digest(content), record.measured.digest),
    ):
        if found != said:
            raise RecordError(
                f"{path}: {what} has the digest {found[:12]}, the file says {said[:12] or 'none'}: it was changed "
                "after it was made; make it again with `mtp-bench submit`"
            )
    refuse(inconsistencies(record), path)
    return record


def record_paths(folder: str | Path) -> list[Path]:
    """Files of the records in ``folder`` and the folders below it, sorted; no levels, rollouts or parts.

    Nor what is being written just now, or was when its writer was killed: such names of files and folders begin with
    a dot.
    """
    folder = Path(folder)
    found = [path for path in sorted(folder.rglob("[!.]*.json")) if not path.name.endswith(LEVEL_SUFFIX)]
    return [path for path in found if not any(_is_aside(part) for part in path.relative_to(folder).parts)]


def _is_aside(name: str) -> bool:
    return name.startswith(".") or name.endswith((ROLLOUTS, PARTS))


def rollouts_folder(path: Path, seed: int) -> Path:
    """Where the stored rollouts of one seed of the record at ``path`` are."""
    return seed_folder(path.with_suffix(ROLLOUTS), seed)


def seed_folder(folder: Path, seed: int) -> Path:
    """The part of ``folder``, which holds the rollouts of all seeds, that is of one seed."""
    return folder / f"seed-{seed}"


def _plain(record: Record) -> dict[str, Any]:
    """The record as it is read back: lists and numbers of JSON alone."""
    content: dict[str, Any] = record.model_dump(mode="json")
    return content


def read_table(path: Path, absent: str) -> dict[str, Any]:
    """A table from a JSON file; raises RecordError where there is none, with ``absent`` where there is no file."""
    return read_json(path, RecordError, absent, MOST_BYTES)


def read_as(model: type[SectionT], path: Path, absent: str = "no such file") -> SectionT:
    """A JSON file as ``model``; raises RecordError as `read_table`, and where it is none."""
    return validate(model, read_table(path, absent), str(path), RecordError)
