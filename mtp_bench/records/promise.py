"""The files of a seal: the secret, the commitment that is published first, and the secret published when it retires."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..sources.highway.section import SECRET_SEEDS
from ..strict import Section
from .canonical import Date, Sha256, digest_of

# Seeds are drawn from here. Those of the cards are far below, and there are so many that no agent finds the name of the
# scene that it is in by trying: its noise and its motion follow from it.
FIRST, LAST = SECRET_SEEDS, 2**62
MOST_SCENES = 1000
RETIRED = ".retired.json"  # suffix of what is published at the end


class SecretSeeds(Section):
    """The content of the secret file.

    Format 1: every scene is run under each seed of a record. Format 2: once, so that what one run sees of a scene helps
    no other run of the submission.
    """

    format: Literal[1, 2] = 2
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
    commitment: Sha256  # of the secret
    made: Date


class Retired(Section):
    """What is published when a seal is retired."""

    format: Literal[1] = 1
    secret: SecretSeeds
    weights: Sha256 | None  # hash of the event weights, in a file beside; None: it was never used
    retired: Date


def commitment_of(seeds: SecretSeeds) -> str:
    """Hex sha256 over the canonical JSON of the secret, salt included."""
    return digest_of(seeds.model_dump())
