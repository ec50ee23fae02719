"""Training of a predictor: from the training split of an env to a file of weights with its model card."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core import (
    VARIABLE as WEIGHTS_VARIABLE,
    Bools,
    MtpBenchError,
    Task,
    WriteError,
    file_name,
    make_folder,
    require_known,
    weights_folder,
)
from ..prediction import (
    Network,
    Sizes,
    StoredWeights,
    local_future,
    network_of,
    require_lanes,
    write_weights,
)
from ..running import DEFAULTS, Fold, RunOptions, held_out
from .fitting import (
    EpochCallback,
    FittedNetwork,
    TrainingPlan,
    TrainingSet,
    device_of,
    fit,
)
from .split import open_split
from .tracklets import TRUTH, Windows, concatenate, windows

ON = ("truth", "tracklets")
HYPOTHESES = 20  # of the tracker whose tracklets are learnt from
FEW_SCENES = 5  # from so many on, validation takes whole scenes


@dataclass(frozen=True)
class TrainingRequest:
    """Network, env and plan of a training."""

    network: str
    env_id: str
    on: str = "truth"
    hypotheses: int = HYPOTHESES
    fold: Fold | None = None  # whose scenes are left out, see `open_split`
    also: tuple[
        str, ...
    ] = ()  # further envs to learn from, with the same rate and sizes
    plan: TrainingPlan | None = None  # None: the plan of the network's recipe
    device: str = "auto"

    def __post_init__(self) -> None:
        stages = len(network_of(self.network).recipe.stages)
        epochs = self.chosen_plan.epochs
        require_known("value of --on", self.on, ON)
        if epochs < stages:
            raise MtpBenchError(
                f"epochs is {epochs}, expected at least {stages}: {self.network} has {stages} stages"
            )

    @property
    def chosen_plan(self) -> TrainingPlan:
        """The plan, or the one of the network's recipe."""
        return self.plan or TrainingPlan(network_of(self.network).recipe.epochs)


def training_windows(
    request: TrainingRequest, options: RunOptions = DEFAULTS
) -> Windows:
    """The windows that a request learns from: those that follow an object with a known future.

    For a network that sees whole frames, also the windows that the others see. Raises MtpBenchError for an env that is
    named twice, for further envs beside own files, and for envs of different rates, sizes or classes.
    """
    if request.also and options.files is not None:
        raise MtpBenchError(
            f"--also {request.also[0]} cannot go with --files: its scenes would be learnt once per env"
        )
    cards = [options.card(env_id) for env_id in (request.env_id, *request.also)]
    for card in cards:
        require_lanes(network_of(request.network), card.id, card.lanes is not None)
    env_ids = [card.id for card in cards]
    twice = next(
        (env_id for place, env_id in enumerate(env_ids) if env_id in env_ids[:place]),
        None,
    )
    if twice is not None:  # its scenes would count twice
        raise MtpBenchError(
            f"{twice} is named twice among the envs to learn from ({', '.join(env_ids)}), expected each once"
        )
    away: tuple[
        str, ...
    ] = ()  # another run scores them, so they are left out of every env
    if request.fold is not None:
        away = held_out(
            open_split(request.env_id, options.on_split("train")).source.names,
            request.fold,
        )
    parts = [
        _windows_of_env(env_id, request, options, away)
        for env_id in (request.env_id, *request.also)
    ]
    for part in parts[1:]:
        _require_same_task(parts[0].task, part.task)
    return concatenate(parts)


def _require_same_task(task: Task, other: Task) -> None:
    """Raise MtpBenchError unless one network can be trained on windows of both tasks."""
    for name in ("past", "future", "dt", "k", "ego_motion", "lanes", "lane_points"):
        if getattr(task, name) != getattr(other, name):
            raise MtpBenchError(
                f"{other.env_id} has {name} {getattr(other, name)}, but {task.env_id} {getattr(task, name)}: "
                "one network cannot be trained on both"
            )
    if other.classes != task.classes[: len(other.classes)]:
        raise MtpBenchError(
            f"{other.env_id} has other classes than {task.env_id}: one network cannot be trained on both"
        )


def _windows_of_env(
    env_id: str, request: TrainingRequest, options: RunOptions, away: Sequence[str]
) -> Windows:
    split = open_split(env_id, options.on_split("train"), request.fold, away)
    tracker: str | int = TRUTH if request.on == TRUTH else request.hypotheses
    found = windows(env_id, split.card.source.split, tracker, split.names, options)
    labelled = has_future(found)
    if not labelled.any():
        raise MtpBenchError(
            f"{env_id}: no track of its training scenes follows an object with a known future"
        )
    return found.select(
        labelled | found.best
        if network_of(request.network).recipe.by_frame
        else labelled
    )


def has_future(found: Windows) -> Bools:
    """Mask [n] of the windows that follow an object with any known future."""
    return np.asarray((found.object_id >= 0) & found.future_known.any(axis=1))


def training_set(network: Network, found: Windows, sizes: Sizes) -> TrainingSet:
    """The windows as the network learns from them; those of one object and frame weigh as much as their hypotheses.

    Windows without a known future have weight 0: they are there for the others to see.
    """
    validation = validation_rows(found)
    whole = (
        found.future_known.all(axis=1) | ~validation
    )  # near the end of a scene only slow errors could be seen
    return TrainingSet(
        inputs=network.inputs(found, found.moment, found.seen, sizes),
        future=local_future(found, found.future),
        known=found.future_known,
        present=local_future(found, found.present[:, None])[:, 0],
        weight=np.where(has_future(found) & whole, found.mass, 0).astype(np.float32),
        validation=validation,
    )


def validation_rows(found: Windows) -> np.ndarray:
    """Mask [n] of the windows for validation: of a tenth of the scenes; of few scenes, the last fifth of each.

    Scenes of several envs that show the same traffic count as one scene, which is on one side only. The last fifth is
    of the frames in which whole futures are known.
    """
    names = tuple(
        dict.fromkeys(found.own_names[number] for number in np.unique(found.scene))
    )
    if len(names) >= FEW_SCENES:
        return found.of_scenes(held_out(names, (1, min(10, len(names)))))
    rows = np.zeros(len(found), dtype=bool)
    for name in names:
        own = found.of_scenes([name])
        whole = own & found.future_known.all(axis=1)
        if whole.any():
            rows |= own & (found.frame > np.quantile(found.frame[whole], 0.8))
    return rows


def train_predictor(
    found: Windows,
    request: TrainingRequest,
    output: Path | None = None,
    callback: EpochCallback = lambda *_: None,
) -> tuple[Path, dict[str, Any]]:
    """Train on windows and write the weights: the file that was written, and its model card.

    ``output``: another file than the one where agents look; ``callback``: called after each epoch. Raises MtpBenchError
    if there is no window to learn from, or none to validate on.
    """
    network = network_of(request.network)
    sizes = Sizes.of(found.task)
    data = training_set(network, found, sizes)
    _require_both_parts(network, found, data)
    path = output or weights_folder() / file_name(
        request.network, request.on, found.task.env_id
    )
    try:
        make_folder(path.parent)
    except WriteError as error:
        raise MtpBenchError(f"{error} for weights with {WEIGHTS_VARIABLE}") from None
    end = fit(
        network, sizes, data, request.chosen_plan, device_of(request.device), callback
    )
    card = model_card(request, found, data, end)
    write_weights(path, StoredWeights(end.best, network.name, sizes, card))
    return path, card


def _require_both_parts(network: Network, found: Windows, data: TrainingSet) -> None:
    """Raise MtpBenchError unless there are windows to learn from and windows to validate on."""
    learnt, validated = _counts(data)
    if not learnt or not validated:
        raise MtpBenchError(
            f"{network.name} cannot be trained: scenes {len(found.names)}, windows to learn from {learnt}, windows to "
            f"validate on {validated}, expected at least 1 of both; validation takes windows with all "
            f"{found.task.future} future frames known, of fewer than {FEW_SCENES} scenes from the last fifth of each, "
            "else from a tenth of the scenes: take longer or more scenes"
        )


def _counts(data: TrainingSet) -> tuple[int, int]:
    """Numbers of windows with weight, to learn from and to validate on."""
    weighted = data.weight > 0
    return int((weighted & ~data.validation).sum()), int(
        (weighted & data.validation).sum()
    )


def model_card(
    request: TrainingRequest, found: Windows, data: TrainingSet, end: FittedNetwork
) -> dict[str, Any]:
    """The model card of a file of weights: data, plan and validation error of its training."""
    learnt, validated = _counts(data)
    return {
        "env": ", ".join(found.envs),
        "detector": found.task.detector if request.on != TRUTH else "true boxes",
        "on": request.on,
        "hypotheses": request.hypotheses if request.on != TRUTH else 1,
        "present": request.on != TRUTH,  # of true boxes the present position is known
        "fold": None
        if request.fold is None
        else f"{request.fold[0]}/{request.fold[1]}",
        "scenes": list(found.names),
        "windows": learnt,
        "validation_windows": validated,
        "validation_minADE": round(min(end.curve), 4),
        "best_epoch": end.best_epoch,
        "plan": asdict(request.chosen_plan),
    }
