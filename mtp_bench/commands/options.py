"""Options shared by several commands, and dataclasses of options that expand to the options of a command."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, BadParameter, Option

from ..cards import Card
from ..core import (
    SUFFIXES,
    MtpBenchError,
    Workers,
    baseline_names,
    card_ids,
    closest,
    cores,
    require_cluster,
    require_file,
)
from ..running import RunOptions, fold_of
from .output import json_alone

SEEDS = 3  # default of commands that compare or submit
SeedsOption = Annotated[
    int, Option("--seeds", min=1, max=1000, help="Runs with different random draws.")
]


def env_ids(incomplete: str) -> list[str]:
    """Completions: ids of the shipped environments, and files of cards."""
    return _offered([*card_ids(), *_beside(incomplete, "*.toml")], incomplete)


def submissions(incomplete: str) -> list[str]:
    """Completions: names of the baselines, and folders of submissions."""
    own = [
        path.removesuffix("/submission.toml")
        for path in _beside(incomplete, "*/submission.toml")
    ]
    return _offered([*baseline_names(), *own], incomplete)


def detectors(incomplete: str) -> list[str]:
    """Completions: names of the shipped profiles and variants, and files of profiles."""
    from ..detector import profile_names

    return _offered(
        ["iid", "hard", *profile_names(), *_beside(incomplete, "*.toml")], incomplete
    )


def _beside(incomplete: str, pattern: str) -> list[str]:
    """Files of ``pattern`` in the folder that is being named."""
    folder = incomplete[: incomplete.rfind("/") + 1]
    return [
        f"{folder}{path.relative_to(folder)}"
        for path in sorted(Path(folder).glob(pattern))
    ]


def _offered(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def choice(known: Sequence[str], *names: str, text: str) -> Any:
    """An option whose values are ``known`` words, with completion; ``text``: its help."""

    def check(value: Any) -> Any:
        for word in [value] if isinstance(value, str) else value or ():
            one_of(word, known)
        return value

    return Option(
        *names,
        help=text,
        callback=check,
        autocompletion=lambda incomplete: _offered(known, incomplete),
    )


def one_of(value: str, known: Sequence[str], option: str | None = None) -> None:
    """Raise BadParameter unless ``value`` is one of ``known``."""
    if value not in known:
        close = closest(value, known)
        meant = f"; did you mean {close!r}?" if close else ""
        raise BadParameter(
            f"{value!r}, expected one of: {', '.join(known)}{meant}", param_hint=option
        )


def file_option(*names: str, text: str, suffixes: Sequence[str] = ()) -> Any:
    """An option that names a file to write: its suffix and its folder are checked before the work."""

    def check(path: Path | None) -> Path | None:
        if path is not None:
            if suffixes and path.suffix.lower() not in suffixes:
                raise BadParameter(
                    f"{path}: expected a name that ends in {' or '.join(suffixes)}"
                )
            require_file(path)
        return path

    return Option(*names, help=text, callback=check)


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
        suffixes=SUFFIXES,
        text="Write the table to this file: .csv or .json with all numbers, .md or .tex as it is shown. With --columns "
        "or --subsets all four hold these.",
    ),
]
EnvOption = Annotated[
    str,
    Option(
        "--env", help="Environment id, of `mtp-bench envs`.", autocompletion=env_ids
    ),
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
FolderArgument = Annotated[Path, Argument(help="Folder written by `mtp-bench run`.")]
TracksOption = Annotated[
    Path | None,
    Option(
        "--tracks",
        help="Stored tracks, for agents that observe them: a tracking submission of nuScenes (.json) or Argoverse 2 "
        "(.feather), or a folder of KITTI results (.txt) or tables (.csv, .parquet), one per scene.",
    ),
]
RunCardOption = Annotated[
    str | None,
    Option(
        "--env",
        help="Another card than the one that the run keeps.",
        autocompletion=env_ids,
    ),
]
SubmissionArgument = Annotated[
    str,
    Argument(
        help="Folder of a submission or name of a baseline.", autocompletion=submissions
    ),
]
BaseOption = Annotated[
    Path | None,
    Option(
        "--base",
        help="Leaderboard whose keys and seals are trusted. Default: the one that ships.",
    ),
]


@dataclass(frozen=True)
class WorkerChoice:
    """The workers of a command."""

    jobs: JobsOption = 0
    scheduler: Annotated[
        str | None,
        Option(
            help="Run on the workers of the Dask scheduler at this address, such as tcp://10.0.0.1:8786."
        ),
    ] = None

    def workers(self) -> Workers:
        """The workers; raises BadParameter for a scheduler without Dask, or none that answers."""
        try:
            workers = Workers(self.jobs or cores(), self.scheduler)
            if self.scheduler is not None:
                require_cluster(self.scheduler)  # before any other work
            return workers
        except MtpBenchError as error:
            raise BadParameter(str(error), param_hint="--scheduler") from None


@dataclass(frozen=True)
class EnvScenes:
    """Scenes of an environment, and changes to its card."""

    env: EnvOption
    data: DataOption = None
    scenes: ScenesOption = None
    split: SplitOption = None
    fold: Annotated[
        str | None,
        Option(
            help="A fold of the split, such as 1/4: only its scenes; `train` leaves them out."
        ),
    ] = None
    detector: Annotated[
        str | None,
        Option(
            help="Another detector. Simulated: a profile, iid, hard or a .toml file of a profile. "
            "Stored (nuScenes): the first part of its files' names.",
            autocompletion=detectors,
        ),
    ] = None
    detections: Annotated[
        Path | None,
        Option(
            help="Stored detections: a file as submitted to nuScenes or Argoverse 2; for KITTI a folder of text files."
        ),
    ] = None
    files: Annotated[
        Path | None, Option(help="Folder of own scenes, in place of the environment's.")
    ] = None

    def options(
        self, workers: WorkerChoice | None = None, seeds: Sequence[int] = (0,)
    ) -> RunOptions:
        """These scenes under ``seeds`` as options of a run."""
        file, files = absolute(self.detections), absolute(self.files)
        chosen = (workers or WorkerChoice()).workers()
        try:
            fold = None if self.fold is None else fold_of(self.fold)
        except MtpBenchError as error:
            raise BadParameter(str(error), param_hint="--fold") from None
        return RunOptions(
            self.data,
            self.scenes,
            seeds,
            self.split,
            self.detector,
            fold,
            file,
            workers=chosen,
            files=files,
        )


@dataclass(frozen=True)
class AgentScenes(EnvScenes):
    """Scenes that agents run on, which may get stored tracks, and may be those of a stored run."""

    env: Annotated[
        str,
        Option(
            "--env",
            help="Environment id, or a stored run: its scenes.",
            autocompletion=env_ids,
        ),
    ]
    tracks: TracksOption = None
    presence: Annotated[
        str | None,
        Option(
            help="How baselines state confidences: a file of `mtp-bench train presence`, or scores, which takes those "
            "of detections as they are."
        ),
    ] = None

    @cached_property
    def card(self) -> str | Card:
        """The env; for the folder of a run the card of its scenes, those of a closed loop as they were driven."""
        from ..running import open_run

        folder = Path(self.env)
        is_run = folder.is_dir() or (
            folder.name != self.env and folder.suffix != ".toml"
        )
        return open_run(folder, self.data).card if is_run else self.env

    def options(
        self, workers: WorkerChoice | None = None, seeds: Sequence[int] = (0,)
    ) -> RunOptions:
        """These scenes under ``seeds`` as options of a run, with the stored tracks and the presence model."""
        options = super().options(workers, seeds)
        return replace(
            options, track_file=absolute(self.tracks), presence=self.presence
        )


def opened(command: Callable[..., None]) -> Callable[..., None]:
    """``command`` for typer, with each parameter that is a dataclass of options replaced by its options."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], list[str]]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        own, kind = [parameter], parameter.annotation
        if is_dataclass(kind) and isinstance(kind, type):
            own = list(inspect.signature(kind, eval_str=True).parameters.values())
            groups[parameter.name] = kind, [option.name for option in own]
        parameters += [
            option.replace(kind=inspect.Parameter.KEYWORD_ONLY) for option in own
        ]

    @wraps(command)
    def call(**values: Any) -> None:
        for name, (group, names) in groups.items():
            values[name] = group(**{option: values.pop(option) for option in names})
        command(**values)

    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {
        parameter.name: parameter.annotation for parameter in parameters
    }
    return call


def absolute(path: Path | None) -> str | None:
    """An absolute path, valid from any working folder."""
    return None if path is None else str(path.expanduser().absolute())
