"""Seals: hidden scenes of secret seeds, which a published commitment fixes in advance.

A maintainer draws a secret range of seeds and a salt, publishes the sha256 of both, and keeps the file. Submissions are
later run on those scenes. When the seal is retired its secret is published: then anyone can check it against the
commitment, and it ranks no further submission.
"""

import hashlib
import json
import secrets
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from ...cards import Card, load_card
from ...core import (
    MtpBenchError,
    RecordError,
    Section,
    require_file,
    whole_file,
    write_text,
)
from ...running import RunOptions, make_reference
from ...scoring import Reference, read_reference, write_reference
from ...traffic import SECRET_SEEDS, HighwaySource
from .canonical import canonical, digest_of, today
from .fields import Date, Sha256
from .storage import read_as

# Secret seeds are drawn from FIRST to LAST: far above those of the cards, and too many for an agent to find the name of
# its scene, from which noise and motion follow, by trying.
FIRST, LAST = SECRET_SEEDS, 2**62
MOST_SCENES = 1000
SEALS = Path("leaderboard", "seals")  # below the working folder: the checkout
COMMITMENT, RETIRED, WEIGHTS = (
    ".commitment.json",
    ".retired.json",
    ".weights.json",
)  # suffixes of the files
_ABSENT = "no such file; `mtp-bench maintain seal` makes a secret and its commitment"


class SecretSeeds(Section):
    """Content of the secret file. Every scene is run once (format 1, of retired seals: once per seed of a record)."""

    format: Literal[1, 2] = 2
    env: str
    card_digest: str
    first: Annotated[int, Field(ge=FIRST, lt=LAST)]
    count: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    salt: Annotated[
        str, Field(min_length=64)
    ]  # else the seeds could be found by trying all of them


class Commitment(Section):
    """Content of the public file."""

    format: Literal[1] = 1
    env: str
    card_digest: str
    count: int
    commitment: Sha256  # of the secret
    made: Date


class ListedSeal(Commitment):
    """A seal of the leaderboard: its commitment, and whether its secret was published."""

    name: str
    retired: str  # date; empty: in use


class Retired(Section):
    """Content of the file that is published when a seal is retired."""

    format: Literal[1] = 1
    secret: SecretSeeds
    weights: (
        Sha256 | None
    )  # hash of the event weights, in a file beside it; None: the seal was never used
    retired: Date


class RetiredSealError(RecordError):
    """The secret of a seal was published: its scenes rank no further submission."""


@dataclass(frozen=True)
class Sealed:
    """Secret seeds whose commitment was checked."""

    seeds: SecretSeeds
    commitment: str
    weights: Path  # file of the event weights, as secret as the seeds: its keys are hashes of names that tell them

    def card(self, card: Card) -> Card:
        """``card`` with the hidden scenes as its test split."""
        source = _simulated_source(card)
        ranges = source.seeds.model_copy(
            update={"test": (self.seeds.first, self.seeds.first + self.seeds.count)}
        )
        hidden = source.model_copy(update={"split": "test", "seeds": ranges})
        return card.model_copy(update={"source": hidden})

    def run_seed(self, seed: int) -> int:
        """Secret seed of the run, which replaces the public ``seed``.

        A public seed would fix the motion, from which an agent could find the names of scenes.
        """
        return int(self._drawn(f"run {seed}")[:15], 16)

    def shuffled(self, scenes: Iterable[str]) -> tuple[str, ...]:
        """The hidden scenes in a secret order, the same for every submission, which does not show their seeds."""
        return tuple(sorted(scenes, key=lambda scene: self._drawn(f"scene {scene}")))

    def _drawn(self, purpose: str) -> str:
        return hashlib.sha256(f"{self.seeds.salt}|{purpose}".encode()).hexdigest()

    def reference(
        self, hidden: Card, scenes: Sequence[str], options: RunOptions
    ) -> Reference:
        """Event weights of the hidden scenes of `card`, made once per seal and kept beside the secret."""
        if self.weights.is_file():
            known = read_reference(self.weights)
            if known.card == hidden.digest and known.holds(scenes):
                return known
        reference = make_reference(hidden, scenes, options)
        write_reference(self.weights, reference, secret=True)
        return reference


def commitment_of(seeds: SecretSeeds) -> str:
    """Hex sha256 of the canonical JSON of the secret, salt included."""
    return digest_of(seeds.model_dump())


def seal(env_id: str, count: int, path: str | Path) -> Commitment:
    """Draw ``count`` secret scenes of a simulated env; the secret goes to ``path``, its commitment beside it.

    Raises MtpBenchError if the env is not simulated, or the file exists or cannot be written.
    """
    path = Path(path)
    public = beside(path, COMMITMENT)
    card = load_card(env_id)
    _simulated_source(card)
    if not 1 <= count <= MOST_SCENES:
        raise MtpBenchError(f"count is {count}, expected 1 to {MOST_SCENES}")
    for file in (path, public):
        require_file(file)
        if file.exists():
            raise MtpBenchError(
                f"{file} exists: a seal is never replaced, name another file"
            )
    first = FIRST + secrets.randbelow(LAST - FIRST - count)
    seeds = SecretSeeds(
        env=card.id,
        card_digest=card.digest,
        first=first,
        count=count,
        salt=secrets.token_hex(32),
    )
    promise = Commitment(
        env=card.id,
        card_digest=card.digest,
        count=count,
        commitment=commitment_of(seeds),
        made=today(),
    )
    path.touch(mode=0o600)  # unreadable for others, also while it is written
    path.write_bytes(canonical(seeds.model_dump()) + b"\n")
    _publish(public, promise)
    return promise


def open_seal(
    path: str | Path, listed: Mapping[str, ListedSeal] | None = None
) -> Sealed:
    """Read the secret seeds at ``path`` and check them against the commitment in the file beside it.

    Raises RecordError if a file is missing or wrong or the secret does not fit its commitment, RetiredSealError if the
    seal is retired, beside the secret or among those ``listed`` by a leaderboard.
    """
    path = Path(path)
    seeds, promise = _committed(path)
    known = (listed or {}).get(promise.commitment)
    if beside(path, RETIRED).exists() or (known is not None and known.retired):
        raise RetiredSealError(
            f"{path}: this seal is retired, its scenes are public: draw another with `mtp-bench maintain seal`"
        )
    return Sealed(seeds, promise.commitment, beside(path, WEIGHTS))


def open_seals(path: Path, listed: Mapping[str, ListedSeal]) -> dict[str, Sealed]:
    """The seal whose secret is at ``path``, or those in a folder but retired ones, by env.

    Raises RecordError if a secret is wrong, none is left, or two are of one env.
    """
    if not path.is_dir():
        sealed = open_seal(path, listed)
        return {sealed.seeds.env: sealed}
    seals: dict[str, Sealed] = {}
    for public in sorted(path.glob(f"*{COMMITMENT}")):
        secret = public.with_name(f"{public.name.removesuffix(COMMITMENT)}.json")
        if not secret.is_file():
            continue
        with suppress(RetiredSealError):
            sealed = open_seal(secret, listed)
            if sealed.seeds.env in seals:
                raise RecordError(
                    f"{secret}: a second seal of {sealed.seeds.env}, expected one: retire the other, or name one file"
                )
            seals[sealed.seeds.env] = sealed
    if not seals:
        raise RecordError(
            f"{path}: no secret of a seal in use, expected NAME.json beside NAME{COMMITMENT}"
        )
    return seals


def retire(path: str | Path, folder: str | Path = SEALS) -> Path:
    """Publish the secret at ``path``, with its event weights if there are any, in ``folder``; the file.

    Raises RecordError if the secret does not fit its commitment, MtpBenchError if a file cannot be written.
    """
    path, folder = Path(path), Path(folder)
    (seeds, promise), weights = _committed(path), beside(path, WEIGHTS)
    hashed = read_reference(weights).digest if weights.is_file() else None
    target = folder / beside(path, RETIRED).name
    for file in (target, folder / weights.name):
        require_file(file)
    if hashed is not None and weights.parent.resolve() != folder.resolve():
        with whole_file(folder / weights.name) as part:
            shutil.copyfile(weights, part)
    _publish(folder / beside(path, COMMITMENT).name, promise)
    _publish(target, Retired(secret=seeds, weights=hashed, retired=today()))
    return target


def _committed(path: Path) -> tuple[SecretSeeds, Commitment]:
    """The secret at ``path`` and its commitment; RecordError if one is missing or they do not fit."""
    public = beside(path, COMMITMENT)
    seeds, promise = (
        read_as(SecretSeeds, path, _ABSENT),
        read_as(Commitment, public, _ABSENT),
    )
    sha256 = commitment_of(seeds)
    if (promise.commitment, promise.env, promise.count) != (
        sha256,
        seeds.env,
        seeds.count,
    ):
        raise RecordError(
            f"{path}: has the sha256 {sha256[:12]}, expected {promise.commitment[:12]} as in {public}"
        )
    return seeds, promise


def beside(secret: Path, suffix: str) -> Path:
    """Path of the commitment, the published secret or the event weights of the secret at ``secret``."""
    return secret.with_name(f"{secret.stem}{suffix}")


def _publish(path: Path, content: Section) -> None:
    write_text(path, json.dumps(content.model_dump(), indent=1) + "\n")


def _simulated_source(card: Card) -> HighwaySource:
    if not isinstance(card.source, HighwaySource):
        raise MtpBenchError(
            f"{card.id} is recorded, expected a simulated env: only those have scenes for any seed"
        )
    return card.source
