"""Import of forecasts that another program stored, as a run that scores take."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from ..agent import Tracks, check_action, make_action
from ..cards import Card, path_digest, with_classes
from ..core import (
    DataError,
    Floats,
    Rollout,
    Scene,
    Task,
    clean_text,
    counted,
    long_work,
    other_spelling,
    require_known,
)
from ..env import MTPEnv, assemble, record_action
from ..scoring import DEFINITIONS
from ..sources import (
    StoredForecasts,
    class_ids,
    forecast_forms,
    open_source,
    package_of,
)
from .forecast_signs import ForecastSigns
from .options import DEFAULTS, RunKeywords, RunOptions, resolve_options
from .playing import library_versions
from .rollout_files import RunInfo, save_run
from .settings import require_list
from .stored import OWN_DETECTIONS, heaviest, heaviest_samples, require_free

_MOST_LETTERS = 200  # of the names of classes that are left out


def import_forecasts(
    file: str | Path,
    env_id: str | Card,
    form: str,
    folder: str | Path | None,
    options: RunOptions = DEFAULTS,
    *,
    rate: float | None = None,
    constant_confidence: bool = False,
    own_detections: bool = False,
    classes: Sequence[str] | None = None,
    force: bool = False,
    **keywords: Unpack[RunKeywords],
) -> list[str]:
    """Store the forecasts in a file as a run in ``folder``; None: only check them.

    ``form``: one of `forecast_forms` of the env's source. ``rate``: Hz, of the steps in
    the file, if it is not that of the form. ``constant_confidence``: take a file in
    which all objects are equally sure. ``own_detections``: the objects of the file
    stand in for the env's detections, so that the detector's part of the error is that
    of the file. ``classes``: only targets of these classes of the env are scored.
    ``force``: replace an earlier run. ``keywords`` as in `evaluate`. Such a run is never
    ranked. Returns lines that say what was read and how it was understood. Raises DataError, with nothing written, for
    a file that is wrong, of another form, frame of reference, rate or horizon, and
    MtpBenchError for a ``folder`` that holds something else.
    """
    path = Path(file).expanduser().absolute()
    if folder is not None:
        require_free(Path(folder), force)
    env_id, options = resolve_options(env_id, options, keywords)
    card = options.card(env_id)
    card.require_same_scenes("which has no stored forecasts", "let an agent drive")
    if classes is not None:
        require_list(classes)
        card = with_classes(card, classes)
    forms = forecast_forms(package_of(card))
    require_known(f"form of forecasts on {card.source.name}", form, forms)
    with long_work(f"importing {path.name}", progress=options.progress) as progress:
        env = MTPEnv(card, options.data, evaluation=True)
        names = options.chosen(env.scene_names)
        source = open_source(card, options.data)
        read = forms[form].open(card, options.data, path)
        rate_hz = rate or forms[form].rate or card.task.rate
        reader = _Import(card, env.task, path, rate_hz)
        progress.started(len(names))
        rollouts = []
        for name in names:
            scene = source.load(name)
            rollouts.append(reader.rollout(scene, read(scene)))
            progress.done(name)
        reader.require_plausible(rollouts, constant_confidence)
        samples = min(max(reader.samples, 1), env.task.samples)
        # without the room for samples that no object has
        rollouts = [heaviest_samples(rollout, samples) for rollout in rollouts]
        confidence = np.concatenate([each.object_confidence for each in rollouts])
        parameters = {
            "form": form,
            "sha256": path_digest(path),
            "modes": reader.samples,
            "seconds": reader.steps / rate_hz,
            "least_confidence": round(float(confidence.min()), 6),
            OWN_DETECTIONS: own_detections,
        }
        if folder is not None:
            info = RunInfo(
                env_id=card.id,
                card_digest=card.digest,
                observe="file",
                samples=samples,
                split=card.source.split,
                keywords=options.changes,
                # no name of a baseline
                agent=f"{path.name.partition('.')[0].replace(' ', '_')}.{form}",
                parameters=parameters,
                submission_digest="",
                seed=0,
                definitions=DEFINITIONS,
                versions=library_versions(),
                card=card.stored(),
            )
            save_run(folder, info, rollouts)
    return list(reader.lines(rollouts, parameters))


class _Import:
    """Forecasts of scenes, made into rollouts, and what is counted on the way."""

    def __init__(self, card: Card, task: Task, path: Path, rate: float) -> None:
        self._card = card
        self._task = task
        self._path = path
        self._rate = rate
        self._stride = 1
        if math.isfinite(rate):
            self._stride = max(1, round(rate / card.task.rate))
        if not math.isclose(self._stride * card.task.rate, rate, rel_tol=1e-3):
            raise DataError(
                f"{path}: its steps are at {rate:g} Hz, those of {card.id} at "
                f"{card.task.rate:g} Hz: expected a multiple; --rate states another one"
            )
        self._rows = Counter[str]()  # rows of the file by what happened to them
        self._classes = Counter[str]()  # objects by class, also of no class of the task
        self._signs = ForecastSigns(card.task.rate)
        self.samples = 0  # most of an object
        self.steps = 0
        self._others = 0

    def rollout(self, scene: Scene, stored: StoredForecasts) -> Rollout:
        """Return the actions of a scene, with room for all samples of the task."""
        task = self._task
        self._others = stored.others
        self._rows.update(stored.notes)
        self.samples = max(self.samples, stored.path.shape[1])
        self.steps = max(self.steps, stored.path.shape[2])
        self._classes.update(stored.class_name.tolist())
        for name in np.unique(stored.class_name).tolist():
            if meant := other_spelling(name, task.classes):
                raise DataError(
                    f"{self._path}: class {name!r} in scene {scene.name}, "
                    f"expected {meant!r} as in the task"
                )
        stored = stored.select(np.isin(stored.class_name, task.classes))
        class_id = class_ids(stored.class_name.tolist(), task.classes)
        offset, log_weight = self._forecasts(stored)
        # an id in two classes is two tracks, as in files of tracks
        names = np.char.add(np.char.add(stored.identity, "/"), stored.class_name)
        _, track_id = np.unique(names, return_inverse=True)
        track_id[stored.identity == ""] = -1
        self._signs.add(stored, offset, log_weight, track_id, scene.detections)
        actions = []
        for t in range(scene.frames):
            rows = np.flatnonzero(stored.frame == t)
            surplus = max(0, len(rows) - task.objects)
            self._rows["objects beyond those that fit in a frame"] += surplus
            order = np.argsort(-stored.confidence[rows], kind="stable")
            rows = rows[np.sort(order[: task.objects])]
            tracked = rows[track_id[rows] >= 0]
            # too large becomes inf, which fails a check
            with np.errstate(over="ignore"):
                action = make_action(
                    task,
                    stored.box[rows],
                    class_id[rows],
                    offset[rows],
                    log_weight[rows],
                    confidence=stored.confidence[rows],
                    tracks=Tracks.of_one_hypothesis(
                        track_id[tracked], stored.box[tracked], class_id[tracked]
                    ),
                    checked=False,
                )
            recorded = record_action(check_action(action, task), task)
            self._rows["rejected rows"] += int(recorded.invalid.sum())
            actions.append(recorded)
        return assemble(scene.name, actions, np.zeros(scene.frames, dtype=np.int64))

    def _forecasts(self, stored: StoredForecasts) -> tuple[Floats, Floats]:
        """Return offsets [R, k, T, 2] m from the box, and their log-weights [R, k].

        They are at the steps of the task, of the heaviest samples, in their order.
        """
        future = self._task.future
        path = stored.path[:, :, self._stride - 1 :: self._stride][:, :, :future]
        log_weight = stored.log_weight
        is_standing = np.isneginf(log_weight).all(axis=1)
        is_standing &= np.isnan(path).all(axis=(1, 2, 3))
        self._rows["objects without a forecast, taken to stand"] += is_standing.sum()
        objects = len(stored.frame)
        if is_standing.sum() == objects:
            return np.zeros((objects, 1, future, 2)), np.zeros((objects, 1))
        if path.shape[2] < future:
            seconds = stored.path.shape[2] / self._rate
            raise DataError(
                f"{self._path}: its forecasts end after {seconds:g} s, "
                f"{self._card.id} scores {future * self._task.dt:g} s; "
                "MTP-nuScenes-3s-v0 and MTP-AV2-3s-v0 score 3 s"
            )
        kept = heaviest(log_weight, self._task.samples)
        log_weight = np.take_along_axis(log_weight, kept, axis=1)
        path = np.take_along_axis(path, kept[..., None, None], axis=1)
        offset = path - stored.box[:, None, None, :2]
        offset[is_standing, 0] = 0
        log_weight[is_standing, 0] = 0
        return offset, log_weight

    def require_plausible(
        self, rollouts: Sequence[Rollout], constant_confidence: bool
    ) -> None:
        """Raise DataError for a file that is read in a wrong way, or has no order."""
        for problem in self._signs.problems():
            raise DataError(f"{self._path}: {problem}")
        confidence = np.concatenate([each.object_confidence for each in rollouts])
        if not len(confidence) or not self.steps:
            raise DataError(
                f"{self._path}: no object of {', '.join(self._task.classes)} with a "
                "box, a confidence from 0 to 1 and a forecast of places within 327 m, "
                "expected some; is it another --form?"
            )
        if np.ptp(confidence) == 0 and len(confidence) > 1 and not constant_confidence:
            raise DataError(
                f"{self._path}: each object has the confidence {confidence[0]:g}, so "
                "that none can be left out first and bADE is far higher; write the "
                "scores of the detector, or pass --constant-confidence"
            )

    def lines(
        self, rollouts: Sequence[Rollout], parameters: dict[str, Any]
    ) -> Iterator[str]:
        """Yield what the file has, what is kept of it, and what was counted."""
        task = self._task
        yield (
            f"{self._path.name}, form {parameters['form']}: {self.steps} steps at "
            f"{self._rate:g} Hz ({parameters['seconds']:g} s), "
            f"{counted(self.samples, 'sample')} an object; {task.env_id} takes "
            f"{task.future} steps at {self._card.task.rate:g} Hz and {task.samples} "
            "samples"
        )
        if self.samples > task.samples:
            yield f"the {task.samples} heaviest samples of each object are kept"
        if self.samples < task.samples:
            yield (
                "fewer samples have larger errors: `mtp-bench score RUNS --samples "
                f"{self.samples}` cuts all runs alike"
            )
        yield (
            f"{counted(sum(len(each.object_class) for each in rollouts), 'object')} in "
            f"{counted(sum(each.frames for each in rollouts), 'frame')} of "
            f"{counted(len(rollouts), 'scene')}, the least confidence is "
            f"{parameters['least_confidence']:.3g}"
        )
        if not any(len(each.track_id) for each in rollouts):
            yield "no tracks: identity switches, MOTA and HOTA are not measured"
        yield from self._left_out()
        missing = [name for name in task.classes if name not in self._classes]
        if missing:
            yield (
                f"no object is a {' or a '.join(missing)}: such targets count as "
                "missed; --classes scores the classes that it has"
            )
        self._rows["samples or logs of other scenes"] = self._others
        yield from (
            f"{text}: {number}" for text, number in self._rows.items() if number
        )
        if parameters[OWN_DETECTIONS]:
            yield "the objects of the file stand in for the detections"
        else:
            yield (
                "the detector's part of the error is that of "
                f"{self._card.detector_name}; --own-detections takes the objects of "
                "the file as detections"
            )

    def _left_out(self) -> Iterator[str]:
        """Yield the objects of classes that the task has not, if there are any."""
        others = self._classes.keys() - set(self._task.classes)
        if others:
            count = counted(sum(self._classes[name] for name in others), "object")
            names = ", ".join(name or "without a name" for name in sorted(others)[::-1])
            yield (
                f"{count} of {counted(len(others), 'other class', 'es')}, left out: "
                f"{clean_text(names, _MOST_LETTERS)}"
            )
