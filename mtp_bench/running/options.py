"""Options of a run: scenes, seeds, changes of the card, workers; folds of a split."""

import operator
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, SupportsIndex

import numpy as np

from ..agent import Submission
from ..cards import Card, CardChanges, ChangeKeywords, load_card, with_scenes
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

MAX_SEED = 2**31 - 1
Fold = tuple[int, int]  # the number of a fold, from 1 on, and the number of folds


def fold_of(text: str) -> Fold:
    """Return the fold that a text such as "2/4" names: the second of four.

    Raises MtpBenchError for any other text.
    """
    number, _, folds = text.partition("/")
    is_pair = text.isascii() and number.isdecimal() and folds.isdecimal()
    if not (is_pair and int(folds) > 1 and 1 <= int(number) <= int(folds)):
        raise MtpBenchError(
            f"fold is {text!r}, expected the number of a fold and the number of folds, "
            "such as 1/4"
        )
    return int(number), int(folds)


def held_out(scene_names: Sequence[str], fold: Fold) -> tuple[str, ...]:
    """Return the scenes of a fold, in their order.

    They are drawn at random, the same for the same set of names. Raises MtpBenchError
    for a fold that does not exist, and for fewer scenes than folds.
    """
    number, folds = fold
    if not 1 <= number <= folds:
        raise MtpBenchError(
            f"fold is {fold}, expected the number of a fold and the number of folds, "
            "such as (1, 4)"
        )
    if len(scene_names) < folds:
        raise MtpBenchError(
            f"{len(scene_names)} scenes cannot be cut into {folds} folds"
        )
    fold_indices = np.random.default_rng(0).permutation(len(scene_names)) % folds
    fold_of_name = dict(zip(sorted(scene_names), fold_indices, strict=True))
    return tuple(name for name in scene_names if fold_of_name[name] == number - 1)


def require_seed(seed: int) -> None:
    """Raise MtpBenchError for a seed that files of runs and weights cannot hold."""
    if not 0 <= seed <= MAX_SEED:
        raise MtpBenchError(
            f"the seed is {seed}, expected a whole number from 0 to {MAX_SEED}"
        )


class RunKeywords(ChangeKeywords, total=False):
    """Keywords of all functions that run agents, with those of `ChangeKeywords`."""

    # root of the recorded data; None: ``MTP_BENCH_DATA``, else the user's folder
    data: str | os.PathLike[str] | None
    # how many, their names, or scenes of one's own; None: all
    scenes: int | Sequence[str] | Sequence[Scene] | None
    seeds: int | Sequence[int]  # number of random draws of every agent, or their seeds
    jobs: int  # processes; 0: one per core; 1, the default: this process
    fold: Fold | None  # only the scenes of a fold of the split, such as (1, 4)
    # file or folder of stored tracks, for submissions that observe them
    tracks: str | os.PathLike[str] | None
    # called in this process after every finished scene
    on_scene: Callable[[SceneResult], object] | None


@dataclass(frozen=True)
class RunOptions(CardChanges):
    """Options of every run, comparison, fit and check, beside the agent and the env.

    The fields that are not here are those of `ChangeKeywords`. Raises MtpBenchError for
    0 scenes, for an empty list of seeds and for a seed below 0 or above `MAX_SEED`.
    """

    # root of the recorded data; None: ``MTP_BENCH_DATA``, else the user's data folder
    data: str | None = None
    scenes: int | None = None  # only the first scenes of the split; None: all
    seeds: Sequence[int] = (0,)  # seeds of the random draws, one run each
    fold: Fold | None = None  # only the scenes of a fold of the split, such as (1, 4)
    names: tuple[str, ...] | None = None  # scene names; None: the first ``scenes``
    # file or folder of stored tracks, for submissions that observe them
    tracks: str | None = None
    workers: Workers = SERIAL  # processes of this machine, or a Dask cluster
    progress: Progress = NO_PROGRESS  # of a caller that counts the work itself
    # called in this process after every finished scene
    on_scene: Callable[[SceneResult], object] | None = None

    def __post_init__(self) -> None:
        for name, value in (("scenes", self.scenes), ("seeds", len(self.seeds))):
            if value is not None and value < 1:
                raise MtpBenchError(f"{name} is {value}, expected at least 1")
        for seed in self.seeds:
            require_seed(seed)

    def chosen(self, scene_names: Sequence[str]) -> tuple[str, ...]:
        """Return the scenes to run, of the ``scene_names`` of a split.

        Raises MtpBenchError if the fold or a named scene does not exist.
        """
        if self.names is not None:
            for scene_name in self.names:
                require_known("scene", scene_name, scene_names)
            return self.names
        if self.fold is not None:
            scene_names = held_out(scene_names, self.fold)
        return tuple(scene_names)[: self.scenes]

    @property
    def unchanged(self) -> "RunOptions":
        """The same scenes, for a card that has all the changes already."""
        return RunOptions(
            self.data,
            self.scenes,
            fold=self.fold,
            names=self.names,
            workers=self.workers,
        )

    @property
    def env_keywords(self) -> dict[str, Any]:
        """Keywords of `MTPEnv`: the data root and the changes of the card."""
        return {"data": self.data, **self.changes}

    def shown_to(self, submission: Submission) -> dict[str, Any]:
        """Return the keywords of `MTPEnv` for what a submission observes.

        Raises MtpBenchError if it observes stored tracks and no file is named.
        """
        observe = submission.compare.observe
        if observe != "tracks":
            return {"observe": observe}
        if self.tracks is None:
            raise MtpBenchError(
                f"{submission.name} observes stored tracks: "
                "name their file or folder (--tracks, tracks=)"
            )
        return {"observe": observe, "tracks": self.tracks}

    def require_usable(self, submissions: Sequence[Submission]) -> None:
        """Raise MtpBenchError for submissions that cannot run under these options.

        Objects that cannot be sent to the workers are such submissions; see also
        `require_tracks_used`.
        """
        if self.workers != SERIAL:
            for submission in submissions:
                submission.require_copy()
        self.require_tracks_used(submissions)

    def require_tracks_used(self, submissions: Sequence[Submission]) -> None:
        """Raise MtpBenchError if no submission observes the stored tracks named."""
        if self.tracks is None:
            return
        observed = [submission.compare.observe for submission in submissions]
        if "tracks" not in observed:
            agent_names = ", ".join(dict.fromkeys(agent.name for agent in submissions))
            raise MtpBenchError(
                f"stored tracks are named, which are not shown to {agent_names}; run "
                'given_tracks, or a submission with observe = "tracks" under [compare]'
            )

    def card(self, env: str | Card) -> Card:
        """Return the card of an env with the changes.

        Raises CardError, UnknownNameError.
        """
        return self.apply(_loaded(env))

    def on_split(self, name: str) -> "RunOptions":
        """Return these options on the split ``name``, unless they name a split."""
        return self if self.split is not None else replace(self, split=name)


DEFAULTS = RunOptions()


def resolve_options(
    env: str | Card, options: RunOptions, keywords: Mapping[str, Any]
) -> tuple[str | Card, RunOptions]:
    """Return the env and the options under `RunKeywords`.

    If the keywords have scenes of one's own, they replace the scenes of the env. Raises
    UnknownNameError for other keywords, MtpBenchError for values that `RunOptions`
    refuses.
    """
    changes: dict[str, Any] = {}
    for name, value in keywords.items():
        require_known("keyword", name, RunKeywords.__annotations__)
        changes[name] = os.fspath(value) if isinstance(value, os.PathLike) else value
    if "jobs" in changes:
        jobs = _whole_number("jobs", changes.pop("jobs"))
        changes["workers"] = Workers(jobs or cores())
    if "seeds" in changes:
        changes["seeds"] = _seeds(changes["seeds"])
    if isinstance(changes.get("fold"), str):
        changes["fold"] = fold_of(changes["fold"])
    scenes = changes.get("scenes")
    if isinstance(scenes, SupportsIndex):
        changes["scenes"] = _whole_number("scenes", scenes)
    elif scenes is not None:
        changes["scenes"] = None
        changes["names"] = _scene_names(scenes)
        if isinstance(scenes[0], Scene):
            env = with_scenes(_loaded(env), scenes)
    return env, replace(options, **changes)


def _loaded(env: str | Card) -> Card:
    return env if isinstance(env, Card) else load_card(env)


def _seeds(value: object) -> Sequence[int]:
    """Return seeds: those of a list, or as many as a number says."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return value
    return range(_whole_number("seeds", value))


def _whole_number(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, SupportsIndex):
        raise MtpBenchError(f"{name} is {value!r}, expected a whole number")
    return operator.index(value)


def _scene_names(scenes: object) -> tuple[str, ...]:
    """Return the names of scenes: names themselves, or `Scene` objects."""
    if isinstance(scenes, str | Scene) or not isinstance(scenes, Sequence):
        raise MtpBenchError(
            f"scenes is {scenes!r}, expected a number of scenes, "
            "or a list of names or scenes"
        )
    if not scenes:
        raise MtpBenchError("scenes is an empty list, expected at least one scene")
    names: dict[str, None] = {}
    for scene in scenes:
        names[scene.name if isinstance(scene, Scene) else scene] = None
    return tuple(names)
