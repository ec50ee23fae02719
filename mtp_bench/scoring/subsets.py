"""Frozen subsets: the targets on which the reference tracker made an error, the same for every agent.

A true box is named by the first 12 hex digits of sha256("env|scene|object|frame"), so that the subsets of a dataset
can be published without its content.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..errors import CardError, DataError
from ..files import whole_file
from ..types import Bools, Ints
from .definitions import DEFINITIONS

if TYPE_CHECKING:
    from .score import SceneScore

Subset = Literal["all", "ids", "lost", "reacquired", "frag"]
SUBSETS: tuple[Subset, ...] = get_args(Subset)
_STORED = ("ids", "lost", "reacquired")  # frag is lost or reacquired
_DIGITS = 12


@dataclass(frozen=True, eq=False)
class ReferenceSubsets:
    """Keys of the true boxes with an event of the reference tracker, sorted."""

    env: str
    card: str  # digest
    reference: str  # the baseline
    definitions: str
    ids: Ints
    lost: Ints
    reacquired: Ints

    @property
    def hash(self) -> str:
        """sha256 of the content."""
        text = json.dumps(_content(self), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    def keys(self, subset: str) -> Ints:
        """Keys of ``ids``, ``lost``, ``reacquired`` or ``frag``."""
        if subset == "frag":
            return np.union1d(self.lost, self.reacquired)
        keys: Ints = getattr(self, subset)
        return keys


def event_keys(env: str, scene: str, object_id: Ints, frame: Ints) -> NDArray[np.int64]:
    """Names [n] of true boxes: 48 bits of a sha256 as integers."""
    start = f"{env}|{scene}|"
    digests = (
        hashlib.sha256(f"{start}{o}|{t}".encode()).hexdigest()[:_DIGITS]
        for o, t in zip(object_id.tolist(), frame.tolist(), strict=True)
    )
    return np.fromiter((int(digest, 16) for digest in digests), dtype=np.int64, count=len(frame))


def reference_subsets(scores: Iterable[SceneScore], card: Card) -> ReferenceSubsets:
    """Subsets from the scores of the reference baseline: its own events on all true boxes of all scenes."""
    scores = list(scores)
    keys = {
        kind: np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(score.events[kind] for score in scores)]))
        for kind in _STORED
    }
    return ReferenceSubsets(card.id, card.digest, card.reference, DEFINITIONS, **keys)


def masks(reference: ReferenceSubsets, score: SceneScore) -> dict[str, Bools]:
    """Mask over the targets of ``score`` for every one of SUBSETS."""
    events: dict[str, Bools] = {name: np.isin(score.key, reference.keys(name)) for name in SUBSETS[1:]}
    return {"all": np.ones(len(score.key), dtype=bool), **events}


def write_reference(path: str | Path, reference: ReferenceSubsets) -> None:
    """Write the subsets as JSON with their hash; the file appears complete or not at all."""
    content = {**_content(reference), "hash": reference.hash}
    with whole_file(Path(path)) as part:
        part.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        part.chmod(0o644)  # subsets are public, whatever the user's own files are


def read_reference(path: str | Path, card: Card) -> ReferenceSubsets:
    """Read subsets written by `write_reference`.

    Raises DataError for a missing or broken file, a content that does not fit its hash, or other definitions, CardError
    where the subsets belong to another card.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise DataError(f"no reference subsets at {path}; score the baseline {card.reference!r} to make them") from None
    except ValueError as error:
        raise DataError(f"{path}: not valid JSON: {error}") from None
    reference = _parse(content, path)
    if content.get("hash") != reference.hash:
        raise DataError(f"{path}: the content has the hash {reference.hash}, the file says {content.get('hash')}")
    if (reference.env, reference.card) != (card.id, card.digest):
        raise CardError(
            f"{path}: subsets of {reference.env} with card digest {reference.card}, expected {card.id} with "
            f"{card.digest}; make them again for the changed card"
        )
    if reference.definitions != DEFINITIONS:
        raise DataError(f"{path}: made with definitions {reference.definitions}, expected {DEFINITIONS}; make it again")
    return reference


def _content(reference: ReferenceSubsets) -> dict[str, Any]:
    events = {kind: [f"{key:0{_DIGITS}x}" for key in reference.keys(kind).tolist()] for kind in _STORED}
    return {
        "env": reference.env,
        "card": reference.card,
        "reference": reference.reference,
        "definitions": reference.definitions,
        "counts": {kind: len(keys) for kind, keys in events.items()},
        "events": events,
    }


def _parse(content: Any, path: Path) -> ReferenceSubsets:
    try:
        env, card, reference, definitions = (str(content[k]) for k in ("env", "card", "reference", "definitions"))
        events = content["events"]
        ids, lost, reacquired = (np.array([int(k, 16) for k in events[kind]], dtype=np.int64) for kind in _STORED)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{path}: not a file of reference subsets: {type(error).__name__} {error}") from None
    return ReferenceSubsets(env, card, reference, definitions, ids, lost, reacquired)
