"""Cards by env id and from files, and changed copies: another split or detector, other detections, other scenes."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core import (
    SCORES,
    CardError,
    DataError,
    MtpBenchError,
    Scene,
    UnknownNameError,
    bundled,
    card_ids,
    read_toml,
    require_known,
    validate,
)
from ..detector import load_profile, profile_for, profile_names
from .card import Card, DetectorSection, check_consistency, check_detector
from .own import (
    TEXTS,
    folder_digest,
    known_digest,
    own_digest,
    plain_name,
    resolve_folder,
    scenes_digest,
    split_folder,
)
from .source import STORED_DETECTOR, FilesSource, read_source

CHANGES = (
    "split",
    "detector",
    "detection_file",
    "files",
    "presence",
)  # arguments of `changed_card`
VARIANTS = ("iid", "hard")  # of a card's own simulated detector


def load_card(name: str | Path) -> Card:
    """Read a card by env id or from a TOML file.

    Raises UnknownNameError for an id that does not exist and CardError for content that is wrong, naming the key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise CardError(
            f"the env is {name!r}, expected its id, the path of a card, or a card"
        )
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise CardError(f"no card file at {path}")
    else:
        require_known(
            "environment", str(name), card_ids(), "`mtp-bench envs` lists them"
        )
        path = bundled("envs") / f"{name}.toml"
    card = parse_card(read_toml(path, CardError), where=path.name)
    if card.id != path.stem:
        raise CardError(
            f"{path.name}: id is {card.id!r}, expected the file's stem {path.stem!r}"
        )
    if isinstance(card.source, FilesSource):
        return card.model_copy(
            update={
                "source": resolve_folder(
                    card.source, path.parent, card.lanes is not None
                )
            }
        )
    return card


def parse_card(content: dict[str, Any], where: str = "card") -> Card:
    """Validate the content of a card; errors name it by ``where``."""
    content = {**content, "source": read_source(content.get("source"), where)}
    card = validate(Card, content, where, CardError)
    check_consistency(card, where)
    return card


def changed_card(
    card: Card,
    split: str | None = None,
    detector: str | None = None,
    detection_file: str | None = None,
    files: str | None = None,
    presence: str | None = None,
) -> Card:
    """``card`` with all changes that are given. Own scenes (``files``) come first: split and detector are of them."""
    changes = (
        (with_files, files),
        (with_split, split),
        (with_detector, detector),
        (with_detections, detection_file),
        (with_presence, presence),
    )
    for change, value in changes:
        card = card if value is None else change(card, value)
    return card


def with_split(card: Card, split: str) -> Card:
    """The card on another split of its source; raises UnknownNameError for a split that the source does not have."""
    source = card.source
    require_known(f"split of {card.id}", split, source.splits)
    update = {"split": split}
    if isinstance(source, FilesSource):
        if source.scenes is not None and split != "all":
            raise CardError(
                f"{card.id}: its scenes are objects in memory, which have no split {split!r}, expected 'all'; give the "
                "scenes of that split alone"
            )
        if source.folder is not None:
            update["sha256"] = own_digest(
                split_folder(Path(source.folder), split), card.lanes is not None
            )
    return card.model_copy(update={"source": source.model_copy(update=update)})


def with_detector(card: Card, name: str) -> Card:
    """The card with another simulated detector, of the same reach; on nuScenes also with other stored detections.

    ``name``: a shipped profile, the path of a profile (.toml), or "iid" or "hard" for that variant of the card's own
    profile; on nuScenes any other name stands for ``detections/<name>*.json``. Raises UnknownNameError or CardError.
    """
    source = card.source
    update: dict[str, object]
    if name in VARIANTS:
        if card.detector is None:
            raise CardError(
                f"detector {name!r} is a variant of a simulated detector, and {card.id} has none"
            )
        update = {"variant": name}
    elif name.endswith(".toml"):
        update = {
            "variant": "as_fitted",
            **_section_of(Path(name)),
            "profile": None,
            "noise": load_profile(name),
        }
    elif name in profile_names():
        update = {"profile": name, "noise": None, "variant": "as_fitted"}
    elif source.traits.other_detections and card.detector is None:
        if not re.fullmatch(STORED_DETECTOR, name):
            raise CardError(
                f"detector is {name!r}, expected the first part of the names of its files"
            )
        return card.model_copy(
            update={
                "source": source.model_copy(update={"detector": name}),
                "tracker": {},
            }
        )
    else:
        raise UnknownNameError(
            "detector profile",
            name,
            [*profile_names(), *VARIANTS],
            "or give the path of a .toml file",
        )
    if source.traits.mixed_detections:  # else its stored detections would stay
        source = source.model_copy(update={"detector": None})
    section = (
        card.detector or DetectorSection(field_of_view=source.traits.view)
    ).model_copy(update=update)
    tracker = (
        card.tracker if name in VARIANTS else {}
    )  # the parameters suit the card's own detector
    changed = card.model_copy(
        update={"source": source, "detector": section, "tracker": tracker}
    )
    check_detector(changed, card.id)
    return changed


def with_detections(card: Card, file: str | Path) -> Card:
    """The card with stored detections of one's own.

    On nuScenes and Argoverse 2 ``file`` is a file in the official submission form, on KITTI a folder of text files,
    one per sequence. It stands in for the card's detector, by whose name agents choose their settings: "megvii" becomes
    "megvii-<file>". The digest covers the content of the file, not its path. Raises CardError if the card's source has
    no such files, and DataError if the file cannot be read.
    """
    traits = card.source.traits
    if not traits.detection_file or not (
        card.detector is None or traits.mixed_detections
    ):
        simulated = bool(traits.detection_file)
        why = (
            "its detector is simulated"
            if simulated
            else "only stored ones of a dataset's own form can be replaced"
        )
        raise CardError(f"{card.id} takes no file of detections: {why}")
    path = Path(file).expanduser().absolute()
    try:
        digest = folder_digest(path, TEXTS) if path.is_dir() else known_digest(path)
    except OSError as error:
        raise DataError(
            f"detections {path}: {error.strerror}; expected {traits.detection_file}"
        ) from None
    name = plain_name(f"{traits.stored_detector}-{path.stem}")
    update = {
        "detector": name,
        "detections_sha256": digest,
        "detections_file": str(path),
    }
    return card.model_copy(
        update={"source": card.source.model_copy(update=update), "detector": None}
    )


def with_files(card: Card, folder: str | Path) -> Card:
    """The card with the scenes of a folder of one's own (``docs/data/own.md``).

    Task, sizes, the name by which agents choose their settings and a simulated detector stay. With a simulated
    detector its detections take the place of those in the files. The digest covers the content of the files, not their
    path. Raises DataError if the folder is missing.
    """
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise DataError(
            f"no folder {path}, expected one with a sub-folder of tables for each scene"
        )
    return _with_own(
        card, folder=str(path), sha256=own_digest(path, card.lanes is not None)
    )


def with_scenes(card: Card, scenes: Sequence[Scene]) -> Card:
    """The card with `Scene` objects, whose ``class_id`` index ``task.classes``; the rest stays as in `with_files`.

    Raises CardError for an object that is not a scene, and for two scenes of one name.
    """
    names: set[str] = set()
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise CardError(
                f"scenes holds {type(scene).__name__}, expected Scene objects only, or names only"
            )
        if scene.name in names:
            raise CardError(
                f"two scenes are called {scene.name!r}, expected a name of its own for each"
            )
        names.add(scene.name)
    return _with_own(card, scenes=tuple(scenes), sha256=scenes_digest(scenes))


def with_presence(card: Card, presence: str | None) -> Card:
    """Return the card under which baselines state their confidences by another presence model.

    ``presence``: the file of a model that ``mtp-bench train presence`` wrote, or "scores": an object's confidence is
    the score of its last detection; None: the detector's model. Raises DataError if there is no such file.
    """
    if presence is not None and presence != SCORES:
        path = Path(presence).expanduser().absolute()
        if not path.is_file():
            raise DataError(
                f"no file {path}, expected one of `mtp-bench train presence`, or the word {SCORES!r}"
            )
        presence = str(path)
    return card.model_copy(update={"presence": presence})


def instead_of_stored(card: Card) -> str:
    """The end of an error message: what to do without the card's stored detections; empty if no profile stands in."""
    profile = profile_for(card.detector_name.split("-", maxsplit=1)[0])
    try:
        with_detector(card, profile)
    except MtpBenchError:  # there is no such profile, its truth is not complete, or no profile has its classes
        return ""
    return f"; without them a simulated detector runs at once: --detector {profile} (detector={profile!r} in Python)"


def _with_own(card: Card, **scenes: object) -> Card:
    """The card with a section ``files`` that keeps the traits of its source."""
    traits = card.source.traits
    section = FilesSource(
        name="files",
        detector=plain_name(card.detector_name),
        velocity=card.velocity,
        ego_motion=traits.common_frame,
        ego=traits.has_ego,
        view=traits.view,
        velocity_ahead=traits.velocity_ahead or None,
        places_only=traits.places_only or None,
        bounded_by_truth=traits.bounded_by_truth or None,
    )
    return card.model_copy(
        update={"source": section.model_copy(update=scenes), "drive": None}
    )


def _section_of(path: Path) -> dict[str, object]:
    """Keys of the section [detector] of a file, as ``fit-noise`` writes it; empty for a profile without a section."""
    content = read_toml(path, CardError).get("detector")
    if not isinstance(content, dict):
        return {}
    section = validate(DetectorSection, content, f"{path.name}, [detector]", CardError)
    return {name: getattr(section, name) for name in section.model_fields_set}
