"""Signed levels: how far a record was checked, in a file beside it, ``<env>.level.json``.

A record does not state its own level. Whoever checks one signs the level that was reached, the results on hidden
scenes, and digests of all that was run. A statement on another record, or on an earlier version of it, does not fit.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import ConfigDict, Field

from ..errors import MtpBenchError, RecordError
from ..files import read_bounded, write_text
from ..gateway.limits import SandboxBackend
from ..scoring.definitions import SUBSETS, Subset
from ..scoring.statistics import PairedDifference, paired_difference
from ..strict import Section, parse_json
from .canonical import Date, Sha256, canonical
from .consistency import inconsistent_sums
from .record import HiddenPart, Record
from .seal import ListedSeal
from .storage import LEVEL_SUFFIX, MOST_BYTES, content_digest, measured_digest, parse_as
from .trust import MOST_SIGNATURE, SIGNER_PATTERN, Trust, sign

Level = Literal["scored", "re-scored", "re-run", "hidden"]
LEVELS: tuple[Level, ...] = get_args(Level)  # each includes those before it
UNTRUSTED = "not signed by a trusted key"


class Statement(Section):
    """Signed content: verification level and digests that bind it to one record.

    Levels of version 0.2 repeat parts of the record, which its digest covers: other keys are ignored.
    """

    model_config = ConfigDict(extra="ignore")

    format: Literal[1] = 1
    level: Literal["re-scored", "re-run", "hidden"]
    record: Sha256  # its digest
    measured: Sha256  # digest of its times, memory and machine
    isolation: SandboxBackend  # sandbox of the agent when it was run again; of stored rollouts that of the record
    date: Date
    hidden: HiddenPart | None = None
    looked_at: bool = False  # by a maintainer, who found that it may be better than prediction from ground truth


class Attestation(Section):
    """Content of the file ``<env>.level.json``."""

    statement: Statement
    signer: Annotated[str, Field(pattern=SIGNER_PATTERN)]
    signature: Annotated[str, Field(max_length=MOST_SIGNATURE)]


@dataclass(frozen=True)
class SignedLevel:
    """A level whose signature was checked."""

    statement: Statement
    signer: str
    seal: ListedSeal | None = None  # of the hidden scenes


@dataclass(frozen=True, eq=False)
class Checked:
    """A record and its signed level."""

    record: Record
    signed: SignedLevel | None = None

    @property
    def level(self) -> Level:
        """Verification level."""
        return "scored" if self.signed is None else self.signed.statement.level

    @property
    def on_hidden(self) -> bool:
        """True if its numbers are those of hidden scenes."""
        return self.signed is not None and self.signed.statement.hidden is not None

    @property
    def sums(self) -> Record | HiddenPart:
        """Ranking sums: of the hidden scenes if it was run on them, else of the public ones."""
        return (self.signed and self.signed.statement.hidden) or self.record

    @cached_property
    def conditions(self) -> tuple[object, ...]:
        """Data, scenes and units: equal for results that can be compared."""
        sums = self.sums
        env, scenes = self.record.env, (scene.scene for scene in self.record.per_scene)
        public = (env.split, env.data_manifest, *scenes)
        of = (sums.commitment, sums.weights) if isinstance(sums, HiddenPart) else public
        rows = tuple((row.targets, row.objects, round(row.effective_objects, 6)) for row in sums.rows[: len(SUBSETS)])
        return (*of, rows, tuple(tuple(round(w, 6) for w in sums.unit_weight(subset)) for subset in SUBSETS))

    def minus(self, other: "Checked", subset: Subset) -> PairedDifference | None:
        """BADE minus that of ``other``, metres, paired by unit; both have the same targets and units."""
        errors = self.sums.unit_error(subset), other.sums.unit_error(subset)
        return paired_difference(*errors, self.sums.unit_weight(subset))


def level_path(record: Path) -> Path:
    """Path of the level of the record at ``record``."""
    return record.with_name(record.name.removesuffix(".json") + LEVEL_SUFFIX)


def write_level(path: Path, statement: Statement, key: Path, signer: str) -> Path:
    """Sign a statement on the record at ``path`` and write it beside the record; the path of the file.

    Raises MtpBenchError if ssh-keygen is missing or refuses the key, or the file cannot be written.
    """
    content = statement.model_dump(mode="json")
    signed = {"statement": content, "signer": signer, "signature": sign(canonical(content), key)}
    target = level_path(path)
    if target.is_symlink():
        raise MtpBenchError(f"{target} is a link, expected an ordinary file: remove it")
    write_text(target, json.dumps(signed, indent=1, ensure_ascii=False) + "\n")
    return target


def read_level(path: Path, record: Record, trust: Trust) -> tuple[SignedLevel | None, str]:
    """The level beside the record at ``path``, or None and the reason; the reason is empty without such a file.

    Never raises for the content of the file: a level that cannot be trusted is not a level.
    """
    file = level_path(path)
    if not file.is_symlink() and not file.exists():
        return None, ""
    try:
        return _checked_level(file, path, record, trust), ""
    except RecordError as error:
        return None, str(error)


def _checked_level(file: Path, path: Path, record: Record, trust: Trust) -> SignedLevel:
    if file.is_symlink() or not file.is_file():
        raise RecordError(f"{file.name}: {UNTRUSTED}: it is not an ordinary file")
    text, stored = (read_bounded(each, MOST_BYTES, RecordError) for each in (file, path))
    trust.check_once(lambda: _require_signed(file.name, text, path.name, stored, trust), text, stored)
    statement, signer = (signed := parse_as(Attestation, text, file.name)).statement, signed.signer
    return SignedLevel(statement, signer, _seal_of(file, statement, record, trust))


def _require_signed(name: str, text: str, of: str, stored: str, trust: Trust) -> None:
    """Raise RecordError unless the level ``text`` is signed, and of the record ``stored``."""
    content = parse_json(text, name, RecordError)
    signed = parse_as(Attestation, text, name)
    why = trust.why_not_signed(canonical(content["statement"]), signed.signature, signed.signer)
    if why:
        raise RecordError(f"{name}: {UNTRUSTED}: {why}")
    record = parse_json(stored, of, RecordError)
    if (signed.statement.record, signed.statement.measured) != (content_digest(record), measured_digest(record)):
        raise RecordError(f"{name}: of another record, or of an earlier version of it")


def _seal_of(file: Path, statement: Statement, record: Record, trust: Trust) -> ListedSeal | None:
    """The seal of hidden scenes; RecordError if the results do not fit it, or each other."""
    hidden = statement.hidden
    if (hidden is None) != (statement.level != "hidden"):
        raise RecordError(f"{file.name}: level {statement.level!r} {'with' if hidden else 'without'} hidden scenes")
    if hidden is None:
        return None
    listed = trust.listed.get(hidden.commitment)
    if listed is None:
        raise RecordError(f"{file.name}: its hidden scenes are of no seal in {trust.seals}")
    if (listed.env, listed.card_digest, listed.count) != (record.env.id, record.env.card_digest, hidden.scenes):
        raise RecordError(
            f"{file.name}: {hidden.scenes} hidden scenes of {record.env.id} with card {record.env.card_digest}, the "
            f"seal {listed.name!r} is of {listed.count} of {listed.env} with card {listed.card_digest}"
        )
    for problem in inconsistent_sums(hidden, float("inf")):
        raise RecordError(f"{file.name}: hidden scenes: {problem}")
    return listed
