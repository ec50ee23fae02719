"""What nobody could know: scenes of hidden seeds, promised beforehand by a commitment, and secret motions.

A maintainer draws a secret range of seeds, publishes the sha256 of it with a salt, and keeps the file. Submissions are
later run on those scenes; when the file is published, anyone can check that it is the one that was promised. Only the
error over all hidden scenes is published, for the name of a scene tells its seed.

The seeds of a record are public, and with them how its scenes were turned and shifted: a table made for just those
motions would score. It does not under another one; an agent that tracks and predicts scores alike.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from ..cards import Card, HighwaySource, load_card
from ..errors import MtpBenchError, RecordError
from ..files import require_file, write_text
from ..running.options import RunOptions
from ..running.reference import make_reference
from ..scoring import Reference, read_reference, write_reference
from ..sources import discard, open_source
from ..strict import Section, validate
from .attestation import HiddenPart
from .record import Difference, Record
from .running import Plan, evaluate_plan, run_seed
from .storage import read_table

FIRST, LAST = 1_000_000, 2**31  # seeds are drawn from here; those of the cards are far below
MOST_SCENES = 1000
ALIKE = 0.1  # share of the error by which other draws may be worse; a baseline's seeds differ by 0.06 at most
_NEGLIGIBLE = 1e-3  # m
_FIRST, _SEEDS = 1 << 16, 1 << 31  # far from what anybody counts up to


class SecretSeeds(Section):
    """The content of the secret file."""

    format: Literal[1] = 1
    env: str
    card_digest: str
    first: Annotated[int, Field(ge=FIRST, lt=LAST)]
    count: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    salt: Annotated[str, Field(min_length=64)]  # so that nobody finds the seeds by trying all of them


class Commitment(Section):
    """The content of the public file."""

    format: Literal[1] = 1
    env: str
    card_digest: str
    count: int
    commitment: str  # sha256 of the secret


@dataclass(frozen=True)
class Sealed:
    """Secret seeds whose commitment was checked."""

    seeds: SecretSeeds
    commitment: str
    weights: Path  # file of the event weights, as secret: their keys are hashes of names that tell the seeds

    def card(self, card: Card) -> Card:
        """``card`` with the hidden scenes as its test split."""
        source = _simulated(card)
        first = self.seeds.first
        ranges = source.seeds.model_copy(update={"test": (first, first + self.seeds.count)})
        hidden = source.model_copy(update={"split": "test", "seeds": ranges})
        return card.model_copy(update={"source": hidden})

    def reference(self, hidden: Card, scenes: Sequence[str], options: RunOptions) -> Reference:
        """Event weights of the hidden scenes of `card`, made once per seal and kept beside the secret."""
        if self.weights.is_file():
            known = read_reference(self.weights)
            if known.card == hidden.digest and known.holds(scenes):
                return known
        reference = make_reference(hidden, scenes, options)
        write_reference(self.weights, reference)
        self.weights.chmod(0o600)
        return reference


def seal(env_id: str, count: int, path: str | Path) -> Commitment:
    """Draw ``count`` secret scenes of a simulated env; the secret goes to ``path``, its commitment beside it.

    Raises MtpBenchError where the env is not simulated, the file is there already or cannot be written.
    """
    path = Path(path)
    public = commitment_path(path)
    card = load_card(env_id)
    _simulated(card)
    if not 1 <= count <= MOST_SCENES:
        raise MtpBenchError(f"count is {count}, expected 1 to {MOST_SCENES}")
    for file in (path, public):
        require_file(file)
        if file.exists():
            raise MtpBenchError(f"{file} is there already: a seal is never replaced, name another file")
    first = FIRST + secrets.randbelow(LAST - FIRST - count)
    seeds = SecretSeeds(env=card.id, card_digest=card.digest, first=first, count=count, salt=secrets.token_hex(32))
    promise = Commitment(env=card.id, card_digest=card.digest, count=count, commitment=commitment_of(seeds))
    path.touch(mode=0o600)  # the secret is never readable by others, not even while it is written
    path.write_text(_canonical(seeds) + "\n", encoding="utf-8")
    write_text(public, json.dumps(promise.model_dump(), indent=1) + "\n")
    return promise


def open_seal(path: str | Path, commitment: str | Path | None = None) -> Sealed:
    """The secret seeds at ``path``, checked against their commitment: the file ``commitment``, None: the one beside.

    Raises RecordError where a file is missing or wrong, or the secret is not the one that was promised.
    """
    path = Path(path)
    public = commitment_path(path) if commitment is None else Path(commitment)
    absent = "no such file; `mtp-bench seal` makes a secret and its commitment"
    seeds = validate(SecretSeeds, read_table(path, absent), str(path), RecordError)
    promise = validate(Commitment, read_table(public, absent), str(public), RecordError)
    found = commitment_of(seeds)
    if (promise.commitment, promise.env, promise.count) != (found, seeds.env, seeds.count):
        raise RecordError(f"{path}: has the sha256 {found[:12]}, {public} promises {promise.commitment[:12]}")
    return Sealed(seeds, found, path.with_name(f"{path.stem}.weights.json"))


def commitment_path(path: Path) -> Path:
    """Where the commitment of the secret at ``path`` goes."""
    return path.with_name(f"{path.stem}.commitment.json")


def commitment_of(seeds: SecretSeeds) -> str:
    """Hex sha256 over the canonical JSON of the secret, salt included."""
    return hashlib.sha256(_canonical(seeds).encode()).hexdigest()


def run_hidden(plan: Plan, record: Record, sealed: Sealed) -> HiddenPart:
    """Error of the submission of ``plan`` on the hidden scenes, under the seeds of ``record``.

    The scenes are made anew and not kept: what lies in the cache can be read by agents outside the gateway. Raises
    RecordError where the seal is of another card, or the system cannot hide files and network from an agent.
    """
    card = plan.card
    if (sealed.seeds.env, sealed.seeds.card_digest) != (card.id, card.digest):
        raise RecordError(
            f"the seal is of {sealed.seeds.env} with card digest {sealed.seeds.card_digest}, the record of {card.id} "
            f"with {card.digest}"
        )
    hidden = sealed.card(card)
    try:
        names, options = tuple(open_source(hidden).names), replace(plan.options, data=None)
        there = replace(plan, env=hidden, card=hidden, scenes=names, scenes_of_split=len(names), options=options)
        runs = {seed: run_seed(there, seed) for seed in record.seeds}
        if not all(run.isolation.holds for results in runs.values() for run in results):
            raise RecordError(
                "this system cannot hide files and network from an agent, so its hidden scenes would not stay hidden: "
                "run it on Linux with user namespaces"
            )
        reference = sealed.reference(hidden, names, options)
        row = evaluate_plan(there, runs, reference).rows[0]
    finally:
        discard(hidden)
    return HiddenPart(
        commitment=sealed.commitment,
        weights=reference.digest,
        scenes=len(names),
        targets=row.targets,
        error=row.error,
        interval=row.interval,
    )


def worse_when_hidden(record: Record, hidden: HiddenPart) -> bool:
    """Whether the error on hidden scenes is larger than on the known ones: its interval lies wholly above theirs.

    The scenes are others, so the intervals are not paired; two of 95 % that do not touch are a difference that an agent
    without knowledge of the known scenes shows about once in 200 times.
    """
    known = record.row.interval
    return known is not None and hidden.interval is not None and hidden.interval[0] > known[1]


def _simulated(card: Card) -> HighwaySource:
    if not isinstance(card.source, HighwaySource):
        raise MtpBenchError(f"{card.id} is recorded, expected a simulated env: only those have scenes for any seed")
    return card.source


def _canonical(seeds: SecretSeeds) -> str:
    return json.dumps(seeds.model_dump(), sort_keys=True, separators=(",", ":"))


def error_when_moved(plan: Plan, reference: Reference) -> float | None:
    """Error of the submission of ``plan`` under one secret seed, metres; None without a target."""
    seed = _FIRST + secrets.randbelow(_SEEDS - _FIRST)
    return evaluate_plan(plan, {seed: run_seed(plan, seed)}, reference).rows[0].error


def worse_when_moved(record: Record, error: float | None) -> Difference | None:
    """What differs where ``error`` is worse than what the record is ranked by; None where they are alike.

    The worst of its seeds would be no measure: a table for the others, and nothing for that one, would pass.
    """
    ranked = record.row.error
    if error is None or ranked is None or error <= ranked * (1 + ALIKE) + _NEGLIGIBLE:
        return None
    return Difference("error under another motion", ranked, error)
