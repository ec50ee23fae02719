"""Options that several commands share.

A parameter of a command that is a dataclass of options expands to these options.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from ..cards import Card
from ..core import (
    TABLE_SUFFIXES,
    MtpBenchError,
    Workers,
    closest,
    cores,
    require_cluster,
    require_file,
)
from ..running import RunOptions, fold_of
from .output import json_alone

SEEDS = 3  # default of commands that compare or submit


def choice(words: Sequence[str], *names: str, text: str) -> Any:
    """Return an option that takes one of ``words``, or several; ``text``: its help."""

    def check(value: Any) -> Any:
        for word in [value] if isinstance(value, str) else value or ():
            one_of(word, words)
        return value

    return Option(*names, help=text, callback=check)


def one_of(value: str, words: Sequence[str], option: str | None = None) -> None:
    """Raise BadParameter unless ``value`` is one of ``words``."""
    if value not in words:
        message = f"{value!r}, expected one of: {', '.join(words)}"
        if nearest := closest(value, words):
            message += f"; did you mean {nearest!r}?"
        raise BadParameter(message, param_hint=option)


def file_option(*names: str, text: str, suffixes: Sequence[str] = ()) -> Any:
    """Return an option that names a file to write.

    Its suffix and its folder are checked before the work.
    """

    def check(path: Path | None) -> Path | None:
        if path is None:
            return None
        if suffixes and path.suffix.lower() not in suffixes:
            raise BadParameter(
                f"{path}: expected a name that ends in {' or '.join(suffixes)}"
            )
        require_file(path)
        return path

    return Option(*names, help=text, callback=check)


SeedsOption = Annotated[
    int, Option("--seeds", min=1, max=1000, help="Runs with different random draws.")
]
DataOption = Annotated[
    str | None,
    Option("--data", help="Data root; else MTP_BENCH_DATA, or the user's folder."),
]
JsonOption = Annotated[
    Path | None,
    Option(
        "--json",
        callback=json_alone,
        help="Write the table's content to this file; -: print it instead.",
    ),
]
TableOption = Annotated[
    Path | None,
    file_option(
        "--table",
        suffixes=TABLE_SUFFIXES,
        text="Write the table to this file: .csv or .json with all numbers, .md or "
        ".tex as it is shown.",
    ),
]
EnvOption = Annotated[
    str,
    Option("--env", help="Environment id, of `mtp-bench envs`."),
]
JobsOption = Annotated[
    int, Option("--jobs", min=0, help="Processes; 0 takes one per core.")
]
ScenesOption = Annotated[
    int | None, Option("--scenes", min=1, help="Only the first N scenes.")
]
SplitOption = Annotated[
    str | None,
    Option("--split", help="Another split of the environment, such as train."),
]
TextOption = Annotated[
    Path | None, file_option("-o", "--output", text="Write here instead of printing.")
]
FolderArgument = Annotated[Path, Argument(help="Folder of a stored run.")]
TracksOption = Annotated[
    list[Path] | None,
    Option(
        "--tracks",
        help="Stored tracks, for agents that observe them: a tracking submission of "
        "nuScenes (.json) or Argoverse 2 (.feather), or a folder of KITTI results "
        "(.txt) or tables (.csv, .parquet), one per scene. `compare` takes several.",
    ),
]
NoDoctorOption = Annotated[bool, Option("--no-doctor", help="Do not examine the data.")]
SubmissionArgument = Annotated[
    str,
    Argument(help="Folder of a submission or name of a baseline."),
]
BaseOption = Annotated[
    Path | None,
    Option(
        "--base",
        help="Leaderboard whose keys and seals are trusted. "
        "Default: the one that ships.",
    ),
]


@dataclass(frozen=True)
class WorkerChoice:
    """Workers of a command."""

    jobs: JobsOption = 0
    scheduler: Annotated[
        str | None,
        Option(
            help="Run on the workers of the Dask scheduler at this address, "
            "such as tcp://10.0.0.1:8786."
        ),
    ] = None

    def workers(self) -> Workers:
        """Return the workers.

        Raises BadParameter for a scheduler without Dask, or none that answers.
        """
        try:
            workers = Workers(self.jobs or cores(), self.scheduler)
            if self.scheduler is not None:
                require_cluster(self.scheduler)  # before any other work
        except MtpBenchError as error:
            raise BadParameter(str(error), param_hint="--scheduler") from None
        return workers


@dataclass(frozen=True)
class EnvScenes:
    """Scenes of an environment, and changes of its card."""

    env: EnvOption
    data: DataOption = None
    scenes: ScenesOption = None
    split: SplitOption = None
    fold: Annotated[
        str | None,
        Option(
            help="A fold of the split, such as 1/4: only its scenes; "
            "`train` leaves them out."
        ),
    ] = None
    detector: Annotated[
        str | None,
        Option(
            help="Another detector. Simulated: a profile, iid or a .toml file of "
            "a profile. Stored (nuScenes): the first part of its files' names."
        ),
    ] = None
    detections: Annotated[
        list[Path] | None,
        Option(
            help="Stored detections: a file as submitted to nuScenes or Argoverse 2; "
            "for KITTI a folder of text files. `compare` takes several."
        ),
    ] = None
    files: Annotated[
        Path | None, Option(help="Folder of own scenes, in place of the environment's.")
    ] = None
    perturb: Annotated[
        str | None,
        Option(
            help="Other errors of the detector, such as noise=2,misses=4. Knobs: score, "
            "misses, false, noise, delay, seed."
        ),
    ] = None

    def options(
        self, workers: WorkerChoice | None = None, seeds: Sequence[int] = (0,)
    ) -> RunOptions:
        """Return these scenes under ``seeds`` as options of a run."""
        try:
            fold = None if self.fold is None else fold_of(self.fold)
        except MtpBenchError as error:
            raise BadParameter(str(error), param_hint="--fold") from None
        return RunOptions(
            self.data,
            self.scenes,
            seeds,
            fold,
            split=self.split,
            detector=self.detector,
            detections=only_path(self.detections, "--detections"),
            files=absolute(self.files),
            perturb=None if self.perturb is None else levels_of(self.perturb),
            workers=(workers or WorkerChoice()).workers(),
        )


@dataclass(frozen=True)
class AgentScenes(EnvScenes):
    """Scenes that agents run on, which may be those of a stored run."""

    env: Annotated[
        str,
        Option("--env", help="Environment id, or a stored run: its scenes."),
    ]
    tracks: TracksOption = None
    presence: Annotated[
        str | None,
        Option(
            help="How baselines state confidences: a file of `mtp-bench train presence`"
            ", or scores, which takes those of detections as they are."
        ),
    ] = None
    no_doctor: NoDoctorOption = False

    @cached_property
    def card(self) -> str | Card:
        """The env.

        For the folder of a run it is the card of its scenes. The scenes of a closed
        loop are as the agent drove them.
        """
        from ..running import open_run

        folder = Path(self.env)
        # the path of a missing folder is one too, so that `open_run` says so
        is_path = folder.name != self.env and folder.suffix != ".toml"
        if folder.is_dir() or is_path:
            return open_run(folder, self.data).card
        return self.env

    def options(
        self, workers: WorkerChoice | None = None, seeds: Sequence[int] = (0,)
    ) -> RunOptions:
        """Return these scenes, with stored tracks and presence model, as options."""
        options = super().options(workers, seeds)
        tracks = only_path(self.tracks, "--tracks")
        return replace(options, tracks=tracks, presence=self.presence)


def with_expanded_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return ``command`` for typer, with its dataclasses of options expanded.

    typer sees a parameter per field, and the command gets the dataclasses again.
    """
    expanded: list[inspect.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], list[str]]] = {}
    for parameter in _parameters(command):
        options = [parameter]
        group = parameter.annotation
        if is_dataclass(group) and isinstance(group, type):
            options = _parameters(group)
            groups[parameter.name] = group, [option.name for option in options]
        expanded += options

    @wraps(command)
    def call(**values: Any) -> None:
        for group_name, (group, option_names) in groups.items():
            values[group_name] = group(
                **{option: values.pop(option) for option in option_names}
            )
        command(**values)

    call.__annotations__ = {}
    keyword_only = []
    for option in expanded:
        call.__annotations__[option.name] = option.annotation
        keyword_only.append(option.replace(kind=option.KEYWORD_ONLY))
    call.__signature__ = inspect.Signature(keyword_only)  # type: ignore[attr-defined]
    return call


def _parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    return list(inspect.signature(function, eval_str=True).parameters.values())


def levels_of(text: str) -> dict[str, float]:
    """Return levels by knob, of a text such as "noise=2,misses=4"."""
    levels = {}
    for part in text.split(","):
        knob, _, level = part.partition("=")
        try:
            levels[knob.strip()] = int(level) if level.isdecimal() else float(level)
        except ValueError:
            raise BadParameter(
                f"{part!r}, expected knob=number", param_hint="--perturb"
            ) from None
    return levels


def absolute(path: Path | None) -> str | None:
    """Return an absolute path, valid from any working folder."""
    return None if path is None else str(path.expanduser().absolute())


def only_path(paths: Sequence[Path] | None, option: str) -> str | None:
    """Return the only path, absolute.

    None without one. Raises BadParameter for several.
    """
    if paths is not None and len(paths) > 1:
        raise BadParameter("got several, expected one", param_hint=option)
    return absolute(paths[0]) if paths else None
