"""Runs a network in an agent: NumPy alone, once per frame over the distinct windows of all tracks."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...agent import Forecasts, Frame
from ...errors import SubmissionError
from ...types import Task
from ..windows import shown_as_truth, surroundings_of, windows_of
from .around import taken_alone
from .local import to_absolute
from .registry import AROUND, network_of
from .weights import Stored, find_weights, read_weights, require_fit

ASSOCIATIONS = ("network", "track")


class LearnedPredictor:
    """Forecasts of a trained network.

    ``network``: its name, such as "modes". ``on``: what it was trained on, "truth" or "tracklets". ``weights``: a file
    of your own; None: the one for the task's env, see `mtp_bench.prediction.learned.weights`. ``as_truth``: whether it
    is shown tracks as it saw true pasts in training, with score 1 and no count of what came before the window; None:
    where its file says that it was trained on true pasts. Such a network has never seen another score, and what it
    makes of one is chance: leaderboard/RESULTS.md says what that costs. ``association``: of a network that finds the
    object among the detections around it; "network": it sees them all, "track": only those that the track took, as in
    a pipeline that tracks first.
    Raises SubmissionError for another ``association``, and for that of a track where the network sees tracks anyway.
    Raises SubmissionError at ``reset`` where there is no file or it is made for another task.
    """

    def __init__(
        self,
        network: str = "modes",
        on: str = "truth",
        weights: str | Path | None = None,
        as_truth: bool | None = None,
        association: str = "network",
    ) -> None:
        _require_association(association, network)
        self._alone = association == "track"
        self._network, self._chosen = network_of(network), as_truth
        self._on, self._given = on, None if weights is None else Path(weights)

    def reset(self, task: Task) -> None:
        """Forget everything; a new scene begins."""
        path = self._given or find_weights(self._network.name, self._on, task)
        stored = _read(path, path.stat().st_mtime_ns if path.is_file() else 0, self._network.name)
        require_fit(stored.sizes, task, path)
        self._stored = stored
        self._as_truth = stored.card.get("on") == "truth" if self._chosen is None else self._chosen
        self._class = np.array([stored.sizes.classes.index(name) for name in task.classes])

    def predict(self, frame: Frame) -> Forecasts:
        """What the network says of the distinct windows of ``frame``."""
        sizes = self._stored.sizes
        windows, row = windows_of(frame, sizes.past)
        windows = replace(windows, class_id=self._class[windows.class_id])
        if self._as_truth:
            windows = shown_as_truth(windows)
        if len(windows) == 0:
            return Forecasts(np.zeros((0, sizes.modes, sizes.future, 2)), row=row)
        seen = surroundings_of(frame.seen)
        seen = replace(seen, class_id=self._class[seen.class_id])
        if self._as_truth:
            seen = replace(seen, score=np.ones_like(seen.score))
        moment = np.full(len(windows), seen.frames - 1)
        if self._alone:
            seen, moment = taken_alone(windows, moment, seen)
        inputs = self._network.inputs(windows, moment, seen, sizes)
        said = self._network.forward(self._stored.weights, inputs, sizes)
        present = to_absolute(windows, said["present"]) if self._stored.card.get("present") else None
        return Forecasts(to_absolute(windows, said["modes"]), said["log_weight"], present, row=row)


def _require_association(association: str, network: str) -> None:
    if association not in ASSOCIATIONS:
        raise SubmissionError(f"association is {association!r}, expected one of: {', '.join(ASSOCIATIONS)}")
    if association == "track" and network not in AROUND:
        raise SubmissionError(
            f"association is 'track' for network {network!r}, which sees tracks anyway; it is for: {', '.join(AROUND)}"
        )


@lru_cache(maxsize=4)  # one file per scene would otherwise be read anew for every scene
def _read(path: Path, changed: int, network: str) -> Stored:
    """The weights of a file that was ``changed`` last at this time, ns."""
    return read_weights(path, network_of(network))
