"""Fitting the parameters of baselines on the training split of an env."""

from __future__ import annotations

from collections.abc import Callable

from ..cards import changed_card, load_card
from ..env import MTPEnv
from ..errors import MtpBenchError
from ..sources import open_source

KINDS = ("motion-noise",)


def fit_motion_noise(
    env_id: str,
    data: str | None = None,
    observe: str = "detections",
    started: Callable[[int], object] | None = None,
    progress: Callable[[str], object] | None = None,
    scenes: int | None = None,
    detector: str | None = None,
) -> str:
    """TOML of the motion noise fitted on the training split of ``env_id``, as ``mtp_bench.prediction`` stores it.

    On its first ``scenes`` scenes (None: all), with another simulated ``detector`` where one is named.

    Raises MtpBenchError for whatever the user can mend, an empty training split among it.
    """
    from ..prediction.motion_noise import as_toml, condition, fit_scenes

    card = load_card(env_id)
    task = MTPEnv(env_id, data=data, observe=observe, detector=detector).task
    source = open_source(changed_card(card, "train", detector), data)
    names = source.names[:scenes]
    if started is not None:
        started(len(names))
    training = []
    for name in names:
        training.append(source.load(name))
        if progress is not None:
            progress(name)
    if not training:
        raise MtpBenchError(f"{env_id} has no scene in its training split")
    rows = fit_scenes(training, task)
    if not rows:
        raise MtpBenchError(
            f"{env_id}: no track of the {len(training)} training scenes follows an object with {task.future} future "
            "frames, so there is nothing to fit"
        )
    return as_toml(condition(task), rows)
