"""Changes of a card: another split, another detector, or the detections of a file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from ..detector import load_profile, profile_names
from ..errors import CardError, DataError, MtpBenchError, UnknownNameError
from ..strict import read_toml, validate
from . import own
from .sections import DetectorSection, FilesSource
from .source import STORED_DETECTOR, SourceSection

if TYPE_CHECKING:
    from .card import Card

VARIANTS = ("iid", "hard")  # of a card's own simulated detector
SIMULATED = {  # profile that simulates a stored detector, or the one that is most like it
    "megvii": "nuscenes_megvii", "centerpoint": "nuscenes_centerpoint", "pointrcnn": "kitti_pointrcnn",
    "mvdet": "wildtrack_mvdet", "acf": "wildtrack_mvdet",
}  # fmt: skip


def with_split(card: Card, split: str) -> SourceSection:
    """The card's source on another split; see `Card.with_split`."""
    known = card.source.splits
    if split not in known:
        raise UnknownNameError(f"split of {card.id}", split, known)
    if isinstance(card.source, FilesSource) and card.source.scenes is not None and split != "all":
        raise CardError(
            f"{card.id}: its scenes are objects in memory, which have no split {split!r}, expected 'all'; give the "
            "scenes of that split alone"
        )
    changed = card.source.model_copy(update={"split": split})
    if isinstance(changed, FilesSource) and changed.folder is not None:
        folder = own.split_folder(Path(changed.folder), split)
        return changed.model_copy(update={"sha256": own.folder_digest(folder)})
    return changed


def with_detector(card: Card, name: str) -> tuple[SourceSection, DetectorSection | None]:
    """The card's source and the simulated detector that ``name`` means; see `Card.with_detector`."""
    own = card.detector or DetectorSection(field_of_view=card.source.traits.view)
    if name in VARIANTS:
        if card.detector is None:
            raise CardError(f"detector {name!r} is a variant of a simulated detector, and {card.id} has none")
        update: dict[str, object] = {"variant": name}
    elif name.endswith(".toml"):
        update = {"variant": "as_fitted", **_section_of(Path(name)), "profile": None, "noise": load_profile(name)}
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


def _section_of(path: Path) -> dict[str, object]:
    """What the section [detector] of a file says, as ``fit-noise`` writes it; nothing of a profile alone."""
    content = read_toml(path, CardError).get("detector")
    if not isinstance(content, dict):
        return {}
    section = validate(DetectorSection, content, f"{path.name}, [detector]", CardError)
    return {name: getattr(section, name) for name in section.model_fields_set}


def instead_of_stored(card: Card) -> str:
    """What to do where a card's stored detections are not there: the end of an error text."""
    profile = profile_of_stored(card)
    if not profile:
        return ""
    return f"; without them a simulated detector runs at once: --detector {profile} (detector={profile!r} in Python)"


def profile_of_stored(card: Card) -> str:
    """The profile that stands in for a card's stored detections; empty where none can."""
    family = card.detector_name.split("-", maxsplit=1)[0]
    profile = family if family in profile_names() else SIMULATED.get(family, "")
    try:
        card.with_detector(profile)
    except MtpBenchError:  # its truth is not complete, or no profile has its classes
        return ""
    return profile


def with_detections(card: Card, file: str | Path) -> SourceSection:
    """The card's source with detections of one's own; see `Card.with_detections`."""
    expected = card.source.traits.detection_file
    if not expected or card.detector is not None:
        why = "its detector is simulated" if expected else "only those of KITTI and nuScenes can be replaced"
        raise CardError(f"{card.id} takes no file of detections: {why}")
    path = Path(file).expanduser().absolute()
    try:
        digest = own.folder_digest(path, own.TEXTS) if path.is_dir() else own.known_digest(path)
    except OSError as error:
        raise DataError(f"detections {path}: {error.strerror}; expected {expected}") from None
    name = own.plain_name(f"{card.source.traits.stored_detector}-{path.stem}")
    changed = {"detector": name, "detections_sha256": digest, "detections_file": str(path)}
    return card.source.model_copy(update=changed)
