"""Seals: hidden scenes of secret seeds, which a published commitment fixes in advance.

A maintainer draws a secret range of seeds and a salt, publishes the sha256 of both, and
keeps the file. Submissions are later run on those scenes. When the seal is retired its
secret is published: then anyone can check it against the commitment, and it ranks no
further submission.
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

# Secret seeds are drawn from FIRST_SEED to LAST_SEED: far above those of the cards, and
# too many for an agent to find the name of its scene, from which noise and motion
# follow, by trying.
FIRST_SEED = SECRET_SEEDS
LAST_SEED = 2**62
MOST_SCENES = 1000
SEALS = Path("leaderboard", "seals")  # below the working folder: the checkout
# suffixes of the files
COMMITMENT = ".commitment.json"
RETIRED = ".retired.json"
WEIGHTS = ".weights.json"
_ABSENT = "no such file; `mtp-bench maintain seal` makes a secret and its commitment"


class SecretSeeds(Section):
    """Content of the secret file.

    Every scene is run once (format 1, of retired seals: once per seed of a record).
    """

    format: Literal[1, 2] = 2
    env: str
    card_digest: str
    first: Annotated[int, Field(ge=FIRST_SEED, lt=LAST_SEED)]
    count: Annotated[int, Field(ge=1, le=MOST_SCENES)]
    # a shorter one would let the seeds be found by trying all of them
    salt: Annotated[str, Field(min_length=64)]


class Commitment(Section):
    """Content of the public file."""

    format: Literal[1] = 1
    env: str
    card_digest: str
    count: int
    commitment: Sha256  # of the secret
    made: Date


class ListedSeal(Commitment):
    """A seal of the leaderboard, and whether its secret was published."""

    name: str
    retired: str  # date; empty: in use


class Retired(Section):
    """Content of the file that is published when a seal is retired."""

    format: Literal[1] = 1
    secret: SecretSeeds
    # hash of the event weights, in a file beside it; None: the seal was never used
    weights: Sha256 | None
    retired: Date


class RetiredSealError(RecordError):
    """The secret of a seal was published: its scenes rank no further submission."""


@dataclass(frozen=True)
class Sealed:
    """Secret seeds whose commitment was checked."""

    seeds: SecretSeeds
    commitment: str
    # file of the event weights. It is as secret as the seeds: its keys are hashes of
    # scene names, from which the seeds can be found
    weights: Path

    def card(self, card: Card) -> Card:
        """Return ``card`` with the hidden scenes as its test split."""
        source = _simulated_source(card)
        hidden_seeds = (self.seeds.first, self.seeds.first + self.seeds.count)
        ranges = source.seeds.model_copy(update={"test": hidden_seeds})
        hidden = source.model_copy(update={"split": "test", "seeds": ranges})
        return card.model_copy(update={"source": hidden})

    def run_seed(self, seed: int) -> int:
        """Return the secret seed of the run, which replaces the public ``seed``.

        A public seed would fix the motion, from which an agent could find the names of
        scenes.
        """
        return int(self._salted(f"run {seed}")[:15], 16)  # 60 bits

    def shuffled(self, scenes: Iterable[str]) -> tuple[str, ...]:
        """Return the hidden scenes in a secret order, which does not show their seeds.

        It is the same for every submission.
        """
        return tuple(sorted(scenes, key=lambda scene: self._salted(f"scene {scene}")))

    def _salted(self, purpose: str) -> str:
        return hashlib.sha256(f"{self.seeds.salt}|{purpose}".encode()).hexdigest()

    def reference(
        self, hidden: Card, scenes: Sequence[str], options: RunOptions
    ) -> Reference:
        """Return the event weights of the hidden scenes of a card.

        The weights are made once per seal and stored beside the secret.
        """
        if self.weights.is_file():
            stored = read_reference(self.weights)
            if stored.card == hidden.digest and stored.holds(scenes):
                return stored
        reference = make_reference(hidden, scenes, options)
        write_reference(self.weights, reference, secret=True)
        return reference


def commitment_of(seeds: SecretSeeds) -> str:
    """Return the hex sha256 of the canonical JSON of the secret, salt included."""
    return digest_of(seeds.model_dump())


def seal(env_id: str, count: int, secret_file: str | Path) -> Commitment:
    """Draw ``count`` secret scenes of a simulated env.

    The secret goes to ``secret_file``, its commitment beside it. Raises MtpBenchError
    if the env is not simulated, or the file exists or cannot be written.
    """
    secret_file = Path(secret_file)
    public_file = seal_path(secret_file, COMMITMENT)
    card = load_card(env_id)
    _simulated_source(card)
    if not 1 <= count <= MOST_SCENES:
        raise MtpBenchError(f"count is {count}, expected 1 to {MOST_SCENES}")
    for file in (secret_file, public_file):
        require_file(file)
        if file.exists():
            raise MtpBenchError(
                f"{file} exists: a seal is never replaced, name another file"
            )
    secret_seeds = SecretSeeds(
        env=card.id,
        card_digest=card.digest,
        first=FIRST_SEED + secrets.randbelow(LAST_SEED - FIRST_SEED - count),
        count=count,
        salt=secrets.token_hex(32),
    )
    commitment = Commitment(
        env=card.id,
        card_digest=card.digest,
        count=count,
        commitment=commitment_of(secret_seeds),
        made=today(),
    )
    secret_file.touch(mode=0o600)  # unreadable for others, also while it is written
    secret_file.write_bytes(canonical(secret_seeds.model_dump()) + b"\n")
    _publish(public_file, commitment)
    return commitment


def open_seal(
    secret_file: str | Path, listed: Mapping[str, ListedSeal] | None = None
) -> Sealed:
    """Read the secret seeds at ``secret_file`` and check them against their commitment.

    Raises RecordError if a file is missing or wrong or the secret does not fit its
    commitment, RetiredSealError if the seal is retired, beside the secret or among
    those ``listed`` by a leaderboard.
    """
    secret_file = Path(secret_file)
    secret_seeds, commitment = _committed(secret_file)
    published = (listed or {}).get(commitment.commitment)
    is_retired = published is not None and bool(published.retired)
    if is_retired or seal_path(secret_file, RETIRED).exists():
        raise RetiredSealError(
            f"{secret_file}: this seal is retired, its scenes are public: draw "
            "another with "
            "`mtp-bench maintain seal`"
        )
    return Sealed(secret_seeds, commitment.commitment, seal_path(secret_file, WEIGHTS))


def open_seals(path: Path, listed: Mapping[str, ListedSeal]) -> dict[str, Sealed]:
    """Open the seal at ``path``, or those in a folder, by env.

    Retired ones in a folder are left out. Raises RecordError if a secret is wrong, none
    is left, or two are of one env.
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
                    f"{secret}: a second seal of {sealed.seeds.env}, expected one: "
                    "retire the other, or name one file"
                )
            seals[sealed.seeds.env] = sealed
    if not seals:
        raise RecordError(
            f"{path}: no secret of a seal in use, expected NAME.json beside "
            f"NAME{COMMITMENT}"
        )
    return seals


def retire(secret_file: str | Path, folder: str | Path = SEALS) -> Path:
    """Publish the secret at ``secret_file`` in ``folder``.

    Returns the file. Event weights are published with it, if there are any. Raises
    RecordError if the secret does not fit its commitment, MtpBenchError if a file
    cannot be written.
    """
    secret_file = Path(secret_file)
    folder = Path(folder)
    secret_seeds, commitment = _committed(secret_file)
    weights = seal_path(secret_file, WEIGHTS)
    weights_hash = read_reference(weights).digest if weights.is_file() else None
    target = folder / seal_path(secret_file, RETIRED).name
    for file in (target, folder / weights.name):
        require_file(file)
    is_elsewhere = weights.parent.resolve() != folder.resolve()
    if weights_hash is not None and is_elsewhere:
        with whole_file(folder / weights.name) as part:
            shutil.copyfile(weights, part)
    _publish(folder / seal_path(secret_file, COMMITMENT).name, commitment)
    _publish(
        target, Retired(secret=secret_seeds, weights=weights_hash, retired=today())
    )
    return target


def _committed(secret_file: Path) -> tuple[SecretSeeds, Commitment]:
    """Read the secret at ``secret_file`` and its commitment.

    Raises RecordError if one is missing or they do not fit.
    """
    public_file = seal_path(secret_file, COMMITMENT)
    secret_seeds = read_as(SecretSeeds, secret_file, _ABSENT)
    commitment = read_as(Commitment, public_file, _ABSENT)
    secret_sha256 = commitment_of(secret_seeds)
    content = (secret_sha256, secret_seeds.env, secret_seeds.count)
    if (commitment.commitment, commitment.env, commitment.count) != content:
        raise RecordError(
            f"{secret_file}: has the sha256 {secret_sha256[:12]}, expected "
            f"{commitment.commitment[:12]} as in {public_file}"
        )
    return secret_seeds, commitment


def seal_path(secret: Path, suffix: str) -> Path:
    """Return the path of a file of the seal beside its secret."""
    return secret.with_name(f"{secret.stem}{suffix}")


def _publish(path: Path, content: Section) -> None:
    write_text(path, json.dumps(content.model_dump(), indent=1) + "\n")


def _simulated_source(card: Card) -> HighwaySource:
    if not isinstance(card.source, HighwaySource):
        raise MtpBenchError(
            f"{card.id} is recorded, expected a simulated env: only those have scenes "
            "for any seed"
        )
    return card.source
