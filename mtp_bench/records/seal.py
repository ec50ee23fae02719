"""Seals: scenes of hidden seeds, promised beforehand by a commitment.

A maintainer draws a secret range of seeds, publishes the sha256 of it with a salt, and keeps the file. Submissions are
later run on those scenes. When the seal is retired its secret is published: then anyone can check that it is the one
that was promised, and it ranks nobody any more who was not scored before.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..cards import Card, load_card
from ..errors import MtpBenchError, RecordError
from ..files import require_file, whole_file, write_text
from ..running.options import RunOptions
from ..running.reference import make_reference
from ..scoring import Reference, read_reference, write_reference
from ..sources.highway.section import HighwaySource
from ..strict import Section
from .canonical import canonical, today
from .promise import FIRST, LAST, MOST_SCENES, RETIRED, Commitment, Retired, SecretSeeds, commitment_of
from .storage import read_as
from .trust import Trust

SEALS = Path("leaderboard", "seals")  # relative to the working folder: the checkout
_ABSENT = "no such file; `mtp-bench maintain seal` makes a secret and its commitment"


class RetiredSealError(RecordError):
    """The secret was published: its scenes rank nobody any more."""


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

    def run_seeds(self, seeds: Sequence[int]) -> dict[int, int]:
        """Secret seeds in place of the public ones under which hidden scenes are run.

        A motion of a known seed would tell the name of its scene.
        """
        run = seeds if self.seeds.format == 1 else seeds[:1]
        return {seed: int(self._drawn(f"run {seed}")[:15], 16) for seed in run}

    def shuffled(self, scenes: Iterable[str]) -> tuple[str, ...]:
        """The hidden scenes in the order of every submission's sums; theirs is that of consecutive seeds."""
        return tuple(sorted(scenes, key=lambda scene: self._drawn(f"scene {scene}")))

    def _drawn(self, purpose: str) -> str:
        return hashlib.sha256(f"{self.seeds.salt}|{purpose}".encode()).hexdigest()

    def reference(self, hidden: Card, scenes: Sequence[str], options: RunOptions) -> Reference:
        """Event weights of the hidden scenes of `card`, made once per seal and kept beside the secret."""
        if self.weights.is_file():
            known = read_reference(self.weights)
            if known.card == hidden.digest and known.holds(scenes):
                return known
        reference = make_reference(hidden, scenes, options)
        write_reference(self.weights, reference, secret=True)
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
    promise = Commitment(
        env=card.id, card_digest=card.digest, count=count, commitment=commitment_of(seeds), made=today()
    )
    path.touch(mode=0o600)  # the secret is never readable by others, not even while it is written
    path.write_bytes(canonical(seeds.model_dump()) + b"\n")
    _publish(public, promise)
    return promise


def open_seal(path: str | Path, commitment: str | Path | None = None, trust: Trust | None = None) -> Sealed:
    """The secret seeds at ``path``, checked against their commitment: the file ``commitment``, None: the one beside.

    Raises RecordError where a file is missing or wrong or the secret is not the one that was promised,
    RetiredSealError where the seal is retired, beside the secret or in the leaderboard of ``trust``.
    """
    path = Path(path)
    public = commitment_path(path) if commitment is None else Path(commitment)
    seeds = read_as(SecretSeeds, path, _ABSENT)
    found = commitment_of(seeds)
    promise = read_as(Commitment, public, _ABSENT)
    if (promise.commitment, promise.env, promise.count) != (found, seeds.env, seeds.count):
        raise RecordError(f"{path}: has the sha256 {found[:12]}, {public} promises {promise.commitment[:12]}")
    listed = None if trust is None else trust.listed.get(found)
    if retired_path(path).exists() or (listed is not None and listed.retired):
        raise RetiredSealError(
            f"{path}: this seal is retired, its scenes are public: draw another with `mtp-bench maintain seal`"
        )
    return Sealed(seeds, found, weights_path(path))


def require_listed(seals: Iterable[Sealed], trust: Trust) -> None:
    """Raise RecordError where the leaderboard of ``trust`` promises no such seal: its levels would not be shown."""
    for sealed in seals:
        if sealed.commitment not in trust.listed:
            raise RecordError(
                f"the seal of {sealed.seeds.env} with the sha256 {sealed.commitment[:12]} is not promised in "
                f"{trust.seals}, so no level on it would be shown: publish its commitment there first"
            )


def open_seals(folder: Path, trust: Trust) -> dict[str, Sealed]:
    """The seals whose secrets lie in ``folder``, by env; retired ones are left out.

    Raises RecordError where a secret is wrong, none is left, or two are of one env.
    """
    found: dict[str, Sealed] = {}
    for public in sorted(folder.glob("*.commitment.json")):
        path = public.with_name(public.name.replace(".commitment.json", ".json"))
        if not path.is_file():
            continue
        try:
            sealed = open_seal(path, trust=trust)
        except RetiredSealError:
            continue
        if sealed.seeds.env in found:
            raise RecordError(
                f"{path}: a second seal of {sealed.seeds.env} there, expected one: retire the other, or name one file"
            )
        found[sealed.seeds.env] = sealed
    if not found:
        raise RecordError(f"{folder}: no secret of a seal in use there, expected NAME.json beside NAME.commitment.json")
    return found


def retire(path: str | Path, folder: str | Path = SEALS) -> Path:
    """Publish the secret at ``path``, with its event weights where there are any, in ``folder``; the file.

    Raises RecordError where the secret does not fit its commitment, MtpBenchError where a file cannot be written.
    """
    path, folder = Path(path), Path(folder)
    seeds, weights = read_as(SecretSeeds, path, _ABSENT), weights_path(path)
    promise = read_as(Commitment, commitment_path(path), _ABSENT)
    if promise.commitment != commitment_of(seeds):
        raise RecordError(f"{path}: is not the secret that {commitment_path(path)} promises")
    hashed = read_reference(weights).digest if weights.is_file() else None
    target = folder / retired_path(path).name
    for file in (target, folder / weights.name):
        require_file(file)
    if hashed is not None and weights.parent.resolve() != folder.resolve():
        with whole_file(folder / weights.name) as part:
            shutil.copyfile(weights, part)
    _publish(folder / commitment_path(path).name, promise)
    _publish(target, Retired(secret=seeds, weights=hashed, retired=today()))
    return target


def commitment_path(path: Path) -> Path:
    """Where the commitment of the secret at ``path`` goes."""
    return path.with_name(f"{path.stem}.commitment.json")


def retired_path(path: Path) -> Path:
    """Where the secret at ``path`` is published, in its own folder."""
    return path.with_name(f"{path.stem}{RETIRED}")


def weights_path(path: Path) -> Path:
    """Where the event weights of the scenes of the secret at ``path`` are."""
    return path.with_name(f"{path.stem}.weights.json")


def _publish(path: Path, content: Section) -> None:
    write_text(path, json.dumps(content.model_dump(), indent=1) + "\n")


def _simulated(card: Card) -> HighwaySource:
    if not isinstance(card.source, HighwaySource):
        raise MtpBenchError(f"{card.id} is recorded, expected a simulated env: only those have scenes for any seed")
    return card.source
