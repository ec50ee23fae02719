"""Event weights, rates of errors of the reference tracker at each target, and files.

They are frozen per env (envs/reference/README.md). Scenes are keyed by a hash of their
names, so that weights can be published without the content of a dataset. A file is JSON
with a readable head, and packed counts at the end. Counts of all scenes are packed
together: scenes of one env are alike, so this halves the size.
"""

import base64
import hashlib
import json
import lzma
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..cards import Card
from ..core import (
    Bools,
    DataError,
    Rollout,
    Scene,
    Section,
    counted,
    read_json,
    require_known,
    validate,
    whole_file,
)
from .bade import ONE_PER_TARGET, CardBudget
from .definitions import SUBSETS, WEIGHTS_DEFINITIONS
from .events import separated_truth
from .lineage import hypotheses, lineage_events, match_hypotheses
from .targets import evaluated

WEIGHTED_SUBSETS = SUBSETS[1:]  # "all" weighs every target alike
EVENT_KINDS = ("ids", "lost", "reacquired")  # frag is lost or reacquired
COUNTED_EVENTS = (*EVENT_KINDS, "frag")
HEADER = ("env", "card", "definitions", "agent", "runs", "parameters")
_KEY_DIGITS = 16
_TOTALS = ("targets", "false_forecasts", "forecasts")


@dataclass(frozen=True, eq=False)
class SceneWeights:
    """Events of the reference tracker on the ``n`` targets of a scene.

    In the order of `find_targets`.
    """

    counts: NDArray[np.uint8]  # [n, 4] runs with ids, lost, reacquired, frag
    # [n, 3] ids, lost, reacquired of the one run without cut or noise: the paper's
    # condition
    stp: Bools
    # EVENT_KINDS of that run, on all evaluated true boxes
    stp_events: tuple[int, int, int]
    false_forecasts: int  # false forecasts of that run in live frames
    forecasts: int  # all forecasts of that run in live frames
    # m that the ego of a closed loop drives with ground-truth tracks, in place of
    # events
    way: float | None = None

    @property
    def targets(self) -> int:
        """Number n of targets."""
        return len(self.counts)


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """Event weights of an env, their origin, and the constants that set budgets."""

    env: str
    card: str  # digest
    definitions: str
    agent: str  # the baseline that was run
    runs: int
    parameters: dict[str, Any]  # differences of the runs, as in the file
    scenes: dict[str, SceneWeights]  # by `scene_key`
    # the rest is not part of the content:
    # read from the file of a shipped env
    frozen: bool = field(default=False, kw_only=True)
    # None: of these scenes
    constants: CardBudget | None = field(default=None, kw_only=True)

    def __repr__(self) -> str:
        return (
            f"Reference of {self.env}: {self.agent}, {self.runs} runs of "
            f"{len(self.scenes)} scenes"
        )

    @cached_property
    def digest(self) -> str:
        """The sha256 of the content."""
        header = json.dumps(header_of(self), sort_keys=True, separators=(",", ":"))
        sha = hashlib.sha256(header.encode())
        for key, scene in sorted(self.scenes.items()):
            numbers: list[float] = [scene.targets, *scene.stp_events]
            numbers += [scene.false_forecasts, scene.forecasts]
            if scene.way is not None:
                numbers.append(scene.way)
            sha.update(f"\n{key} {' '.join(map(str, numbers))}\n".encode())
            sha.update(scene.counts.tobytes() + scene.stp.tobytes())
        return sha.hexdigest()

    @property
    def totals(self) -> dict[str, Any]:
        """Totals over the scenes, shown at the head of the file."""
        totals: dict[str, Any] = dict.fromkeys(_TOTALS, 0)
        events = np.zeros(len(EVENT_KINDS), dtype=np.int64)
        counts = np.zeros(len(COUNTED_EVENTS), dtype=np.int64)
        for scene in self.scenes.values():
            for name in _TOTALS:
                totals[name] += getattr(scene, name)
            events += np.array(scene.stp_events, dtype=np.int64)
            counts += scene.counts.sum(axis=0, dtype=np.int64)
        weights = np.round(counts / self.runs, 2).tolist()
        return {
            **totals,
            "events_of_stp": dict(zip(EVENT_KINDS, events.tolist(), strict=True)),
            "sum_of_weights": dict(zip(COUNTED_EVENTS, weights, strict=True)),
        }

    @property
    def of_drives(self) -> bool:
        """True if scenes have distances driven in place of events."""
        return any(scene.way is not None for scene in self.scenes.values())

    @property
    def budget(self) -> CardBudget:
        """Constants that set budgets: stated ones, else the counts of all scenes."""
        if self.constants is not None:
            return self.constants
        totals = self.totals
        if totals["targets"] == 0 or self.of_drives:
            return ONE_PER_TARGET
        return CardBudget(self.env, totals["false_forecasts"], totals["targets"])

    @property
    def origin(self) -> str:
        """Origin of the weights in one sentence, for a report."""
        kind = "distances driven in" if self.of_drives else "event weights of"
        text = f"{kind} {counted(self.runs, 'run')} of {self.agent!r}"
        digest = self.digest[:12]
        if self.frozen:
            return f"frozen {text} (hash {digest})"
        return (
            f"{text} on these scenes (hash {digest}), not the frozen ones of a ranking"
        )

    def holds(self, scenes: Iterable[str]) -> bool:
        """Return True if all scenes of these names have weights."""
        return all(scene_key(self.env, name) in self.scenes for name in scenes)

    def of(self, scene: str) -> SceneWeights:
        """Return the weights of the scene of this name.

        Raises DataError for a scene without weights.
        """
        key = scene_key(self.env, scene)
        if key not in self.scenes:
            raise DataError(
                f"no event weights of scene {scene!r} of {self.env} (key {key}): "
                "make them from this scene"
            )
        return self.scenes[key]

    def ways(self, scenes: Iterable[str]) -> dict[str, float]:
        """Return the way with ground-truth tracks in scenes of a closed loop, metres.

        Raises DataError as `of`.
        """
        return {name: self.of(name).way or 0.0 for name in scenes}

    def weight(self, scene: str, subset: str) -> NDArray[np.float64]:
        """Return the weights [n] from 0 to 1 of the targets of a scene.

        ``subset``: one of WEIGHTED_SUBSETS; weights of the paper's are 0 or 1. Raises
        UnknownNameError for another subset and DataError for a scene without weights.
        """
        require_known("weighted subset", subset, WEIGHTED_SUBSETS)
        return self.weight_in(self.of(scene), subset)

    def weight_in(self, scene: SceneWeights, subset: str) -> NDArray[np.float64]:
        """Return the weights [n] of `weight` from the stored weights of the scene."""
        # columns as in EVENT_KINDS
        if subset == "paper_ids":
            return scene.stp[:, 0].astype(np.float64)
        if subset == "paper_frag":
            return (scene.stp[:, 1] | scene.stp[:, 2]).astype(np.float64)
        return scene.counts[:, COUNTED_EVENTS.index(subset)] / self.runs


def scene_key(env: str, scene: str) -> str:
    """Return the key of a scene in a file of weights."""
    return hashlib.sha256(f"{env}/{scene}".encode()).hexdigest()[:_KEY_DIGITS]


def tracking_events(scene: Scene, rollout: Rollout, card: Card) -> Bools:
    """Return the events [R, 3] of the best hypothesis, per true box."""
    scene = evaluated(scene)
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(scene.truth, rollout, lineage.member, card)
    best = lineage.best[scene.truth.frame_of_rows]
    truth = separated_truth(scene, card)
    events = lineage_events(truth, rollout, lineage, matched, scene.annotated_frames)
    best_events = events.of(best)
    return np.concatenate([getattr(best_events, kind) for kind in EVENT_KINDS], axis=1)


def count_runs(events: Iterable[Bools], targets: int) -> NDArray[np.uint8]:
    """Count the runs [targets, 4] with each kind of event, and with "frag".

    ``events``: for each run, the kinds of event of each target [targets, 3].
    "frag": lost or reacquired.
    """
    counts = np.zeros((targets, len(COUNTED_EVENTS)), dtype=np.uint8)
    for run in events:
        counts += np.concatenate([run, run[:, 1:2] | run[:, 2:]], axis=1)
    return counts


def header_of(reference: Reference) -> dict[str, Any]:
    """Return the fields at the head of a reference's file, by HEADER."""
    return {name: getattr(reference, name) for name in HEADER}


MAX_BYTES = 64 << 20  # of a file
_MAX_TARGETS = 16 << 20  # of all scenes: a small packed text must not fill the memory
_ADVICE = "freeze it again"
_Count = Annotated[int, Field(ge=0)]


class _SceneEntry(Section):
    targets: _Count
    false_forecasts: _Count
    forecasts: _Count
    stp_events: Annotated[tuple[_Count, _Count, _Count], Field(strict=False)]
    way: Annotated[float, Field(ge=0)] | None = None


class _ReferenceFile(Section):
    env: str
    card: str
    definitions: str
    agent: str
    runs: Annotated[int, Field(ge=1, le=255)]  # counts are bytes
    parameters: dict[str, Any]
    totals: dict[str, Any]
    hash: str
    scenes: dict[str, _SceneEntry]
    counts: str
    stp: str


def write_reference(
    path: str | Path, reference: Reference, secret: bool = False
) -> None:
    """Write a reference as JSON with its hash, one line per scene.

    The file appears complete or not at all. ``secret``: readable by the user alone,
    also while it is written.
    """
    header = {
        **header_of(reference),
        "totals": reference.totals,
        "hash": reference.digest,
    }
    scenes = dict(sorted(reference.scenes.items()))
    entries = []
    for key, scene in scenes.items():
        entry = _SceneEntry(
            **{name: getattr(scene, name) for name in _SceneEntry.model_fields}
        )
        content = json.dumps(entry.model_dump(mode="json", exclude_none=True))
        entries.append(f"  {json.dumps(key)}: {content}")
    counts = _packed([scene.counts.tobytes() for scene in scenes.values()])
    stp = _packed([scene.stp.tobytes() for scene in scenes.values()])
    head = json.dumps(header, indent=1).removesuffix("\n}")
    lines = ",\n".join(entries)
    text = (
        f'{head},\n "scenes": {{\n{lines}\n }},\n "counts": "{counts}",\n'
        f' "stp": "{stp}"\n}}\n'
    )
    with whole_file(Path(path)) as part:
        part.touch(mode=0o600)
        part.write_text(text, encoding="utf-8")
        if not secret:
            part.chmod(0o644)  # independent of the user's umask


def read_reference(path: str | Path) -> Reference:
    """Read a file of `write_reference`.

    Raises DataError, naming file and key, if the file is missing or broken or does not
    fit its hash.
    """
    path = Path(path)
    content = read_json(path, DataError, most=MAX_BYTES)
    file = validate(_ReferenceFile, content, str(path), DataError)
    reference = Reference(
        **{name: getattr(file, name) for name in HEADER}, scenes=_scenes(file, path)
    )
    for name, value in (("hash", reference.digest), ("totals", reference.totals)):
        if getattr(file, name) != value:
            raise DataError(
                f"{path}: {name} is {getattr(file, name)!r}, the content has "
                f"{value!r}; {_ADVICE}"
            )
    if reference.definitions != WEIGHTS_DEFINITIONS:
        raise DataError(
            f"{path}: definitions is {reference.definitions!r}, expected "
            f"{WEIGHTS_DEFINITIONS!r}: mtp-bench maintain freeze --env {reference.env}"
        )
    return reference


def _scenes(file: _ReferenceFile, path: Path) -> dict[str, SceneWeights]:
    """Return the scenes of a file by key, in the order of their packed counts."""
    entries = dict(sorted(file.scenes.items()))
    targets = sum(entry.targets for entry in entries.values())
    if targets > _MAX_TARGETS:
        raise DataError(
            f"{path}: targets of all scenes are {targets}, "
            f"expected at most {_MAX_TARGETS}"
        )
    counts = _unpacked(file.counts, (targets, len(COUNTED_EVENTS)), f"{path}: counts")
    stp = _unpacked(file.stp, (targets, len(EVENT_KINDS)), f"{path}: stp").astype(bool)
    scenes = {}
    start = 0
    for key, entry in entries.items():
        rows = slice(start, start + entry.targets)
        scenes[key] = SceneWeights(
            counts[rows], stp[rows], **entry.model_dump(exclude={"targets"})
        )
        start += entry.targets
    return scenes


def _packed(contents: list[bytes]) -> str:
    content = b"".join(contents)
    packed = lzma.compress(content, preset=6 | lzma.PRESET_EXTREME)
    return base64.b64encode(packed).decode("ascii")


def _unpacked(text: str, shape: tuple[int, int], where: str) -> NDArray[np.uint8]:
    size = shape[0] * shape[1]
    try:
        reader = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MAX_BYTES)
        packed = base64.b64decode(text, validate=True)
        content = reader.decompress(packed, size + 1)  # never more than is needed
    except (ValueError, lzma.LZMAError, EOFError) as error:
        raise DataError(f"{where} cannot be read: {error}: {_ADVICE}") from None
    if len(content) != size:
        raise DataError(
            f"{where} has another size than {shape[0]} x {shape[1]}: {_ADVICE}"
        )
    return np.frombuffer(content, dtype=np.uint8).reshape(shape)
