"""Changes of a card: another split, another detector, or the detections of a file."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from ..detector import load_profile, profile_names
from ..errors import CardError, DataError, UnknownNameError
from ..files import file_digest
from .sections import STORED_DETECTOR, DetectorSection, Source

if TYPE_CHECKING:
    from .card import Card

VARIANTS = ("iid", "hard")  # of a card's own simulated detector


def with_split(card: Card, split: str) -> Source:
    """The card's source on another split; see `Card.with_split`."""
    known = get_args(type(card.source).model_fields["split"].annotation)
    if split not in known:
        raise UnknownNameError(f"split of {card.id}", split, known)
    return card.source.model_copy(update={"split": split})


def with_detector(card: Card, name: str) -> tuple[Source, DetectorSection | None]:
    """The card's source and the simulated detector that ``name`` means; see `Card.with_detector`."""
    own = card.detector or DetectorSection(field_of_view=card.source.traits.view)
    if name in VARIANTS:
        if card.detector is None:
            raise CardError(f"detector {name!r} is a variant of a simulated detector, and {card.id} has none")
        update: dict[str, object] = {"variant": name}
    elif name.endswith(".toml"):
        update = {"profile": None, "noise": load_profile(name), "variant": "as_fitted"}
    elif name in (*profile_names(), *profile_names(1)):
        update = {"profile": name, "noise": None, "variant": "as_fitted"}
    elif card.source.traits.other_detections and card.detector is None:
        if not re.fullmatch(STORED_DETECTOR, name):
            raise CardError(f"detector is {name!r}, expected the first part of the names of its files")
        return card.source.model_copy(update={"detector": name}), None
    else:
        known = [*profile_names(), *VARIANTS]
        raise UnknownNameError("detector profile", name, known, "or give the path of a .toml file")
    source = card.source
    if source.traits.mixed_detections:  # else its stored detections would stay
        source = source.model_copy(update={"detector": None})
    return source, own.model_copy(update=update)


def with_detections(card: Card, file: str | Path) -> Source:
    """The card's source with the detections of a file; see `Card.with_detections`."""
    if not card.source.traits.other_detections or card.detector is not None:
        raise CardError(f"{card.id} takes no file of detections: only stored detections of nuScenes can be replaced")
    path = Path(file).expanduser().absolute()
    try:
        state = path.stat()
        digest = _known_digest(path, state.st_size, state.st_mtime_ns, state.st_ctime_ns)
    except OSError as error:
        raise DataError(f"detections {path}: {error.strerror}") from None
    name = f"{card.source.traits.stored_detector}-{path.stem}"
    changed = {"detector": name, "detections_sha256": digest, "detections_file": str(path)}
    return card.source.model_copy(update=changed)


@cache
def _known_digest(path: Path, *state: int) -> str:
    """Sha256 of a file in this state: read once per process, for it may hold a gigabyte."""
    return file_digest(path)
