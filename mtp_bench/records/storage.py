"""Records on disk: canonical JSON with a digest."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from ..errors import MtpBenchError, RecordError
from ..files import require_folder, write_text
from ..scoring.subsets import SUBSETS
from ..strict import read_json, validate
from .record import Record

OUTSIDE = ("digest", "measured")  # no part of the digest
MOST_BYTES = 8 << 20  # of a file
ROLLOUTS = ".rollouts"  # suffix of the folder beside a record
PARTS = ".part"  # suffix of the folder of a submit that is not done


def sealed(record: Record) -> Record:
    """``record`` with the digests of its content and of what was measured."""
    plain = _plain(record)
    measured = record.measured.model_copy(update={"digest": measured_digest(plain)})
    return record.model_copy(update={"digest": content_digest(plain), "measured": measured})


def canonical(content: Any) -> bytes:
    """JSON that is the same for equal contents: sorted keys, no spaces, UTF-8. Raises ValueError for what has none."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.encode()


def content_digest(content: dict[str, Any]) -> str:
    """Hex sha256 over the canonical JSON of a record without OUTSIDE."""
    return _sha256({name: value for name, value in content.items() if name not in OUTSIDE})


def measured_digest(content: dict[str, Any]) -> str:
    """Hex sha256 over what was measured: it tells of accidents alone."""
    return _sha256({name: value for name, value in content["measured"].items() if name != "digest"})


def _sha256(content: Any) -> str:
    return hashlib.sha256(canonical(content)).hexdigest()


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

    Raises RecordError, naming the file, where it is missing, of another format or schema, or does not fit its digest.
    """
    path = Path(path)
    content = read_table(path, "no such record; `mtp-bench submit` makes one")
    if content.get("format") != 2:
        raise RecordError(
            f"{path}: format {content.get('format')!r}, expected 2: those of definitions 1.0 rank no more; make it "
            "again with `mtp-bench submit`"
        )
    record = validate(Record, content, str(path), RecordError)
    _require_complete(path, record)
    for what, found, said in (
        ("its content", content_digest(content), record.digest),
        ("its section 'measured'", measured_digest(content), record.measured.digest),
    ):
        if found != said:
            raise RecordError(
                f"{path}: {what} has the digest {found[:12]}, the file says {said[:12] or 'none'}: it was changed "
                "after it was made; make it again with `mtp-bench submit`"
            )
    return record


def record_paths(folder: str | Path) -> list[Path]:
    """Files of the records in ``folder`` and the folders below it, sorted; rollouts and parts do not count."""
    folder = Path(folder)
    found = sorted(folder.rglob("*.json"))
    return [
        path for path in found if not any(part.endswith((ROLLOUTS, PARTS)) for part in path.relative_to(folder).parts)
    ]


def rollouts_folder(path: Path, seed: int) -> Path:
    """Where the stored rollouts of one seed of the record at ``path`` are."""
    return seed_folder(path.with_suffix(ROLLOUTS), seed)


def seed_folder(folder: Path, seed: int) -> Path:
    """The part of ``folder``, which holds the rollouts of all seeds, that is of one seed."""
    return folder / f"seed-{seed}"


def key_of(scene: str, seed: int) -> str:
    """Key of ``seals`` and ``rollout_digests``."""
    return f"{scene}|{seed}"


def _require_complete(path: Path, record: Record) -> None:
    subsets = [row.subset for row in record.rows]
    if subsets != list(SUBSETS):
        raise RecordError(f"{path}: rows are of {', '.join(subsets) or 'no subset'}, expected {', '.join(SUBSETS)}")
    names = [scene.scene for scene in record.per_scene]
    if len(set(names)) != len(names) or len(names) != record.env.scenes:
        raise RecordError(f"{path}: per_scene has {len(names)} scenes, expected {record.env.scenes}, each once")
    if not record.seeds or len(set(record.seeds)) != len(record.seeds) or min(record.seeds) < 0:
        raise RecordError(f"{path}: seeds are {record.seeds}, expected whole numbers from 0 on, each once")
    for scene in record.per_scene:
        sums = [part.get(subset, []) for part in (scene.weight, scene.error) for subset in SUBSETS]
        if {len(of_units) for of_units in sums} != {max(1, len(sums[0]))} or min(min(part) for part in sums) < 0:
            raise RecordError(
                f"{path}: per_scene of {scene.scene!r} lacks sums, expected one of 0 or more per subset and unit"
            )


def _plain(record: Record) -> dict[str, Any]:
    """The record as it is read back: lists and numbers of JSON alone."""
    content: dict[str, Any] = record.model_dump(mode="json")
    return content


def read_table(path: Path, absent: str) -> dict[str, Any]:
    """A table from a JSON file; raises RecordError where there is none, with ``absent`` where there is no file."""
    return read_json(path, RecordError, absent, MOST_BYTES)
