"""Signed levels: how far a record was checked, the member ``level`` of its file, which no digest of it covers.

Whoever checks a record signs the level that was reached, the results on hidden scenes, and digests of all that was run.
A statement on another record, or on an earlier version of it, does not fit.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, get_args

import numpy as np
from pydantic import Field

from ...core import (
    RecordError,
    Section,
    parse_json,
    read_bounded,
    read_json,
    write_text,
)
from ...scoring import SUBSETS, PairedDifference, Subset, UnitSums
from ..gateway.limits import SandboxBackend
from .canonical import Date, Sha256, canonical
from .consistency import inconsistent_sums
from .record import HiddenPart, Record
from .seal import ListedSeal
from .storage import MOST_BYTES, content_digest, measured_digest, parse_as, text_of
from .trust import MOST_SIGNATURE, SIGNER_PATTERN, Trust, sign

Level = Literal["scored", "re-scored", "re-run", "hidden"]
LEVELS: tuple[Level, ...] = get_args(Level)  # each includes those before it


class Statement(Section):
    """Signed content: verification level and digests that bind it to one record."""

    format: Literal[1] = 1
    level: Literal["re-scored", "re-run", "hidden"]
    record: Sha256  # its digest
    measured: Sha256  # digest of its times, memory and machine
    isolation: SandboxBackend  # sandbox of the agent when it was run again; of stored rollouts that of the record
    date: Date
    hidden: HiddenPart | None = None
    looked_at: bool = False  # by a maintainer, who found that it may be better than prediction from ground truth


class Attestation(Section):
    """The member ``level`` of the file of a record."""

    statement: Statement
    signer: Annotated[str, Field(pattern=SIGNER_PATTERN)]
    signature: Annotated[str, Field(max_length=MOST_SIGNATURE)]


class _Attested(
    Section, extra="ignore"
):  # the file of a record, of which the level alone is read
    level: Attestation | None = None


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
        rows = tuple(
            (row.targets, row.objects, round(row.effective_objects, 6))
            for row in sums.rows[: len(SUBSETS)]
        )
        return (
            *of,
            rows,
            tuple(
                tuple(round(w, 6) for w in sums.unit_weight(subset))
                for subset in SUBSETS
            ),
        )

    def sums_on(self, subset: Subset) -> UnitSums:
        """Return the ranking sums over the units of the targets of a subset."""
        return UnitSums(
            samples=self.record.samples,
            weight=np.array(self.sums.unit_weight(subset)),
            error=np.array(self.sums.unit_error(subset)),
            effective_objects=self.sums.row_of(subset).effective_objects,
        )

    def minus(self, other: "Checked", subset: Subset) -> PairedDifference | None:
        """BADE minus that of ``other``, metres, paired by unit; both have the same targets and units."""
        return self.sums_on(subset).minus(other.sums_on(subset))


def write_level(path: Path, statement: Statement, key: Path, signer: str) -> None:
    """Sign a statement on the record at ``path`` and write it into that file, in place of an earlier level.

    Raises MtpBenchError if ssh-keygen is missing or refuses the key, or the file cannot be read or written.
    """
    said = statement.model_dump(mode="json")
    level = {
        "statement": said,
        "signer": signer,
        "signature": sign(canonical(said), key),
    }
    content = read_json(path, RecordError, most=MOST_BYTES) | {
        "level": level
    }  # now: to sign may have taken minutes
    write_text(path.resolve(), text_of(content, path))


def read_level(
    path: Path, record: Record, trust: Trust
) -> tuple[SignedLevel | None, str]:
    """The level in the file ``path`` of a record, or None and the reason; the reason is empty without a level.

    Never raises for what the file holds: a level that cannot be trusted is not a level.
    """
    try:
        text, name = read_bounded(path, MOST_BYTES, RecordError), path.name
        if (signed := parse_as(_Attested, text, name).level) is None:
            return None, ""
        trust.check_once(lambda: _require_signed(signed, text, name, trust), text)
        return SignedLevel(
            signed.statement,
            signed.signer,
            _seal_of(name, signed.statement, record, trust),
        ), ""
    except RecordError as error:
        return None, str(error)


def _require_signed(signed: Attestation, text: str, name: str, trust: Trust) -> None:
    """Raise RecordError unless the level in the ``text`` of a record is signed, and of that record."""
    content = parse_json(text, name, RecordError)
    why = trust.why_not_signed(
        canonical(content["level"]["statement"]), signed.signature, signed.signer
    )
    if why:
        raise RecordError(f"{name}: level: not signed by a trusted key: {why}")
    if (signed.statement.record, signed.statement.measured) != (
        content_digest(content),
        measured_digest(content),
    ):
        raise RecordError(
            f"{name}: level: of another record, or of an earlier version of it"
        )


def _seal_of(
    name: str, statement: Statement, record: Record, trust: Trust
) -> ListedSeal | None:
    """The seal of hidden scenes; RecordError if the results do not fit it, or each other."""
    hidden = statement.hidden
    if (hidden is None) != (statement.level != "hidden"):
        raise RecordError(
            f"{name}: level {statement.level!r} {'with' if hidden else 'without'} hidden scenes"
        )
    if hidden is None:
        return None
    listed = trust.listed.get(hidden.commitment)
    if listed is None:
        raise RecordError(
            f"{name}: level: its hidden scenes are of no seal in {trust.seals}"
        )
    if (listed.env, listed.card_digest, listed.count) != (
        record.env.id,
        record.env.card_digest,
        hidden.scenes,
    ):
        raise RecordError(
            f"{name}: level: {hidden.scenes} hidden scenes of {record.env.id} with card {record.env.card_digest}, the "
            f"seal {listed.name!r} is of {listed.count} of {listed.env} with card {listed.card_digest}"
        )
    for problem in inconsistent_sums(hidden, float("inf")):
        raise RecordError(f"{name}: level: hidden scenes: {problem}")
    return listed
