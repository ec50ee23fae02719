"""Event weights: how often the reference tracker errs at a target, frozen per env (protocol, "Event weights").

A scene is named by the first 16 hex digits of sha256("env/scene"): weights of a dataset can be published without its
content.
"""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cards import Card
from ..errors import DataError, UnknownNameError
from ..files import whole_file
from ..strict import read_json
from ..types import Bools, Rollout, Scene
from .definitions import DEFINITIONS
from .lineage import hypotheses, lineage_events, match_hypotheses
from .neutral import evaluated
from .subsets import SUBSETS

WEIGHED = SUBSETS[1:]  # "all" weighs every target alike
EVENTS = ("ids", "lost", "reacquired")  # frag is lost or reacquired
_COUNTED = (*EVENTS, "frag")
_DIGITS = 16
MOST_BYTES = 64 << 20  # of a file
_MOST_RUNS = 255  # counts are bytes
_TEXTS = ("env", "card", "definitions", "agent")
_NUMBERS = ("targets", "false_forecasts", "forecasts")


@dataclass(frozen=True, eq=False)
class SceneWeights:
    """Events of the reference tracker on the ``n`` targets of a scene, in the order of `find_targets`."""

    counts: NDArray[np.uint8]  # [n, 4] runs with ids, lost, reacquired, frag
    stp: Bools  # [n, 3] ids, lost, reacquired of the one run without cut or noise: the paper's condition
    stp_events: tuple[int, int, int]  # of that run, on all evaluated true boxes
    false_forecasts: int  # of that run
    forecasts: int  # of that run

    @property
    def targets(self) -> int:
        """Their number n."""
        return len(self.counts)


@dataclass(frozen=True, eq=False)
class Reference:
    """Event weights of an env, what they were made of, and how many false forecasts the reference makes."""

    env: str
    card: str  # digest
    definitions: str
    agent: str  # the baseline that was run
    runs: int
    parameters: dict[str, Any]  # how the runs differ, as in the file
    scenes: dict[str, SceneWeights]  # by `scene_key`
    frozen: bool = field(default=False, kw_only=True)  # read from the file of a shipped env; no part of the content

    @cached_property
    def digest(self) -> str:
        """The sha256 of the content."""
        sha = hashlib.sha256(json.dumps(_header(self), sort_keys=True, separators=(",", ":")).encode())
        for key, scene in sorted(self.scenes.items()):
            numbers = [scene.targets, *scene.stp_events, scene.false_forecasts, scene.forecasts]
            sha.update(f"\n{key} {' '.join(map(str, numbers))}\n".encode())
            sha.update(scene.counts.tobytes() + scene.stp.tobytes())
        return sha.hexdigest()

    @property
    def totals(self) -> dict[str, Any]:
        """What a reader of the file wants to know first."""
        scenes = list(self.scenes.values())
        events = np.array([scene.stp_events for scene in scenes], dtype=np.int64).reshape(-1, len(EVENTS)).sum(axis=0)
        counts = sum((scene.counts.sum(axis=0, dtype=np.int64) for scene in scenes), np.zeros(len(_COUNTED), np.int64))
        weights = np.round(counts / self.runs, 2).tolist()
        return {
            **{name: sum(getattr(scene, name) for scene in scenes) for name in _NUMBERS},
            "events_of_stp": dict(zip(EVENTS, events.tolist(), strict=True)),
            "sum_of_weights": dict(zip(_COUNTED, weights, strict=True)),
        }

    @property
    def origin(self) -> str:
        """One sentence for a report."""
        text = f"event weights of {self.runs} runs of {self.agent!r}"
        if self.frozen:
            return f"frozen {text} (hash {self.digest[:12]})"
        return f"{text} on these scenes (hash {self.digest[:12]}), not the frozen ones of a ranking"

    def holds(self, scenes: Iterable[str]) -> bool:
        """Whether all scenes of these names are known."""
        return all(scene_key(self.env, name) in self.scenes for name in scenes)

    def of(self, scene: str) -> SceneWeights:
        """What is known of the scene of this name; raises DataError where it is none of this reference."""
        key = scene_key(self.env, scene)
        if key not in self.scenes:
            raise DataError(f"no event weights of scene {scene!r} of {self.env} (key {key}): make them from this scene")
        return self.scenes[key]

    def weight(self, scene: str, subset: str) -> NDArray[np.float64]:
        """Weights [n] from 0 to 1 of the targets of a scene, one of WEIGHED; those of the paper are 0 or 1.

        Raises UnknownNameError for another subset and DataError for a scene that is none of this reference.
        """
        if subset not in WEIGHED:
            raise UnknownNameError("weighted subset", subset, WEIGHED)
        known = self.of(scene)
        if subset == "paper_ids":
            return known.stp[:, 0].astype(np.float64)
        if subset == "paper_frag":
            return (known.stp[:, 1] | known.stp[:, 2]).astype(np.float64)
        return known.counts[:, _COUNTED.index(subset)] / self.runs

    def false_forecasts(self, scenes: Iterable[str]) -> int:
        """False forecasts of the reference in the scenes of these names; raises DataError as `of`."""
        return sum(self.of(name).false_forecasts for name in scenes)


def scene_key(env: str, scene: str) -> str:
    """What stands for the name of a scene."""
    return hashlib.sha256(f"{env}/{scene}".encode()).hexdigest()[:_DIGITS]


def tracking_events(scene: Scene, rollout: Rollout, card: Card) -> Bools:
    """Events [R, 3] of EVENTS of the best hypothesis of a rollout, per true box."""
    scene = evaluated(scene)
    lineage = hypotheses(rollout, card)
    matched = match_hypotheses(scene.truth, rollout, lineage.member, card)
    best = lineage.best[scene.truth.frame_of_rows]
    events = lineage_events(scene.truth, rollout, lineage, matched).of(best)
    return np.concatenate([getattr(events, kind) for kind in EVENTS], axis=1)


def count_runs(events: Iterable[Bools], targets: int) -> NDArray[np.uint8]:
    """Runs [targets, 4] with each kind of event, and with frag; ``events``: of each run [targets, 3]."""
    counts = np.zeros((targets, len(_COUNTED)), dtype=np.uint8)
    for run in events:
        counts += np.concatenate([run, run[:, 1:2] | run[:, 2:]], axis=1)
    return counts


def write_reference(path: str | Path, reference: Reference, secret: bool = False) -> None:
    """Write a reference as JSON with its hash, one line per scene; the file appears complete or not at all.

    ``secret``: nobody else can read it, not even while it is written.
    """
    head = {**_header(reference), "totals": reference.totals, "hash": reference.digest}
    lines = [f"  {json.dumps(key)}: {json.dumps(_packed(scene))}" for key, scene in sorted(reference.scenes.items())]
    text = json.dumps(head, indent=1)[: -len("\n}")] + ',\n "scenes": {\n' + ",\n".join(lines) + "\n }\n}\n"
    with whole_file(Path(path)) as part:
        part.touch(mode=0o600)
        part.write_text(text, encoding="utf-8")
        if not secret:
            part.chmod(0o644)  # whatever the user's own files are


def read_reference(path: str | Path) -> Reference:
    """Read what `write_reference` wrote.

    Raises DataError, naming file and key, where the file is missing or broken or does not fit its hash.
    """
    path = Path(path)
    content = read_json(path, DataError, most=MOST_BYTES)
    where = _Where(path)
    for key, kind in (*((name, str) for name in _TEXTS), ("runs", int), ("parameters", dict), ("scenes", dict)):
        where.has(content, key, kind)
    if not 0 < content["runs"] <= _MOST_RUNS:
        raise DataError(f"{path}: runs is {content['runs']}, expected 1 to {_MOST_RUNS}")
    scenes = {key: _unpacked(value, where.inside("scenes", key)) for key, value in content["scenes"].items()}
    known = {name: content[name] for name in (*_TEXTS, "runs", "parameters")}
    reference = Reference(**known, scenes=scenes)
    for name, value in (("hash", reference.digest), ("totals", reference.totals)):
        if content.get(name) != value:
            raise DataError(f"{path}: {name} is {content.get(name)!r}, the content has {value!r}; freeze it again")
    if reference.definitions != DEFINITIONS:
        raise DataError(
            f"{path}: definitions is {reference.definitions!r}, expected {DEFINITIONS!r}: "
            f"mtp-bench freeze --env {reference.env}"
        )
    return reference


@dataclass(frozen=True)
class _Where:
    """A place in a file, for the text of an error."""

    path: Path
    key: str = ""

    def inside(self, *keys: str) -> _Where:
        return _Where(self.path, ".".join([*([self.key] if self.key else []), *keys]))

    def has(self, content: Any, key: str, kind: type) -> Any:
        """``content[key]``; raises DataError where it is not there or not of this kind."""
        value = content.get(key) if isinstance(content, dict) else None
        if not isinstance(value, kind) or isinstance(value, bool):
            got = "missing" if value is None else f"{type(value).__name__} {str(value)[:40]!r}"
            raise DataError(f"{self.path}: {self.inside(key).key} is {got}, expected {kind.__name__}: freeze it again")
        return value

    def count(self, content: Any, key: str) -> int:
        """A whole number that is not negative."""
        value = self.has(content, key, int)
        if value < 0:
            raise DataError(f"{self.path}: {self.inside(key).key} is {value}, expected 0 or more: freeze it again")
        return int(value)


def _header(reference: Reference) -> dict[str, Any]:
    names = (*_TEXTS, "runs", "parameters")
    return {name: getattr(reference, name) for name in names}


def _packed(scene: SceneWeights) -> dict[str, Any]:
    arrays = {name: base64.b64encode(zlib.compress(getattr(scene, name).tobytes(), 9)) for name in ("counts", "stp")}
    return {
        **{name: getattr(scene, name) for name in _NUMBERS},
        "stp_events": list(scene.stp_events),
        **{name: text.decode("ascii") for name, text in arrays.items()},
    }


def _unpacked(content: Any, where: _Where) -> SceneWeights:
    targets, false, forecasts = (where.count(content, name) for name in _NUMBERS)
    events = where.has(content, "stp_events", list)
    if len(events) != len(EVENTS) or not all(type(number) is int and number >= 0 for number in events):
        raise DataError(f"{where.path}: {where.key}.stp_events is {events}, expected 3 whole numbers: freeze it again")
    stp = _array(content, "stp", (targets, len(EVENTS)), where)
    counts = _array(content, "counts", (targets, len(_COUNTED)), where)
    return SceneWeights(counts, stp.astype(bool), (events[0], events[1], events[2]), false, forecasts)


def _array(content: Mapping[str, Any], key: str, shape: tuple[int, int], where: _Where) -> NDArray[np.uint8]:
    size = shape[0] * shape[1]
    try:
        packed = base64.b64decode(where.has(content, key, str), validate=True)
        content_of = zlib.decompressobj().decompress(packed, size + 1)  # never more than is needed
    except (ValueError, zlib.error) as error:
        raise DataError(f"{where.path}: {where.inside(key).key} cannot be read: {error}: freeze it again") from None
    if len(content_of) != size:
        raise DataError(
            f"{where.path}: {where.inside(key).key} has another size than {shape[0]} x {shape[1]}: freeze it again"
        )
    return np.frombuffer(content_of, dtype=np.uint8).reshape(shape)
