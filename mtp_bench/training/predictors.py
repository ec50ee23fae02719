"""Training of a predictor: from the training split of an env to a file of weights."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core import (
    WEIGHTS_VARIABLE,
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
# what the tasks of several envs must share to teach one network
_SHARED_FIELDS = ("past", "future", "dt", "k", "ego_motion", "lanes", "lane_points")


@dataclass(frozen=True)
class TrainingRequest:
    """Network, env and plan of a training."""

    network: str
    env_id: str
    on: str = "truth"
    hypotheses: int = HYPOTHESES
    fold: Fold | None = None  # whose scenes are left out, see `open_split`
    # further envs to learn from, with the same rate and sizes
    also: tuple[str, ...] = ()
    plan: TrainingPlan | None = None  # None: the plan of the network's recipe
    device: str = "auto"

    def __post_init__(self) -> None:
        stages = len(network_of(self.network).recipe.stages)
        epochs = self.chosen_plan.epochs
        require_known("value of --on", self.on, ON)
        if epochs < stages:
            raise MtpBenchError(
                f"epochs is {epochs}, expected at least {stages}: "
                f"{self.network} has {stages} stages"
            )

    @property
    def chosen_plan(self) -> TrainingPlan:
        """The plan, or the one of the network's recipe."""
        return self.plan or TrainingPlan(network_of(self.network).recipe.epochs)

    @property
    def env_ids(self) -> tuple[str, ...]:
        """All envs to learn from."""
        return (self.env_id, *self.also)


def training_windows(
    request: TrainingRequest, options: RunOptions = DEFAULTS
) -> Windows:
    """Return the windows that follow an object with a known future.

    A network that sees whole frames also gets windows with an unknown future: they
    surround the others. Raises
    MtpBenchError for an env that is named twice, for further envs beside own files, and
    for envs of different rates, sizes or classes.
    """
    if request.also and options.files is not None:
        raise MtpBenchError(
            f"--also {request.also[0]} cannot go with --files: "
            "its scenes would be learnt once per env"
        )
    card_ids: list[str] = []
    for env_id in request.env_ids:
        card = options.card(env_id)
        require_lanes(network_of(request.network), card.id, card.lanes is not None)
        if card.id in card_ids:  # its scenes would count twice
            raise MtpBenchError(
                f"{card.id} is named twice among the envs to learn from, "
                "expected each once"
            )
        card_ids.append(card.id)
    # Another run scores the fold, so its scenes are left out of every env.
    fold_scenes: tuple[str, ...] = ()
    if request.fold is not None:
        split = open_split(request.env_id, options.on_split("train"))
        fold_scenes = held_out(split.source.names, request.fold)
    parts = [
        _windows_of_env(env_id, request, options, fold_scenes)
        for env_id in request.env_ids
    ]
    for part in parts[1:]:
        _require_same_task(parts[0].task, part.task)
    return concatenate(parts)


def _require_same_task(task: Task, second_task: Task) -> None:
    """Raise MtpBenchError unless one network can learn from both tasks."""
    for field_name in _SHARED_FIELDS:
        first_value = getattr(task, field_name)
        second_value = getattr(second_task, field_name)
        if first_value != second_value:
            raise MtpBenchError(
                f"{second_task.env_id} has {field_name} {second_value}, but "
                f"{task.env_id} {first_value}: one network cannot be trained on both"
            )
    if second_task.classes != task.classes[: len(second_task.classes)]:
        raise MtpBenchError(
            f"{second_task.env_id} has other classes than {task.env_id}: "
            "one network cannot be trained on both"
        )


def _windows_of_env(
    env_id: str, request: TrainingRequest, options: RunOptions, left_out: Sequence[str]
) -> Windows:
    split = open_split(env_id, options.on_split("train"), request.fold, left_out)
    tracker: str | int = request.hypotheses
    if request.on == TRUTH:
        tracker = TRUTH
    env_windows = windows(
        env_id, split.card.source.split, tracker, split.names, options
    )
    learnt_rows = has_future(env_windows)
    if not learnt_rows.any():
        raise MtpBenchError(
            f"{env_id}: no track of its training scenes follows an object with a known "
            "future"
        )
    if network_of(request.network).recipe.by_frame:
        learnt_rows = learnt_rows | env_windows.best
    return env_windows.select(learnt_rows)


def has_future(windows: Windows) -> Bools:
    """Return a mask [n] of windows with any known future."""
    return np.asarray((windows.object_id >= 0) & windows.future_known.any(axis=1))


def training_set(network: Network, windows: Windows, sizes: Sizes) -> TrainingSet:
    """Return the windows as the network learns from them.

    A window weighs as much as the hypotheses that its track is in. Windows without a
    known future have weight 0: networks see them around the others.
    """
    validation = validation_rows(windows)
    # a future that is cut short would show the small errors of its first frames alone
    may_count = windows.future_known.all(axis=1) | ~validation
    weight = np.where(has_future(windows) & may_count, windows.mass, 0)
    return TrainingSet(
        inputs=network.inputs(windows, windows.moment, windows.surroundings, sizes),
        future=local_future(windows, windows.future),
        is_known=windows.future_known,
        present=local_future(windows, windows.present[:, None])[:, 0],
        weight=weight.astype(np.float32),
        validation=validation,
    )


def validation_rows(windows: Windows) -> np.ndarray:
    """Return a mask [n] of the windows for validation.

    They are those of a tenth of the scenes, or of few scenes the last fifth of each.
    The last fifth is of the frames in which whole futures are known. Scenes of several
    envs that show the same traffic count as one scene, which is on one side only.
    """
    scenes = np.unique(windows.scene)
    scene_names = tuple(dict.fromkeys(windows.own_names[scene] for scene in scenes))
    count = len(scene_names)
    if count >= FEW_SCENES:
        first_fold = (1, min(10, count))
        return windows.of_scenes(held_out(scene_names, first_fold))
    has_whole_future = windows.future_known.all(axis=1)
    rows = np.zeros(len(windows), dtype=bool)
    for scene_name in scene_names:
        scene_rows = windows.of_scenes([scene_name])
        whole_rows = scene_rows & has_whole_future
        if whole_rows.any():
            learnt_until = np.quantile(windows.frame[whole_rows], 0.8)
            rows |= scene_rows & (windows.frame > learnt_until)
    return rows


def train_predictor(
    windows: Windows,
    request: TrainingRequest,
    output: Path | None = None,
    callback: EpochCallback = lambda *_: None,
) -> tuple[Path, dict[str, Any]]:
    """Train on windows and write the weights.

    Returns the file that was written, and its model card. ``output``: another file than
    the one where agents look; ``callback``: called after each epoch. Raises
    MtpBenchError if there is no window to learn from, or none to validate on.
    """
    network = network_of(request.network)
    task = windows.task
    sizes = Sizes.of(task)
    data = training_set(network, windows, sizes)
    is_weighted = data.weight > 0
    validated = int((is_weighted & data.validation).sum())
    learnt = int(is_weighted.sum()) - validated
    if not learnt or not validated:
        raise MtpBenchError(
            f"{network.name} cannot be trained: scenes {len(windows.names)}, windows "
            f"to learn from {learnt}, windows to validate on {validated}, expected at "
            "least 1 of both; validation takes windows with all "
            f"{task.future} future frames known, of fewer than {FEW_SCENES} scenes "
            "from the last fifth of each, else from a tenth of the scenes: take longer "
            "or more scenes"
        )
    path = output
    if path is None:
        weights_name = file_name(request.network, request.on, task.env_id)
        path = weights_folder() / weights_name
    try:
        make_folder(path.parent)
    except WriteError as error:
        raise MtpBenchError(f"{error} for weights with {WEIGHTS_VARIABLE}") from None
    device = device_of(request.device)
    fitted = fit(network, sizes, data, request.chosen_plan, device, callback)
    card = _model_card(request, windows, fitted, learnt, validated)
    write_weights(path, StoredWeights(fitted.best, network.name, sizes, card))
    return path, card


def _model_card(
    request: TrainingRequest,
    windows: Windows,
    fitted: FittedNetwork,
    learnt: int,
    validated: int,
) -> dict[str, Any]:
    """Return data, plan and validation error of a training.

    ``learnt`` and ``validated``: numbers of windows to learn from and to validate on.
    """
    on_truth = request.on == TRUTH
    fold = None
    if request.fold is not None:
        fold = f"{request.fold[0]}/{request.fold[1]}"
    return {
        "env": ", ".join(windows.envs),
        "detector": "true boxes" if on_truth else windows.task.detector,
        "on": request.on,
        "hypotheses": 1 if on_truth else request.hypotheses,
        "present": not on_truth,  # of true boxes the present position is known
        "fold": fold,
        "scenes": list(windows.names),
        "windows": learnt,
        "validation_windows": validated,
        "validation_minADE": round(min(fitted.curve), 4),
        "best_epoch": fitted.best_epoch,
        "plan": asdict(request.chosen_plan),
    }
