"""How far a record was checked: a signed statement in a file beside it, ``<env>.level.json``.

Nobody's record says its own level. Whoever checks one signs what was found: the level, what it scored on hidden scenes,
and digests of all that was run. A statement of another record, or of an earlier version of it, does not fit.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from ..errors import MtpBenchError, RecordError
from ..files import write_text
from ..strict import Section, validate
from .bounds import out_of_bounds, refuse
from .canonical import Date, Sha256, canonical
from .consistency import sums_that_do_not_fit
from .record import MOST_NAME, HiddenPart, Mechanism, Record, unequal
from .signing import MOST_SIGNATURE, SIGNER_PATTERN, sign, why_not_signed
from .storage import LEVEL_SUFFIX, read_table
from .trust import ListedSeal, Trust

Level = Literal["scored", "re-scored", "re-run", "hidden"]
LEVELS: tuple[Level, ...] = get_args(Level)  # from the weakest on, each includes those before it
UNTRUSTED = "not signed by a trusted key"
_Reached = Literal["re-scored", "re-run", "hidden"]
_Text = Annotated[str, Field(max_length=MOST_NAME)]


class Statement(Section):
    """What is signed: the level, and what it is the level of."""

    format: Literal[1] = 1
    level: _Reached
    record: Sha256  # its digest, and parts of what that is over
    env: _Text
    card: _Text
    data: Sha256
    observe: Literal["detections", "truth", "tracks"]
    submission: Sha256
    seeds: list[int]
    measured: Sha256  # times, memory and machine
    rollouts: Sha256  # of their digests
    seals: Sha256  # of the hash chains
    definitions: _Text
    scorer: Sha256
    weights: Sha256
    isolation: Mechanism  # what held the agent when it was run again; of stored rollouts what the record says
    date: Date
    ran_again: Date | None = None  # when it was, where an earlier level showed that; None: for this level
    hidden: HiddenPart | None = None


class Attestation(Section):
    """The content of the file."""

    statement: Statement
    signer: Annotated[str, Field(pattern=SIGNER_PATTERN)]
    signature: Annotated[str, Field(max_length=MOST_SIGNATURE)]


@dataclass(frozen=True)
class SignedLevel:
    """A level whose signature was checked."""

    statement: Statement
    signer: str
    seal: ListedSeal | None = None  # of the hidden scenes

    @property
    def level(self) -> Level:
        """How far the record was checked."""
        return self.statement.level

    @property
    def hidden(self) -> HiddenPart | None:
        """What it scored on hidden scenes."""
        return self.statement.hidden


@dataclass(frozen=True, eq=False)
class Checked:
    """A record, and how far it was checked."""

    record: Record
    signed: SignedLevel | None = None

    @property
    def level(self) -> Level:
        """How far it was checked."""
        return "scored" if self.signed is None else self.signed.level

    @property
    def on_hidden(self) -> bool:
        """Whether its numbers are those of hidden scenes."""
        return self.signed is not None and self.signed.hidden is not None

    @property
    def sums(self) -> Record | HiddenPart:
        """What ranks: of hidden scenes where it was run on them."""
        hidden = None if self.signed is None else self.signed.hidden
        return self.record if hidden is None else hidden


def level_path(record: Path) -> Path:
    """Where the level of the record at ``record`` is."""
    return record.with_name(record.name.removesuffix(".json") + LEVEL_SUFFIX)


def bound_to(record: Record) -> dict[str, Any]:
    """The part of a statement that tells of which record it is."""
    return {
        "record": record.digest,
        "env": record.env.id,
        "card": record.env.card_digest,
        "data": record.env.data_manifest,
        "observe": record.env.observe,
        "submission": record.submission.digest,
        "seeds": record.seeds,
        "measured": record.measured.digest,
        "rollouts": record.hashes.rollouts,
        "seals": record.hashes.seals,
        "definitions": record.scorer.definitions,
        "scorer": record.scorer.source_digest,
        "weights": record.reference.hash,
    }


def write_level(path: Path, statement: Statement, key: Path, signer: str) -> Path:
    """Sign a statement of the record at ``path`` and write it beside the record; the path of the file.

    Raises MtpBenchError where ssh-keygen is missing or refuses the key, or the file cannot be written.
    """
    content = statement.model_dump(mode="json")
    signed = {"statement": content, "signer": signer, "signature": sign(canonical(content), key)}
    target = level_path(path)
    if target.is_symlink():
        raise MtpBenchError(f"{target}: is a link, expected a file of its own: remove it")
    write_text(target, json.dumps(signed, indent=1, ensure_ascii=False) + "\n")
    return target


def read_level(path: Path, record: Record, trust: Trust) -> tuple[SignedLevel | None, str]:
    """The level beside the record at ``path``, and why there is none; both empty where there is no such file.

    Never raises for what the file holds: a level that cannot be trusted is none.
    """
    file = level_path(path)
    if not file.is_symlink() and not file.exists():
        return None, ""
    try:
        return _checked(file, record, trust), ""
    except RecordError as error:
        return None, str(error)


def _checked(file: Path, record: Record, trust: Trust) -> SignedLevel:
    if file.is_symlink() or not file.is_file():
        raise RecordError(f"{file.name}: {UNTRUSTED}: it is no file of its own")
    content = read_table(file, "no such level")
    refuse(out_of_bounds(content), file.name)
    signed = validate(Attestation, content, file.name, RecordError)
    why = why_not_signed(canonical(content["statement"]), signed.signature, signed.signer, trust)
    if why:
        raise RecordError(f"{file.name}: {UNTRUSTED}: {why}")
    known = bound_to(record)
    other = next(unequal("", signed.statement.model_dump(mode="json", include=set(known)), known), None)
    if other is not None:
        raise RecordError(
            f"{file.name}: of another record: {other.what} is {other.recorded!r}, the record has {other.found!r}"
        )
    return SignedLevel(signed.statement, signed.signer, _seal_of(file, signed.statement, trust))


def _seal_of(file: Path, statement: Statement, trust: Trust) -> ListedSeal | None:
    """The seal of hidden scenes; RecordError where the part does not fit its seal, or itself."""
    hidden = statement.hidden
    if (hidden is None) != (statement.level != "hidden"):
        raise RecordError(f"{file.name}: level {statement.level!r} {'with' if hidden else 'without'} hidden scenes")
    if hidden is None:
        return None
    listed = trust.listed.get(hidden.commitment)
    if listed is None:
        raise RecordError(f"{file.name}: its hidden scenes are of no seal in {trust.seals}")
    if (listed.env, listed.card_digest, listed.count) != (statement.env, statement.card, hidden.scenes):
        raise RecordError(
            f"{file.name}: has {hidden.scenes} hidden scenes of {statement.env} with card {statement.card}; its seal "
            f"{listed.name!r} is of {listed.count} of {listed.env} with card {listed.card_digest}"
        )
    refuse(sums_that_do_not_fit(hidden, float("inf")), f"{file.name}: hidden scenes")
    return listed
