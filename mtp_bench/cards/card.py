"""Environment cards: strict TOML, read into a frozen record with a digest.

A card says which source an env replays, what the task is and how large the padded arrays are; see ``envs/README.md``.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializeAsAny

from .._bundle import bundled, card_ids
from ..detector.profile import toml_table, toml_values
from ..errors import CardError, MtpBenchError, UnknownNameError, nearest
from ..strict import Section, read_toml, validate
from ..types import Scene
from . import changes, own
from .sections import DetectorSection, FilesSource
from .source import SourceSection, read_source

MOST_METRES = 1e4  # of a gate or an error
PerClass = dict[str, float]  # a single number in the TOML stands for every class


class EventGate(Section):
    """When a true box and a track count as matched for identity events (protocol, "Matching")."""

    measure: Literal["iou_3d", "center_distance"]
    threshold: PerClass  # inclusive: IoU at least, or metres at most


class TaskSection(Section):
    """The rules of prediction and scoring (protocol, table of tasks)."""

    rate: Annotated[float, Field(gt=0, le=1000)]  # Hz, nominal
    past: Annotated[int, Field(ge=2, le=1000)]  # P
    future: Annotated[int, Field(ge=1, le=1000)]  # T
    samples: Annotated[int, Field(ge=1, le=1000)]  # k
    classes: Annotated[tuple[str, ...], Field(min_length=1, strict=False)]  # TOML has lists only
    event_gate: EventGate
    forecast_gate: PerClass  # m, BEV centre distance
    miss_error: PerClass  # m, c: what a target without a forecast costs


class SizeSection(Section):
    """Padded sizes of the spaces; constants of the env id."""

    detections: Annotated[int, Field(ge=1)]  # D
    tracks: Annotated[int, Field(ge=1)]  # N
    objects: Annotated[int, Field(ge=1)]  # O
    hypotheses: Annotated[int, Field(ge=1)]  # H


class Card(Section):
    """One environment id."""

    id: str
    summary: str
    reference: str = "stp"  # baseline whose runs make the event weights
    motion_noise: str | None = None  # where objects move like here, a hint for agents; no part of the digest
    source: SerializeAsAny[SourceSection]
    detector: DetectorSection | None = None
    task: TaskSection
    size: SizeSection

    @property
    def digest(self) -> str:
        """First 16 hex digits of the sha256 of the card's content, the noise of a simulated detector included."""
        # What agents choose their parameters by is no part of what is scored.
        content = self.model_dump(mode="json", exclude_none=True, exclude={"motion_noise"})
        if self.detector is not None:
            noise = self.detector.resolved
            content["detector"]["noise"] = noise.model_dump(mode="json", exclude_none=True)
            content["detector"]["model"] = noise.model
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def detector_name(self) -> str:
        """What agents choose their parameters by: the stored detector, or the profile of the simulated one."""
        if self.detector is not None:
            return self.detector.name
        return self.source.traits.stored_detector

    @property
    def simulated(self) -> bool:
        """Whether there is a scene for any seed, so that hidden ones can rank; else scenes were recorded."""
        return self.source.traits.simulated

    @property
    def ego_motion(self) -> bool:
        """False: every frame is given in its own sensor frame."""
        return self.source.traits.common_frame

    @property
    def has_ego(self) -> bool:
        """Whether a vehicle carries the sensors; else the ego pose is a fixed place, and distances to it say little."""
        return self.source.traits.has_ego

    @property
    def velocity(self) -> bool:
        """Whether detections carry a measured velocity."""
        if self.detector is None:
            return self.source.traits.measured_velocity
        noise = self.detector.resolved
        return all(noise.noise(name).velocity is not None for name in self.task.classes)

    def with_split(self, split: str) -> Card:
        """The same card on another split of its source; raises UnknownNameError for one that it has not."""
        return self.model_copy(update={"source": changes.with_split(self, split)})

    def with_detector(self, name: str) -> Card:
        """The card with another simulated detector, of the same reach; on nuScenes also with other stored detections.

        ``name``: a shipped profile, the path of a profile (.toml), or "iid" or "hard" for that variant of the card's
        own profile; on nuScenes any other name stands for ``detections/<name>*.json``. Raises UnknownNameError or
        CardError.
        """
        source, detector = changes.with_detector(self, name)
        card = self.model_copy(update={"source": source, "detector": detector})
        check_detector(card, self.id)
        return card

    def with_detections(self, file: str | Path) -> Card:
        """The card with stored detections of one's own.

        On nuScenes ``file`` is a file in the official submission form, on KITTI a folder of text files, one per
        sequence. It stands in for the card's detector, by whose name agents choose their settings: "megvii" becomes
        "megvii-<file>". The digest holds the content of the file, not its place. Raises CardError where the card's
        source has no such files, and DataError where the file cannot be read.
        """
        return self.model_copy(update={"source": changes.with_detections(self, file)})

    def with_files(self, folder: str | Path) -> Card:
        """The card with the scenes of a folder of one's own (``docs/data/own.md``), and with their detections.

        Task, sizes and the name by which agents choose their settings stay; a simulated detector goes. The digest holds
        the content of the files, not their place. Raises DataError where the folder is not there.
        """
        return self.model_copy(update={"source": own.with_files(self, folder), "detector": None})

    def with_scenes(self, scenes: Sequence[Scene]) -> Card:
        """The same with `Scene` objects, whose ``class_id`` are places in ``task.classes``.

        Raises CardError for what is no scene, and for two scenes of one name.
        """
        return self.model_copy(update={"source": own.with_scenes(self, scenes), "detector": None})

    def stored(self) -> dict[str, Any]:
        """The card as JSON that `parse_card` reads again, with the places of its files on this machine."""
        content = self.model_dump(mode="json")  # with what is null: a detector that was taken away stays away
        places = {name: getattr(self.source, name, None) for name in ("folder", "detections_file")}
        content["source"] |= {name: place for name, place in places.items() if place is not None}
        return content

    def per_class(self, table: PerClass) -> tuple[float, ...]:
        """Values of a per-class table in the order of ``task.classes``."""
        return tuple(table[name] for name in self.task.classes)


def load_card(name: str | Path) -> Card:
    """Read a card by env id or from a TOML file.

    Raises UnknownNameError for an id that does not exist and CardError for content that is wrong, naming the key.
    """
    if not isinstance(name, (str, os.PathLike)):
        raise CardError(f"the env is {name!r}, expected its id, the path of a card, or a card")
    path = Path(name)
    if path.suffix == ".toml":
        if not path.is_file():
            raise CardError(f"no card file at {path}")
    else:
        if str(name) not in card_ids():
            raise UnknownNameError("environment", str(name), card_ids(), "`mtp-bench envs` lists them")
        path = bundled("envs") / f"{name}.toml"
    content = read_toml(path, CardError)
    card = parse_card(content, where=path.name, stem=path.stem)
    if isinstance(card.source, FilesSource):
        return card.model_copy(update={"source": own.located(card.source, path.parent)})
    return card


def parse_card(content: dict[str, Any], where: str = "card", stem: str | None = None) -> Card:
    """Validate the content of a card; ``stem`` is the id that its file name promises."""
    content = {**content, "source": read_source(content.get("source"), where)}
    card = validate(Card, _spread_scalars(content), where, CardError)
    if stem is not None and card.id != stem:
        raise CardError(f"{where}: id is {card.id!r}, expected the file's stem {stem!r}")
    check_card(card, where)
    return card


def card_text(card: Card) -> str:
    """TOML of a card that `load_card` reads again; of own scenes without what they hold, which is found anew."""
    content = card.model_dump(exclude_none=True, exclude={"source": {"sha256"}})
    tables = {name: content.pop(name) for name in ("source", "detector", "task", "size") if name in content}
    if isinstance(card.source, FilesSource) and card.source.folder is not None:
        tables["source"]["folder"] = card.source.folder
    lines = toml_values(content)
    for name, table in tables.items():
        lines += toml_table(name, table)
    return "\n".join(lines) + "\n"


def changed_card(
    card: Card,
    split: str | None = None,
    detector: str | None = None,
    detection_file: str | None = None,
    files: str | None = None,
) -> Card:
    """``card`` on another split, with another detector, or with detections or scenes of one's own, where one is named.

    Scenes come first: split and detector are of them.
    """
    if files is not None:
        card = card.with_files(files)
    if split is not None:
        card = card.with_split(split)
    if detector is not None:
        card = card.with_detector(detector)
    return card if detection_file is None else card.with_detections(detection_file)


def _spread_scalars(content: dict[str, Any]) -> dict[str, Any]:
    """Write a single number in place of a per-class table as a table with every class."""
    task = content.get("task")
    if not isinstance(task, dict):
        return content
    task = dict(task)
    classes = task.get("classes")
    names = [c for c in classes if isinstance(c, str)] if isinstance(classes, list) else []

    def spread(value: Any) -> Any:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return dict.fromkeys(names, value) if number else value

    for key in ("forecast_gate", "miss_error"):
        if key in task:
            task[key] = spread(task[key])
    if isinstance(task.get("event_gate"), dict) and "threshold" in task["event_gate"]:
        task["event_gate"] = {**task["event_gate"], "threshold": spread(task["event_gate"]["threshold"])}
    return {**content, "task": task}


def check_card(card: Card, where: str) -> None:
    """Raise CardError, naming the card by ``where``, unless its sections fit each other."""
    _check_classes(card, where)
    check_detector(card, where)
    _check_length(card, where)
    _check_detections(card, where)


def _check_classes(card: Card, where: str) -> None:
    classes = set(card.task.classes)
    if len(classes) != len(card.task.classes):
        raise CardError(f"{where}: task.classes is {list(card.task.classes)}, expected each class once")
    tables = {
        "task.event_gate.threshold": card.task.event_gate.threshold,
        "task.forecast_gate": card.task.forecast_gate,
        "task.miss_error": card.task.miss_error,
    }
    iou = card.task.event_gate.measure == "iou_3d"
    for key, table in tables.items():
        most = 1.0 if iou and key == "task.event_gate.threshold" else MOST_METRES  # an IoU beyond 1 nothing reaches
        for name in table:
            if name not in classes:
                raise CardError(f"{where}: {key} has an unknown class {name!r}{nearest(name, classes)}")
        for name in card.task.classes:
            if name not in table:
                raise CardError(f"{where}: {key} has no value for class {name!r}")
            if not 0 < table[name] <= most:
                raise CardError(f"{where}: {key}.{name} is {table[name]}, expected a number above 0, at most {most:g}")


def check_detector(card: Card, where: str) -> None:
    """A simulated source needs a simulated detector, which must know every class."""
    if not card.source.traits.truth_complete and card.detector is not None:
        raise CardError(
            f"{where}: a simulated detector would see nothing but the prediction targets, the only known objects; "
            'take stored detections, or a card with truth = "all"'
        )
    if card.detector is None:
        if what := card.source.traits.without_detections:
            raise CardError(f"{where}: {what} has no detections: a [detector] section is missing")
        return
    try:
        noise = card.detector.resolved
        for name in card.task.classes:
            noise.noise(name)
    except MtpBenchError as error:
        raise CardError(f"{where}: {error}") from None


def _check_detections(card: Card, where: str) -> None:
    """A place is no part of the digest, so the content must be: else other detections would have the same digest."""
    place, content = (getattr(card.source, f"detections_{name}", None) for name in ("file", "sha256"))
    if place is not None and content is None:
        raise CardError(
            f"{where}: source.detections_file needs source.detections_sha256, what the file holds; or leave it out and "
            "name the file with --detections"
        )


def _check_length(card: Card, where: str) -> None:
    """Scenes whose length the card decides must be long enough for a target."""
    seconds = card.source.traits.scene_seconds
    if seconds is None:
        return
    frames, needed = seconds * card.task.rate, card.task.past + card.task.future
    if frames < needed:
        raise CardError(
            f"{where}: scenes of {seconds:g} s at {card.task.rate:g} Hz have {frames:g} frames, expected "
            f"at least {needed}: task.past and task.future"
        )
