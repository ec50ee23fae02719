"""Predictors trained on an environment: from its training split to a file of weights with its model card."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import MtpBenchError, UnknownNameError
from ..files import WriteError, make_folder
from ..networks import VARIABLE as WEIGHTS_VARIABLE
from ..networks import file_name, weights_folder
from ..prediction.learned.local import local_future
from ..prediction.learned.network import Network, Sizes
from ..prediction.learned.registry import network_of
from ..prediction.learned.weights import Stored, write_weights
from ..running.options import DEFAULTS, Fold, RunOptions, held_out
from ..types import Bools, Task
from .fitting import Lesson, Plan, State, Told, device_of, fit
from .recipes import recipe_of
from .split import open_split
from .tracklets import TRUTH, Windows, together, windows

ON = ("truth", "tracklets")
HYPOTHESES = 20  # of the tracker whose tracklets are learnt from
FEW_SCENES = 5  # from so many on, validation takes whole scenes


@dataclass(frozen=True)
class Request:
    """What is to be trained."""

    network: str
    env_id: str
    on: str = "truth"
    hypotheses: int = HYPOTHESES
    fold: Fold | None = None  # whose scenes are left out altogether, see `open_split`
    also: tuple[str, ...] = ()  # further envs to learn from, with the same rate and sizes
    plan: Plan | None = None  # None: what suits the network
    device: str = "auto"

    def __post_init__(self) -> None:
        network_of(self.network)
        if self.on not in ON:
            raise UnknownNameError("value of --on", self.on, ON)
        stages, epochs = len(recipe_of(self.network).stages), self.chosen_plan.epochs
        if epochs < stages:
            raise MtpBenchError(f"epochs is {epochs}, expected at least {stages}: {self.network} has {stages} stages")

    @property
    def chosen_plan(self) -> Plan:
        """The plan, or the one of the network's recipe."""
        return self.plan or recipe_of(self.network).plan


def learnable(request: Request, options: RunOptions = DEFAULTS) -> Windows:
    """The windows that a request learns from: those that are `taught`.

    For a network that sees whole frames, also those that the others see. Raises MtpBenchError for an env that is named
    twice, for further envs beside files of one's own, and for envs that are not alike.
    """
    if request.also and options.files is not None:
        raise MtpBenchError(f"--also {request.also[0]} cannot go with --files: its scenes would be learnt once per env")
    _require_each_once([options.card(env_id).id for env_id in (request.env_id, *request.also)])
    away = _held_out(request, options)
    parts = [_learnable(env_id, request, options, away) for env_id in (request.env_id, *request.also)]
    for part in parts[1:]:
        _require_alike(parts[0].task, part.task)
    return together(parts)


def _require_each_once(env_ids: Sequence[str]) -> None:
    """Raise MtpBenchError for an env that comes twice: its scenes would be learnt twice."""
    for place, env_id in enumerate(env_ids):
        if env_id in env_ids[:place]:
            raise MtpBenchError(
                f"{env_id} is named twice among the envs to learn from ({', '.join(env_ids)}), expected each once; "
                "--also names further envs beside that of --env"
            )


def _require_alike(task: Task, other: Task) -> None:
    """Raise MtpBenchError unless what is learnt from ``other`` is what ``task`` asks for."""
    for name in ("past", "future", "dt", "k", "ego_motion"):
        if getattr(task, name) != getattr(other, name):
            raise MtpBenchError(
                f"{other.env_id} has {name} {getattr(other, name)}, but {task.env_id} {getattr(task, name)}: "
                "they cannot be learnt together"
            )
    if other.classes != task.classes[: len(other.classes)]:
        raise MtpBenchError(f"{other.env_id} has other classes than {task.env_id}: they cannot be learnt together")


def _held_out(request: Request, options: RunOptions) -> tuple[str, ...]:
    """The scenes of the fold of the first env: another run scores them, so no other env may teach them."""
    if request.fold is None:
        return ()
    return held_out(open_split(request.env_id, options.on_split("train")).source.names, request.fold)


def _learnable(env_id: str, request: Request, options: RunOptions, away: Sequence[str]) -> Windows:
    opened = open_split(env_id, options.on_split("train"), request.fold, away)
    tracker: str | int = TRUTH if request.on == TRUTH else request.hypotheses
    found = windows(env_id, opened.card.source.split, tracker, opened.names, options)
    kept = taught(found)
    if not kept.any():
        raise MtpBenchError(f"{env_id}: no track of its training scenes follows an object with a known future")
    return found.select(kept | found.best if recipe_of(request.network).by_frame else kept)


def taught(found: Windows) -> Bools:
    """The windows [n] that follow an object with any known future."""
    return np.asarray((found.object_id >= 0) & found.future_known.any(axis=1))


def lesson_of(network: Network, found: Windows, sizes: Sizes) -> Lesson:
    """Windows as they are learnt from. Those of one object and frame count by the mass of their hypotheses.

    Windows that teach nothing have no weight: they are there for the others to see.
    """
    validation = validation_rows(found)
    whole = found.future_known.all(axis=1) | ~validation  # near the end of a scene only slow errors could be seen
    return Lesson(
        inputs=network.inputs(found, found.moment, found.seen, sizes),
        future=local_future(found, found.future),
        known=found.future_known,
        present=local_future(found, found.present[:, None])[:, 0],
        weight=np.where(taught(found) & whole, found.mass, 0).astype(np.float32),
        validation=validation,
    )


def validation_rows(found: Windows) -> np.ndarray:
    """The windows [n] that tell when to stop: of a tenth of the scenes; of few scenes, of the last fifth of each.

    Scenes of several envs that show the same traffic count as one scene: none of them is learnt from while another one
    is validated on. The last fifth is of the frames in which whole futures are known.
    """
    names = tuple(dict.fromkeys(found.own_names[number] for number in np.unique(found.scene)))
    if len(names) >= FEW_SCENES:
        return found.of_scenes(held_out(names, (1, min(10, len(names)))))
    rows = np.zeros(len(found), dtype=bool)
    for name in names:
        mine = found.of_scenes([name])
        whole = mine & found.future_known.all(axis=1)
        if whole.any():
            rows |= mine & (found.frame > np.quantile(found.frame[whole], 0.8))
    return rows


def train_predictor(
    found: Windows, request: Request, output: Path | None = None, told: Told = lambda *_: None
) -> tuple[Path, dict[str, Any]]:
    """Train on windows and write the weights: the file that was written, and its model card.

    ``output``: another file than that which agents look for. ``told``: see `fitting.fit`. Raises MtpBenchError where
    there is no window to learn from, or none to validate on.
    """
    network, sizes = network_of(request.network), Sizes.of(found.task)
    lesson = lesson_of(network, found, sizes)
    _require_both_parts(network, found, lesson)
    path = output or weights_folder() / file_name(request.network, request.on, found.task.env_id)
    try:
        make_folder(path.parent)
    except WriteError as error:
        raise MtpBenchError(f"{error} for weights with {WEIGHTS_VARIABLE}") from None
    checkpoint = path.with_name(f"{path.name}.checkpoint")  # longer than the name of the weights: never the same file
    state = fit(network, sizes, lesson, request.chosen_plan, device_of(request.device), told, checkpoint)
    card = model_card(request, found, lesson, state)
    write_weights(path, Stored(state.best, network.name, sizes, card))
    checkpoint.unlink(missing_ok=True)
    return path, card


def _require_both_parts(network: Network, found: Windows, lesson: Lesson) -> None:
    """Raise MtpBenchError unless there are windows to learn from and windows to validate on."""
    learnt, validated = _counts(lesson)
    if not learnt or not validated:
        raise MtpBenchError(
            f"{network.name} cannot be trained: scenes {len(found.names)}, windows to learn from {learnt}, windows to "
            f"validate on {validated}, expected at least 1 of both; validation takes windows with all "
            f"{found.task.future} future frames known, of fewer than {FEW_SCENES} scenes from the last fifth of each, "
            "else from a tenth of the scenes: take longer or more scenes"
        )


def _counts(lesson: Lesson) -> tuple[int, int]:
    """How many windows are learnt from, and how many are validated on; those without weight do not count."""
    counted = lesson.weight > 0
    return int((counted & ~lesson.validation).sum()), int((counted & lesson.validation).sum())


def model_card(request: Request, found: Windows, lesson: Lesson, state: State) -> dict[str, Any]:
    """What a file of weights says of how it was made."""
    learnt, validated = _counts(lesson)
    return {
        "env": ", ".join(found.envs),
        "detector": found.task.detector if request.on != TRUTH else "true boxes",
        "on": request.on,
        "hypotheses": request.hypotheses if request.on != TRUTH else 1,
        "present": request.on != TRUTH,  # of true boxes the present position is known
        "fold": None if request.fold is None else f"{request.fold[0]}/{request.fold[1]}",
        "scenes": list(found.names),
        "windows": learnt,
        "validation_windows": validated,
        "validation_minADE": round(min(state.curve), 4),
        "best_epoch": state.best_epoch,
        "plan": asdict(request.chosen_plan),
    }
