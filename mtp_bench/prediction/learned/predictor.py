"""A network in an agent: NumPy alone, once per frame over the distinct windows of all tracks."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...agent import Forecasts, Frame
from ...errors import SubmissionError
from ...types import Task
from ..windows import shown_as_truth, surroundings_of, windows_of
from .around import detections_of_tracks
from .local import to_absolute
from .network import network_of, require_lanes
from .weights import StoredWeights, find_weights, read_weights, require_fit

ASSOCIATIONS = ("network", "track")


class LearnedPredictor:
    """Forecasts of a trained network.

    ``network``: its name, such as "modes". ``on``: what it was trained on, "truth" or "tracklets". ``weights``: your
    own file; None: the one for the task's env, see `mtp_bench.prediction.learned.weights`. ``association``: of a
    network that finds the object among the detections around it; "network": its input is all of them, "track": only
    those that the track took, as in a pipeline that tracks first.

    A network that was trained on ground-truth tracks gets all tracks in that form, with score 1 and no count of frames
    before the window: it has never seen another score, and its answer to one is arbitrary.

    Raises SubmissionError for an ``association`` that the network lacks, and at ``reset`` if no file fits the task, or
    if the network reads lanes and the task shows none.
    """

    def __init__(
        self, network: str = "modes", on: str = "truth", weights: str | Path | None = None, association: str = "network"
    ) -> None:
        if association not in ASSOCIATIONS:
            raise SubmissionError(f"association is {association!r}, expected one of: {', '.join(ASSOCIATIONS)}")
        self._network, self._by_track = network_of(network), association == "track"
        if self._by_track and not self._network.around:
            raise SubmissionError(
                f"association is 'track', expected 'network' for network {network!r}: its input is always the track"
            )
        self._on, self._given = on, None if weights is None else Path(weights)

    def reset(self, task: Task) -> None:
        """Begin a new scene."""
        require_lanes(self._network, task.env_id, task.lanes > 0)
        path = self._given or find_weights(self._network.name, self._on, task)
        stored = _read(path, path.stat().st_mtime_ns if path.is_file() else 0, self._network.name)
        require_fit(stored.sizes, task, path)
        self._stored, self._as_truth = stored, stored.card.get("on") == "truth"
        self._class = np.array([stored.sizes.classes.index(name) for name in task.classes])

    def predict(self, frame: Frame) -> Forecasts:
        """Forecasts of the distinct windows of ``frame``."""
        sizes = self._stored.sizes
        windows, row = windows_of(frame, sizes.past)
        if len(windows) == 0:
            return Forecasts(np.zeros((0, sizes.modes, sizes.future, 2)), row=row)
        seen = surroundings_of(frame.seen)
        windows = replace(windows, class_id=self._class[windows.class_id])
        seen = replace(seen, class_id=self._class[seen.class_id])
        if self._as_truth:
            windows, seen = shown_as_truth(windows), replace(seen, score=np.ones_like(seen.score))
        moment = np.full(len(windows), seen.frames - 1)
        if self._by_track:
            seen, moment = detections_of_tracks(windows, moment, seen)
        output = self._network.forward(self._stored.weights, self._network.inputs(windows, moment, seen, sizes), sizes)
        present = to_absolute(windows, output["present"]) if self._stored.card.get("present") else None
        return Forecasts(to_absolute(windows, output["modes"]), output["log_weight"], present, row=row)


@lru_cache(maxsize=4)  # an agent begins many scenes with the same file
def _read(path: Path, changed: int, network: str) -> StoredWeights:
    """The weights of a file that was ``changed`` last at this time, ns."""
    return read_weights(path, network_of(network))
