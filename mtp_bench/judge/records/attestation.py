"""Signed levels: how far a record was checked.

A level is the member ``level`` of the file of a record, which no digest of it covers.
Whoever checks a record signs the level that was reached, the results on hidden scenes,
and digests of all that was run. A statement on another record, or on an earlier version
of it, does not fit.

A converted level is one that an earlier form of the record had: the project checked it,
wrote the same facts in today's form, and did not run the submission again.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ...core import (
    RecordError,
    Section,
    parse_json,
    read_bounded,
    read_json,
    validate_json,
    write_text,
)
from ...scoring import PairedDifference, Row, Subset, UnitSums
from ..gateway.limits import SandboxBackend
from .canonical import canonical
from .consistency import result_problems
from .fields import Date, Level, Sha256
from .record import HiddenPart, Record
from .results import require_units
from .seal import ListedSeal
from .storage import MAX_BYTES, content_digest, measured_digest, text_of
from .trust import MOST_SIGNATURE, SIGNER_PATTERN, Trust, sign


class Statement(Section):
    """Signed content: verification level and digests that bind it to one record."""

    level: Level  # "scored" of converted records alone
    record: Sha256  # its digest
    measured: Sha256  # digest of its times, memory and machine
    # sandbox of the agent when it was run again; of stored rollouts that of the record
    isolation: SandboxBackend
    date: Date
    hidden: HiddenPart | None = None
    # a maintainer found that it may be better than prediction from ground truth
    looked_at: bool = False
    # the level of `Record.converted_from`: not run again
    converted: bool = False


class Attestation(Section):
    """The member ``level`` of the file of a record."""

    statement: Statement
    signer: Annotated[str, Field(pattern=SIGNER_PATTERN)]
    signature: Annotated[str, Field(max_length=MOST_SIGNATURE)]


class _RecordFile(Section, extra="ignore"):
    """The file of a record, of which the level alone is read."""

    level: Attestation | None = None


@dataclass(frozen=True)
class SignedLevel:
    """A level whose signature was checked."""

    statement: Statement
    signer: str
    seal: ListedSeal | None = None  # seal of the hidden scenes


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
    def hidden(self) -> HiddenPart | None:
        """Results on hidden scenes, if it was run on them."""
        return None if self.signed is None else self.signed.statement.hidden

    @property
    def on_hidden(self) -> bool:
        """True if its numbers are those of hidden scenes."""
        return self.hidden is not None

    @property
    def converted(self) -> bool:
        """True if the level was given to an earlier form of the record."""
        return self.signed is not None and self.signed.statement.converted

    @property
    def sums(self) -> Record | HiddenPart:
        """Results that rank: on the hidden scenes if there are any, else public."""
        return self.hidden or self.record

    @cached_property
    def conditions(self) -> tuple[str, ...]:
        """Data, scenes and units: equal for results that can be compared."""
        if self.hidden is not None:
            scenes = (self.hidden.commitment, self.hidden.weights)
        else:
            scenes = (self.record.env.split, self.record.env.data_manifest)
        return (*scenes, self.sums.targets.conditions)

    @cached_property
    def _rows(self) -> dict[Subset, Row]:
        return {}

    def row_of(self, subset: Subset) -> Row:
        """Return the row of the results that rank, which is made once."""
        if subset not in self._rows:
            self._rows[subset] = self.sums.row_of(subset)
        return self._rows[subset]

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the ranking sums over the units of the targets of a subset."""
        return self.sums.sums_on(subset, self.record.samples)

    def minus(self, reference: "Checked", subset: Subset) -> PairedDifference | None:
        """Return bADE minus that of ``reference``, metres, paired by unit.

        Both have the same targets and units.
        """
        return self.sums_on(subset).minus(reference.sums_on(subset))


def write_level(
    record_file: Path, statement: Statement, key: Path, signer: str
) -> None:
    """Sign a statement on a record and write it into its file.

    It takes the place of an earlier level. Raises MtpBenchError if ssh-keygen is
    missing or refuses the key, or the file cannot be read or written.
    """
    content = statement.model_dump(mode="json")
    level = {
        "statement": content,
        "signer": signer,
        "signature": sign(canonical(content), key),
    }
    # read after signing, which may have taken minutes
    file = read_json(record_file, RecordError, most=MAX_BYTES)
    write_text(record_file.resolve(), text_of(file | {"level": level}, record_file))


def read_level(
    record_file: Path, record: Record, trust: Trust
) -> tuple[SignedLevel | None, str]:
    """Return the level in the file of a record, or None and the reason.

    The reason is empty without a level. Never raises for what the file holds: a level
    that cannot be trusted is not a level.
    """
    try:
        text = read_bounded(record_file, MAX_BYTES, RecordError)
        content = validate_json(_RecordFile, text, record_file.name, RecordError)
        level = content.level
        if level is None:
            return None, ""
        trust.check_once(
            lambda: _require_signed(level, text, record_file.name, trust), text
        )
        _require_converted(level.statement, record, record_file.name)
        seal = _seal_of(record_file.name, level.statement, record, trust)
        return SignedLevel(level.statement, level.signer, seal), ""
    except RecordError as error:
        return None, str(error)


def _require_signed(
    level: Attestation, text: str, file_name: str, trust: Trust
) -> None:
    """Raise RecordError unless the level in a file is signed, and of its record."""
    content = parse_json(text, file_name, RecordError)
    signed = canonical(content["level"]["statement"])
    why = trust.why_not_signed(signed, level.signature, level.signer)
    if why:
        raise RecordError(f"{file_name}: level: not signed by a trusted key: {why}")
    digests = content_digest(content), measured_digest(content)
    if (level.statement.record, level.statement.measured) != digests:
        raise RecordError(
            f"{file_name}: level: of another record, or of an earlier version of it"
        )


def _require_converted(statement: Statement, record: Record, file_name: str) -> None:
    """Raise RecordError if a converted level is above that of the earlier record."""
    earlier = record.converted_from
    if not statement.converted:
        if statement.level == "scored":
            raise RecordError(
                f"{file_name}: level 'scored' is signed, expected a higher one"
            )
    elif earlier is None or earlier.level != statement.level:
        earlier_level = "none"
        if earlier is not None:
            earlier_level = repr(earlier.level)
        raise RecordError(
            f"{file_name}: level {statement.level!r} is converted, the earlier "
            "record had "
            f"{earlier_level}"
        )


def _seal_of(
    file_name: str, statement: Statement, record: Record, trust: Trust
) -> ListedSeal | None:
    """Return the seal of hidden scenes.

    Raises RecordError if the results do not fit it, or each other.
    """
    hidden = statement.hidden
    is_hidden = statement.level == "hidden"
    if is_hidden != (hidden is not None):
        raise RecordError(
            f"{file_name}: level {statement.level!r} {'with' if hidden else 'without'} "
            "hidden scenes"
        )
    if hidden is None:
        return None
    seal = trust.listed.get(hidden.commitment)
    if seal is None:
        raise RecordError(
            f"{file_name}: level: its hidden scenes are of no seal in {trust.seals}"
        )
    conditions = (record.env.id, record.env.card_digest, hidden.scenes)
    if (seal.env, seal.card_digest, seal.count) != conditions:
        raise RecordError(
            f"{file_name}: level: {hidden.scenes} hidden scenes of {record.env.id} "
            "with card "
            f"{record.env.card_digest}, the seal {seal.name!r} is of {seal.count} of "
            f"{seal.env} with card {seal.card_digest}"
        )
    require_units(hidden, f"{file_name}: level: hidden scenes")
    if problem := next(result_problems(hidden), None):
        raise RecordError(f"{file_name}: level: hidden scenes: {problem}")
    return seal
