"""The schema of a record, its canonical JSON and its digest."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ..._strict import Section, validate
from ...errors import MtpBenchError, RecordError
from ..files import require_folder, write_text

Status = Literal["finished", "partial", "crashed", "rejected"]
Level = Literal["scored", "re-scored", "re-run", "hidden seeds"]
LEVELS: tuple[Level, ...] = ("scored", "re-scored", "re-run", "hidden seeds")  # from the weakest on
UNSIGNED = ("digest", "verification")  # not part of the digest: the level grows when others check the record
ROLLOUTS = ".rollouts"  # suffix of the folder beside a record
_FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]  # it becomes part of a path
_Count = Annotated[int, Field(ge=0)]
_Hex = Annotated[str, Field(pattern=r"^[0-9a-f]*$")]


class SubmissionPart(Section):
    """What was run."""

    name: _FileName
    authors: list[str]
    description: str
    digest: _Hex  # over all files of the folder
    parameters: dict[str, Any]


class EnvPart(Section):
    """What it was run on."""

    id: _FileName
    card_digest: _Hex
    split: str
    data_manifest: _Hex  # over all that the scorer read
    scenes: _Count
    scenes_of_split: _Count
    observe: Literal["detections", "truth"]
    truth_complete: bool  # False: false forecasts cost nothing
    keywords: dict[str, Any]  # settings of the env beyond the card


class ScorerPart(Section):
    """What scored it."""

    definitions: str
    source_digest: _Hex


class ReferencePart(Section):
    """The frozen subsets."""

    name: str
    hash: _Hex  # empty: there are none
    origin: str


class HardwarePart(Section):
    """Where it was run."""

    cpu: str
    cores: _Count
    memory_gib: float
    gpu: str | None


class LatencyPart(Section):
    """Time per answer; the first of each scene, in which code is loaded and compiled, is left out."""

    p50_ms: float | None
    p95_ms: float | None
    max_ms: float | None
    limit_ms: float  # later answers are misses


class MissedPart(Section):
    """Frames, over all scenes and seeds, that are missing for another reason than silence; and scenes cut short."""

    late: _Count
    malformed: _Count
    crashed_scenes: _Count  # of scenes x seeds
    reasons: dict[str, str]  # "scene|seed" -> why it was cut short


class IsolationPart(Section):
    """What the agent was kept from in all its runs; not every system allows it."""

    network_cut: bool
    files_hidden: bool  # it saw no data and wrote nowhere but into its own folder


class MotionGap(Section):
    """Difference between the runs in a local frame turned and shifted at random and those in the usual one."""

    still: float  # m, missing-aware error of the seeds without motion
    moved: float  # m, of those with
    difference: float  # m, moved - still
    interval: list[float] | None


class ScenePart(Section):
    """Errors of one scene: enough to pair two records without their rollouts."""

    scene: str
    targets: _Count
    missing_aware: float | None  # m, mean over targets and seeds; null without a target
    seeds: list[float | None]  # m, the same per seed
    counts: dict[str, int]  # targets per subset
    errors: dict[str, list[float]]  # m, missing-aware error summed over the targets of a subset, per seed


class Record(Section):
    """One submission on one env."""

    format: Literal[1] = 1
    submission: SubmissionPart
    division: Literal["closed", "open"]
    training_data: list[str]  # as declared
    env: EnvPart
    scorer: ScorerPart
    reference: ReferencePart
    seeds: list[int]
    status: Status
    status_reason: str
    verification: Level = "scored"
    versions: dict[str, str]
    hardware: HardwarePart
    latency: LatencyPart
    peak_memory_mib: float
    missed: MissedPart
    isolation: IsolationPart
    hypotheses: _Count
    samples: _Count
    rows: list[dict[str, Any]]  # as in `compare --json`, one per subset
    details: dict[str, Any]
    motion_gap: MotionGap | None  # None: all seeds ran in the usual frame
    per_scene: list[ScenePart]
    seals: dict[str, str]  # "scene|seed" -> hash chain over the answers as they came
    rollout_digests: dict[str, str]  # "scene|seed"
    made: str  # ISO date, UTC
    digest: _Hex = ""

    @property
    def row(self) -> dict[str, Any]:
        """The row of the subset "all"."""
        return next(row for row in self.rows if row["subset"] == "all")


def sealed(record: Record) -> Record:
    """``record`` with the digest of its content."""
    return record.model_copy(update={"digest": content_digest(_plain(record))})


def content_digest(content: dict[str, Any]) -> str:
    """Hex sha256 over the canonical JSON of a record: sorted keys, no spaces, UTF-8, without UNSIGNED."""
    kept = {name: value for name, value in content.items() if name not in UNSIGNED}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def save_record(record: Record, path: str | Path) -> Record:
    """Write ``record`` with its digest and return it so; folders are made. The file appears complete or not at all.

    Raises MtpBenchError where it cannot be written, RecordError where its content is no JSON.
    """
    path = Path(path)
    try:
        record = sealed(record)
        text = json.dumps(_plain(record), indent=1, ensure_ascii=False, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RecordError(f"{path}: the record cannot be stored as JSON: {error}") from None
    require_folder(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MtpBenchError(f"cannot write {path}: {error.strerror or error}") from None
    write_text(path, text + "\n")
    return record


def load_record(path: str | Path) -> Record:
    """The record at ``path``.

    Raises RecordError, naming the file, where it is missing, of another format or schema, or does not fit its digest.
    """
    path = Path(path)
    content = _read(path)
    if content.get("format") != 1:
        raise RecordError(
            f"{path}: format {content.get('format')!r}, expected 1: made by another version of mtp-bench?"
        )
    record = validate(Record, content, str(path), RecordError)
    _require_rows(path, record)
    found = content_digest(content)
    if found != record.digest:
        raise RecordError(
            f"{path}: its content has the digest {found[:12]}, the file says {record.digest[:12] or 'none'}: it was "
            "changed after it was made; make it again with `mtp-bench submit`"
        )
    return record


def record_paths(folder: str | Path) -> list[Path]:
    """Files of the records in ``folder`` and the folders below it, sorted; stored rollouts do not count."""
    folder = Path(folder)
    found = sorted(folder.rglob("*.json"))
    return [path for path in found if not any(part.endswith(ROLLOUTS) for part in path.relative_to(folder).parts)]


def rollouts_folder(path: Path, seed: int) -> Path:
    """Where the stored rollouts of one seed of the record at ``path`` are."""
    return path.with_suffix(ROLLOUTS) / f"seed-{seed}"


def key_of(scene: str, seed: int) -> str:
    """Key of ``seals`` and ``rollout_digests``."""
    return f"{scene}|{seed}"


def _require_rows(path: Path, record: Record) -> None:
    if not any(row.get("subset") == "all" for row in record.rows):
        raise RecordError(f"{path}: rows has none for the subset 'all', expected one per subset")
    for scene in record.per_scene:
        wrong = [name for name, sums in scene.errors.items() if len(sums) != len(record.seeds)]
        if wrong or scene.errors.keys() != scene.counts.keys() or len(scene.seeds) != len(record.seeds):
            raise RecordError(f"{path}: per_scene of {scene.scene!r} lacks errors, expected one per subset and seed")


def _plain(record: Record) -> dict[str, Any]:
    """The record as it is read back: lists and numbers of JSON alone."""
    content: dict[str, Any] = record.model_dump(mode="json")
    return content


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except FileNotFoundError:
        raise RecordError(f"{path}: no such record; `mtp-bench submit` makes one") from None
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise RecordError(f"{path}: not valid JSON: {error}") from None
    if not isinstance(content, dict):
        raise RecordError(f"{path}: holds {type(content).__name__}, expected a table")
    return content


def _refuse(text: str) -> None:
    raise ValueError(f"{text} is no number of JSON")
