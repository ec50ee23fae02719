"""How agents are run: one record that every run, comparison, fit and check takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..cards import Card, changed_card, load_card
from ..errors import MtpBenchError
from ..parallel import NO_PROGRESS, SERIAL, Progress, Workers
from ..submission.loader import Submission
from .folds import Fold, held_out

MOST_SEED = 2**31 - 1
CHANGES = ("split", "detector", "detection_file", "files")  # of the card, as `changed_card` takes them


def require_seed(seed: int) -> None:
    """Raise MtpBenchError for a seed that files of runs and weights cannot hold."""
    if not 0 <= seed <= MOST_SEED:
        raise MtpBenchError(f"the seed is {seed}, expected a whole number from 0 to {MOST_SEED}")


@dataclass(frozen=True)
class RunOptions:
    """What a run needs to know beside the agent and the env; the same for whoever runs, scores or fits.

    Attributes:
        data: Root of the recorded data; None: ``MTP_BENCH_DATA``, else the user's data folder.
        scenes: Only the first ``scenes`` scenes of the split; None: all of them.
        seeds: Seeds of the random draws, one run each.
        split: Another split of the env than the card's, such as "train".
        detector: Another detector than the card's: a profile, or the first part of the names of stored files.
        fold: Only the scenes of a fold of the split, such as (1, 4); see `folds`.
        detection_file: File of stored detections in place of the card's.
        track_file: File or folder of stored tracks, for submissions that observe them.
        files: Folder of scenes in place of the card's.
        workers: Who does the work: processes of this machine, or a Dask cluster.
        progress: Who is told how many pieces of work there are, and of each that is done.

    Raises MtpBenchError for no scene, for no seed and for a seed below 0 or above `MOST_SEED`.
    """

    data: str | None = None
    scenes: int | None = None
    seeds: Sequence[int] = (0,)
    split: str | None = None
    detector: str | None = None
    fold: Fold | None = None
    detection_file: str | None = None
    track_file: str | None = None
    workers: Workers = SERIAL
    progress: Progress = NO_PROGRESS
    files: str | None = None

    def __post_init__(self) -> None:
        for name, value in (("scenes", self.scenes), ("seeds", len(self.seeds))):
            if value is not None and value < 1:
                raise MtpBenchError(f"{name} is {value}, expected at least 1")

        for seed in self.seeds:
            require_seed(seed)

    def chosen(self, names: Sequence[str]) -> tuple[str, ...]:
        """Those of the scenes of a split that are asked for; raises MtpBenchError where the fold cannot be cut."""
        return tuple(names if self.fold is None else held_out(names, self.fold))[: self.scenes]

    @property
    def changes(self) -> dict[str, Any]:
        """Keywords of `MTPEnv` and `changed_card` for what is not as in the card; a stored run keeps them."""
        return {name: value for name in CHANGES if (value := getattr(self, name)) is not None}

    @property
    def env_keywords(self) -> dict[str, Any]:
        """Keywords of `MTPEnv`: the data root and the changes of the card."""
        return {"data": self.data, **self.changes}

    def shown_to(self, submission: Submission) -> dict[str, Any]:
        """Keywords of `MTPEnv` for what a submission observes: by its manifest, and of stored tracks the file.

        Raises MtpBenchError where it observes stored tracks and none are named.
        """
        observe = submission.compare.observe
        if observe != "tracks":
            return {"observe": observe}
        if self.track_file is None:
            raise MtpBenchError(
                f"{submission.name} observes stored tracks: name their file or folder (--tracks, track_file=)"
            )
        return {"observe": observe, "track_file": self.track_file}

    def require_tracks_used(self, submissions: Sequence[Submission]) -> None:
        """Raise MtpBenchError where stored tracks are named and none of the submissions observes them."""
        if self.track_file is not None and not any(one.compare.observe == "tracks" for one in submissions):
            names = ", ".join(dict.fromkeys(one.name for one in submissions))
            raise MtpBenchError(
                f"stored tracks are named, but nobody observes them: {names}; run given_tracks, or a submission with "
                'observe = "tracks" under [compare]'
            )

    def card(self, env: str | Card) -> Card:
        """The card of an env with the changes; raises CardError, UnknownNameError."""
        return changed_card(env if isinstance(env, Card) else load_card(env), **self.changes)

    def on_split(self, name: str) -> RunOptions:
        """The same, on the split ``name`` unless another one is chosen."""
        return self if self.split is not None else replace(self, split=name)


DEFAULTS = RunOptions()
