"""Cards by env id and from files, and changed copies of them.

A copy may have another split or detector, other detections, or other scenes.
"""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypedDict

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
from .card import (
    Card,
    DetectorSection,
    PerturbSection,
    check_consistency,
    check_detector,
)
from .own import (
    own_digest,
    path_digest,
    plain_name,
    resolve_folder,
    scenes_digest,
    split_folder,
)
from .source import STORED_DETECTOR, FilesSource, read_source

IID = "iid"  # the variant of a card's own simulated detector


class ChangeKeywords(TypedDict, total=False):
    """Keywords that change the card of an env.

    None: as in the card.
    """

    split: str | None  # another split of the card's source, such as "train"
    # another detector: simulated, by a profile, or "iid"; on nuScenes also
    # stored, by the first part of the names of its files
    detector: str | None
    # file or folder of one's own stored detections, in place of the card's
    detections: str | os.PathLike[str] | None
    # folder of one's own scenes, in place of the card's (docs/data/own.md)
    files: str | os.PathLike[str] | None
    # presence model of baselines: its file, or "scores" of detections as they are
    presence: str | os.PathLike[str] | None
    # errors of the detector, such as {"noise": 2.0} (docs/environment/robustness.md)
    perturb: Mapping[str, float] | None


@dataclass(frozen=True, kw_only=True)
class CardChanges:
    """Values of `ChangeKeywords`, with paths as text."""

    split: str | None = None
    detector: str | None = None
    detections: str | None = None
    files: str | None = None
    presence: str | None = None
    perturb: Mapping[str, float] | None = None

    @property
    def changes(self) -> dict[str, Any]:
        """The values that are not None, as keywords.

        A stored run keeps them.
        """
        values = {
            field.name: getattr(self, field.name) for field in fields(CardChanges)
        }
        return {name: value for name, value in values.items() if value is not None}

    def apply(self, card: Card) -> Card:
        """Return ``card`` with all changes.

        Raises CardError, UnknownNameError.
        Own scenes come first: split and detector are then chosen for them.
        """
        changes = self.changes
        for name, change in _CHANGES.items():
            if name in changes:
                card = change(card, changes[name])
        return card


def load_card(name: str | Path) -> Card:
    """Read a card by env id or from a TOML file.

    Raises UnknownNameError for an id that does not exist, and CardError for wrong
    content, naming the key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise CardError(
            f"the env is {name!r}, expected its id, the path of a card, or a card"
        )
    path = Path(name)
    if path.suffix != ".toml":
        advice = "`mtp-bench envs` lists them"
        require_known("environment", str(name), card_ids(), advice)
        path = bundled("envs") / f"{name}.toml"
    elif not path.is_file():
        raise CardError(f"no card file at {path}")
    card = parse_card(read_toml(path, CardError), where=path.name)
    if card.id != path.stem:
        raise CardError(
            f"{path.name}: id is {card.id!r}, expected the file's stem {path.stem!r}"
        )
    if isinstance(card.source, FilesSource):
        source = resolve_folder(card.source, path.parent, card.lanes is not None)
        return card.model_copy(update={"source": source})
    return card


def parse_card(content: dict[str, Any], where: str = "card") -> Card:
    """Validate the content of a card.

    Errors name it by ``where``.
    """
    content = {**content, "source": read_source(content.get("source"), where)}
    card = validate(Card, content, where, CardError)
    check_consistency(card, where)
    # as recorded is no change, in a file too
    return card if card.perturb is None else with_perturb(card, dict(card.perturb))


def with_split(card: Card, split: str) -> Card:
    """Return the card on another split of its source.

    Raises UnknownNameError for a split that the source does not have.
    """
    source = card.source
    require_known(f"split of {card.id}", split, source.splits)
    update = {"split": split}
    if isinstance(source, FilesSource):
        if source.scenes is not None and split != "all":
            raise CardError(
                f"{card.id}: its scenes are objects in memory, which have no split "
                f"{split!r}, expected 'all'; give the scenes of that split alone"
            )
        if source.folder is not None:
            folder = split_folder(Path(source.folder), split)
            update["sha256"] = own_digest(folder, card.lanes is not None)
    source = source.model_copy(update=update)
    return card.model_copy(update={"source": source})


def with_classes(card: Card, classes: Sequence[str]) -> Card:
    """Return the card with some of its classes, in its order.

    Raises UnknownNameError for a class that it does not have.
    """
    for name in classes:
        require_known(f"class of {card.id}", name, card.task.classes)
    content = card.stored()
    task = content["task"]
    task["classes"] = [name for name in card.task.classes if name in classes]
    gate = task["event_gate"]
    for section, key in (
        (task, "forecast_gate"),
        (task, "miss_error"),
        (gate, "threshold"),
    ):
        section[key] = {name: section[key][name] for name in task["classes"]}
    return parse_card(content, card.id)


def with_detector(card: Card, name: str) -> Card:
    """Return the card with another detector, of the same reach.

    ``name``: a shipped profile, the path of a profile (.toml), or "iid" for that
    variant of the card's own profile. On nuScenes any other name stands for the
    stored detections ``detections/<name>*.json``. Raises UnknownNameError or CardError.
    """
    source = card.source
    update = _detector_update(card, name)
    if update is None:  # a stored detector
        source = source.model_copy(update={"detector": name})
        return card.model_copy(update={"source": source, "tracker": {}})
    if source.traits.mixed_detections:  # else its stored detections would stay
        source = source.model_copy(update={"detector": None})
    section = card.detector or DetectorSection(field_of_view=source.traits.view)
    changes: dict[str, object] = {
        "source": source,
        "detector": section.model_copy(update=update),
    }
    if name != IID:  # the parameters suit the card's own detector
        changes["tracker"] = {}
    changed = card.model_copy(update=changes)
    check_detector(changed, card.id)
    return changed


def _detector_update(card: Card, name: str) -> dict[str, object] | None:
    """Return the changes of the section [detector].

    None for a stored detector.
    """
    if name == IID:
        if card.detector is None:
            raise CardError(
                f"detector {name!r} is a variant of a simulated detector, "
                f"and {card.id} has none"
            )
        return {"variant": name}
    if name.endswith(".toml"):
        section = _detector_section(Path(name))
        noise = load_profile(name)
        return {"variant": "as_fitted", **section, "profile": None, "noise": noise}
    if name in profile_names():
        return {"profile": name, "noise": None, "variant": "as_fitted"}
    if not card.source.traits.other_detections or card.detector is not None:
        names = [*profile_names(), IID]
        advice = "or give the path of a .toml file"
        raise UnknownNameError("detector profile", name, names, advice)
    if not re.fullmatch(STORED_DETECTOR, name):
        raise CardError(
            f"detector is {name!r}, expected the first part of the names of its files"
        )
    return None


def with_detections(card: Card, file: str | Path) -> Card:
    """Return the card with the user's stored detections.

    On nuScenes and Argoverse 2 ``file`` is a file in the official submission form, on
    KITTI a folder of text files, one per sequence. It stands in for the card's
    detector, by whose name agents choose their settings: "megvii" becomes
    "megvii-<file>". The digest covers the content of the file, not its path. Raises
    CardError if the card's source has no such files, and DataError if the file cannot
    be read.
    """
    traits = card.source.traits
    if not traits.detection_file:
        raise CardError(
            f"{card.id} takes no file of detections: "
            "only stored ones of a dataset's own form can be replaced"
        )
    if card.detector is not None and not traits.mixed_detections:
        raise CardError(
            f"{card.id} takes no file of detections: its detector is simulated"
        )
    path = Path(file).expanduser().absolute()
    try:
        digest = path_digest(path)
    except OSError as error:
        raise DataError(
            f"detections {path}: {error.strerror}; expected {traits.detection_file}"
        ) from None
    update = {
        "detector": plain_name(f"{traits.stored_detector}-{path.stem}"),
        "detections_sha256": digest,
        "detections": str(path),
    }
    source = card.source.model_copy(update=update)
    return card.model_copy(update={"source": source, "detector": None})


def with_files(card: Card, folder: str | Path) -> Card:
    """Return the card with the user's scenes in ``folder`` (``docs/data/own.md``).

    Task, sizes, a simulated detector and the name by which agents choose their settings
    remain those of the card. Detections of a simulated detector replace those in the
    files.
    The digest covers the content of the files, not their path. Raises DataError if the
    folder is missing.
    """
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise DataError(
            f"no folder {path}, expected one with a sub-folder of tables for each scene"
        )
    digest = own_digest(path, card.lanes is not None)
    return _with_own_scenes(card, folder=str(path), sha256=digest)


def with_scenes(card: Card, scenes: Sequence[Scene]) -> Card:
    """Return the card with `Scene` objects, whose ``class_id`` index ``task.classes``.

    `with_files` says what remains of the card. Raises CardError for an object that is
    not a scene, and for two scenes of one name.
    """
    names: set[str] = set()
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise CardError(
                f"scenes contains an object of type {type(scene).__name__}; "
                "expected a list of Scene objects, or a list of names"
            )
        if scene.name in names:
            raise CardError(
                f"two scenes are called {scene.name!r}, expected different names"
            )
        names.add(scene.name)
    digest = scenes_digest(scenes)
    return _with_own_scenes(card, scenes=tuple(scenes), sha256=digest)


def with_presence(card: Card, presence: str | None) -> Card:
    """Return the card under which baselines use another presence model.

    ``presence``: the file of a model that ``mtp-bench train presence`` wrote, or
    "scores": an object's confidence is the score of its last detection; None: the
    detector's model. Raises DataError if there is no such file.
    """
    if presence is not None and presence != SCORES:
        path = Path(presence).expanduser().absolute()
        if not path.is_file():
            raise DataError(
                f"no file {path}, expected one of `mtp-bench train presence`, "
                f"or the word {SCORES!r}"
            )
        presence = str(path)
    return card.model_copy(update={"presence": presence})


def with_perturb(card: Card, levels: Mapping[str, float] | None) -> Card:
    """Return the card with larger or smaller errors of its detector.

    ``levels``: by the knobs of `PerturbSection`; None, or all as recorded: unchanged
    detections. Raises CardError for another knob, a level beyond its limits, and for
    false detections of a closed loop, whose later frames they need.
    """
    if not isinstance(levels, Mapping | None):
        raise CardError(
            f"perturb is {levels!r}, expected levels by knob, such as {{'noise': 2.0}}"
        )
    section = validate(
        PerturbSection, {**(levels or {})}, f"{card.id}, perturb", CardError
    )
    if card.drive is not None and section.false != 1:
        raise CardError(
            f"{card.id}: perturb has false {section.false:g}, expected 1: false "
            "detections of a whole recording are drawn, which a closed loop has not"
        )
    is_changed = section.model_copy(update={"seed": 0}) != PerturbSection()
    return card.model_copy(update={"perturb": section if is_changed else None})


def as_recorded(card: Card) -> Card:
    """Return the card with the detections and confidences that weigh its targets."""
    return card.model_copy(update={"presence": None, "perturb": None})


def instead_of_stored(card: Card) -> str:
    """Return what to do without the card's stored detections, as the end of an error.

    Empty if no profile can stand in for them.
    """
    profile = profile_for(card.detector_name.split("-", maxsplit=1)[0])
    try:
        with_detector(card, profile)
    except MtpBenchError:
        # there is no such profile, its truth is not complete, or it lacks the classes
        return ""
    return (
        f"; without them a simulated detector runs at once: --detector {profile} "
        f"(detector={profile!r} in Python)"
    )


def _with_own_scenes(card: Card, **scenes: object) -> Card:
    """Return the card with a section ``files`` that keeps the traits of its source."""
    traits = card.source.traits
    section = FilesSource(
        name="files",
        detector=plain_name(card.detector_name),
        velocity=card.velocity,
        ego_motion=traits.common_frame,
        ego=traits.has_ego,
        view=traits.view,
        # the digest leaves out None
        velocity_ahead=traits.velocity_ahead or None,
        places_only=traits.places_only or None,
        bounded_by_truth=traits.bounded_by_truth or None,
    )
    source = section.model_copy(update=scenes)
    return card.model_copy(update={"source": source, "drive": None})


def _detector_section(path: Path) -> dict[str, object]:
    """Return the keys of the section [detector] of a file, as ``fit-noise`` writes it.

    Empty for a profile without the section.
    """
    content = read_toml(path, CardError).get("detector")
    if not isinstance(content, dict):
        return {}
    section = validate(DetectorSection, content, f"{path.name}, [detector]", CardError)
    return {name: getattr(section, name) for name in section.model_fields_set}


_CHANGES: dict[str, Callable[[Card, Any], Card]] = {
    "files": with_files,
    "split": with_split,
    "detector": with_detector,
    "detections": with_detections,
    "presence": with_presence,
    "perturb": with_perturb,
}
