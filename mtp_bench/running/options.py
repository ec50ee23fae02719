"""`RunOptions`: scenes, seeds, changes of the card, workers and progress of a run; folds of a split."""

import operator
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, SupportsIndex, TypedDict

import numpy as np

from ..agent import Submission
from ..cards import CHANGES, Card, changed_card, load_card, with_scenes
from ..core import (
    NO_PROGRESS,
    SERIAL,
    MtpBenchError,
    Progress,
    Scene,
    Workers,
    cores,
    require_known,
)
from ..scoring import SceneResult

MOST_SEED = 2**31 - 1
Fold = tuple[int, int]  # the number of a fold, from 1 on, and the number of folds


def fold_of(text: str) -> Fold:
    """The fold that a text such as "2/4" names: the second of four. Raises MtpBenchError for anything else."""
    first, _, second = text.partition("/")
    if not (
        text.isascii()
        and first.isdecimal()
        and second.isdecimal()
        and 1 <= int(first) <= int(second) > 1
    ):
        raise MtpBenchError(
            f"fold is {text!r}, expected the number of a fold and the number of folds, such as 1/4"
        )
    return int(first), int(second)


def held_out(names: Sequence[str], fold: Fold) -> tuple[str, ...]:
    """Scenes of a fold, in their order. They are drawn at random, the same for the same set of names.

    Raises MtpBenchError for a fold that does not exist, and for fewer scenes than folds.
    """
    number, folds = fold
    if not 1 <= number <= folds:
        raise MtpBenchError(
            f"fold is {fold}, expected the number of a fold and the number of folds, such as (1, 4)"
        )
    if len(names) < folds:
        raise MtpBenchError(f"{len(names)} scenes cannot be cut into {folds} folds")
    lot = np.random.default_rng(0).permutation(len(names)) % folds
    chosen = {
        name
        for name, drawn in zip(sorted(names), lot, strict=True)
        if drawn == number - 1
    }
    return tuple(name for name in names if name in chosen)


def require_seed(seed: int) -> None:
    """Raise MtpBenchError for a seed that files of runs and weights cannot hold."""
    if not 0 <= seed <= MOST_SEED:
        raise MtpBenchError(
            f"the seed is {seed}, expected a whole number from 0 to {MOST_SEED}"
        )


class RunKeywords(TypedDict, total=False):
    """Keywords of all functions that run agents, such as `evaluate` and `compare`."""

    data: (
        str | os.PathLike[str] | None
    )  # root of the recorded data; None: ``MTP_BENCH_DATA``, else the user's folder
    scenes: (
        int | Sequence[str] | Sequence[Scene] | None
    )  # how many, their names, or scenes of one's own; None: all
    seeds: int | Sequence[int]  # how many random draws of every agent, or their numbers
    jobs: int  # processes; 0: one per core; 1, the default: this process
    on_scene: (
        Callable[[SceneResult], object] | None
    )  # called here after every finished scene
    split: str | None  # another split than the card's, such as "train"
    detector: (
        str | None
    )  # another detector: a profile, or the first part of the names of stored files
    detection_file: (
        str | os.PathLike[str] | None
    )  # stored detections in place of the card's
    track_file: (
        str | os.PathLike[str] | None
    )  # stored tracks, for submissions that observe them
    files: str | os.PathLike[str] | None  # folder of scenes in place of the card's
    presence: (
        str | os.PathLike[str] | None
    )  # presence model of baselines: its file, or "scores"
    fold: Fold | None  # only the scenes of a fold of the split, such as (1, 4)


@dataclass(frozen=True)
class RunOptions:
    """Options of every run, comparison, fit and check, beside the agent and the env.

    Raises MtpBenchError for 0 scenes, for an empty list of seeds and for a seed below 0 or above `MOST_SEED`.
    """

    data: str | None = (
        None  # root of the recorded data; None: ``MTP_BENCH_DATA``, else the user's data folder
    )
    scenes: int | None = (
        None  # only the first ``scenes`` scenes of the split; None: all
    )
    seeds: Sequence[int] = (0,)  # of the random draws, one run each
    split: str | None = None  # another split than the card's, such as "train"
    detector: str | None = (
        None  # another detector: a profile, or the first part of the names of stored files
    )
    fold: Fold | None = None  # only the scenes of a fold of the split, such as (1, 4)
    detection_file: str | None = None  # stored detections in place of the card's
    track_file: str | None = (
        None  # file or folder of stored tracks, for submissions that observe them
    )
    workers: Workers = SERIAL  # processes of this machine, or a Dask cluster
    progress: Progress = (
        NO_PROGRESS  # callbacks for the number of tasks, and for each that is done
    )
    files: str | None = None  # folder of scenes in place of the card's
    presence: str | None = None  # presence model of baselines: its file, or "scores"
    names: tuple[str, ...] | None = (
        None  # of the scenes to run; None: the first ``scenes``
    )
    on_scene: Callable[[SceneResult], object] | None = (
        None  # called in this process after every finished scene
    )

    def __post_init__(self) -> None:
        for name, value in (("scenes", self.scenes), ("seeds", len(self.seeds))):
            if value is not None and value < 1:
                raise MtpBenchError(f"{name} is {value}, expected at least 1")
        for seed in self.seeds:
            require_seed(seed)

    def chosen(self, names: Sequence[str]) -> tuple[str, ...]:
        """Scenes to run, of those of a split; raises MtpBenchError if the fold or a named scene does not exist."""
        for name in self.names or ():
            require_known("scene", name, names)
        if self.names is not None:
            return self.names
        return tuple(names if self.fold is None else held_out(names, self.fold))[
            : self.scenes
        ]

    @property
    def changes(self) -> dict[str, Any]:
        """Keywords of `MTPEnv` and `changed_card` that differ from the card; a stored run keeps them."""
        return {
            name: value
            for name in CHANGES
            if (value := getattr(self, name)) is not None
        }

    @property
    def env_keywords(self) -> dict[str, Any]:
        """Keywords of `MTPEnv`: the data root and the changes of the card."""
        return {"data": self.data, **self.changes}

    def shown_to(self, submission: Submission) -> dict[str, Any]:
        """Keywords of `MTPEnv` for what a submission observes, by its manifest, with the file of stored tracks.

        Raises MtpBenchError if it observes stored tracks and no file is named.
        """
        observe = submission.compare.observe
        if observe != "tracks":
            return {"observe": observe}
        if self.track_file is None:
            advice = "name their file or folder (--tracks, track_file=)"
            raise MtpBenchError(f"{submission.name} observes stored tracks: {advice}")
        return {"observe": observe, "track_file": self.track_file}

    def require_usable(self, submissions: Sequence[Submission]) -> None:
        """Raise MtpBenchError for objects that the workers cannot get, and for stored tracks that none observes."""
        for each in submissions if self.workers != SERIAL else ():
            each.require_copy()
        self.require_tracks_used(submissions)

    def require_tracks_used(self, submissions: Sequence[Submission]) -> None:
        """Raise MtpBenchError if stored tracks are named and none of the submissions observes them."""
        if self.track_file is not None and not any(
            each.compare.observe == "tracks" for each in submissions
        ):
            names = ", ".join(dict.fromkeys(each.name for each in submissions))
            advice = 'run given_tracks, or a submission with observe = "tracks" under [compare]'
            raise MtpBenchError(
                f"stored tracks are named, which are not shown to {names}; {advice}"
            )

    def card(self, env: str | Card) -> Card:
        """The card of an env with the changes; raises CardError, UnknownNameError."""
        return changed_card(
            env if isinstance(env, Card) else load_card(env), **self.changes
        )

    def on_split(self, name: str) -> "RunOptions":
        """The same options on the split ``name``, unless they name a split."""
        return self if self.split is not None else replace(self, split=name)


DEFAULTS = RunOptions()


def asked(
    env: str | Card, options: RunOptions, keywords: Mapping[str, Any]
) -> tuple[str | Card, RunOptions]:
    """The env, with the scenes of one's own that are among the `RunKeywords`, and the options with the others.

    Raises UnknownNameError for other keywords, MtpBenchError for values that `RunOptions` refuses.
    """
    changes = {
        name: os.fspath(value) if isinstance(value, os.PathLike) else value
        for name, value in keywords.items()
    }
    for name in changes:
        require_known("keyword", name, RunKeywords.__annotations__)
    for name in {"jobs", "scenes", "seeds"} & changes.keys():
        if isinstance(changes[name], bool | float) or (
            isinstance(changes[name], str) and name != "scenes"
        ):
            raise MtpBenchError(f"{name} is {changes[name]!r}, expected a whole number")
        if isinstance(changes[name], SupportsIndex):
            changes[name] = operator.index(changes[name])
    if isinstance(fold := changes.get("fold"), str):
        changes["fold"] = fold_of(fold)
    if "jobs" in changes:
        changes["workers"] = Workers(changes.pop("jobs") or cores())
    if isinstance(seeds := changes.get("seeds"), int):
        changes["seeds"] = range(seeds)
    scenes = changes.get("scenes")
    if isinstance(scenes, str | Scene) or not isinstance(scenes, int | Sequence | None):
        raise MtpBenchError(
            f"scenes is {scenes!r}, expected a number of scenes, or a list of names or scenes"
        )
    if isinstance(scenes, Sequence):
        changes |= {
            "scenes": None,
            "names": tuple(
                dict.fromkeys(getattr(each, "name", each) for each in scenes)
            ),
        }
        if not scenes:
            raise MtpBenchError("scenes is an empty list, expected at least one scene")
        if isinstance(scenes[0], Scene):
            env = with_scenes(env if isinstance(env, Card) else load_card(env), scenes)
    return env, replace(options, **changes)
