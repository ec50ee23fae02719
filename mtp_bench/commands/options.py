"""Options shared by several commands, and dataclasses of options that expand to the options of a command."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from ..errors import MtpBenchError, closest
from ..parallel import Workers, cores
from .completion import detectors, env_ids, submissions
from .output import json_alone, table_file

if TYPE_CHECKING:
    from ..running.options import RunOptions

SEVERAL = {"run": "`mtp-bench compare` takes several agents"}  # command -> advice for too many arguments
DataOption = Annotated[
    str | None, typer.Option("--data", help="Data root; else MTP_BENCH_DATA, else the user data folder.")
]
JsonOption = Annotated[
    Path | None,
    typer.Option("--json", callback=json_alone, help="Write the table's content to this file; -: print it instead."),
]
TableOption = Annotated[
    Path | None,
    typer.Option(
        "--table",
        callback=table_file,
        help="Write the table to this file: .csv or .json with all numbers, .md or .tex as it is shown.",
    ),
]
FullOption = Annotated[bool, typer.Option("--full", help="All tables, not only the first.")]
EnvOption = Annotated[
    str, typer.Option("--env", help="Environment id; `mtp-bench envs` lists them.", autocompletion=env_ids)
]
JobsOption = Annotated[int, typer.Option("--jobs", min=0, help="Processes; 0 takes one per core.")]
ScenesOption = Annotated[int | None, typer.Option("--scenes", min=1, help="Only the first N scenes.")]
SplitOption = Annotated[
    str | None, typer.Option("--split", help="Another split of the environment, such as train or val.")
]
TextOption = Annotated[Path | None, typer.Option("-o", "--output", help="Write here instead of printing.")]
FolderArgument = Annotated[Path, typer.Argument(help="Folder written by `mtp-bench run`.")]
SEEDS = 3  # default of commands that compare or submit
TracksOption = Annotated[
    Path | None,
    typer.Option(
        "--tracks",
        help="Stored tracks, for agents that observe them: a nuScenes tracking submission (.json), or a folder of "
        "KITTI results (.txt) or tables (.csv, .parquet), one per scene.",
    ),
]
RunCardOption = Annotated[
    str | None, typer.Option("--env", help="Another card than the one that the run keeps.", autocompletion=env_ids)
]
SubmissionArgument = Annotated[
    str, typer.Argument(help="Folder of a submission or name of a baseline.", autocompletion=submissions)
]


@dataclass(frozen=True)
class EnvScenes:
    """Scenes of an environment, and changes to its card."""

    env: EnvOption
    data: DataOption = None
    scenes: ScenesOption = None
    split: SplitOption = None
    fold: Annotated[
        str | None, typer.Option(help="A fold of the split, such as 1/4: only its scenes; `train` leaves them out.")
    ] = None
    detector: Annotated[
        str | None,
        typer.Option(
            help="Another detector. Simulated: a profile, iid, hard or a .toml file of a profile. "
            "Stored (nuScenes): the first part of its files' names.",
            autocompletion=detectors,
        ),
    ] = None
    detections: Annotated[
        Path | None,
        typer.Option(help="Stored detections: a file as submitted to nuScenes; for KITTI a folder of text files."),
    ] = None
    tracks: TracksOption = None
    files: Annotated[Path | None, typer.Option(help="Folder of scenes of your own, in place of the environment's.")] = (
        None
    )

    def options(self, workers: WorkerChoice | None = None, seeds: Sequence[int] = (0,)) -> RunOptions:
        """These scenes under ``seeds`` as options of a run."""
        from ..running.options import RunOptions, fold_of

        file, tracks, files = absolute(self.detections), absolute(self.tracks), absolute(self.files)
        chosen = (workers or WorkerChoice()).workers()
        try:
            fold = None if self.fold is None else fold_of(self.fold)
        except MtpBenchError as error:
            raise typer.BadParameter(str(error), param_hint="--fold") from None
        return RunOptions(
            self.data, self.scenes, seeds, self.split, self.detector, fold, file, tracks, chosen, files=files
        )


@dataclass(frozen=True)
class WorkerChoice:
    """The workers of a command."""

    jobs: JobsOption = 0
    scheduler: Annotated[
        str | None,
        typer.Option(help="Run on the workers of the Dask scheduler at this address, such as tcp://10.0.0.1:8786."),
    ] = None

    def workers(self) -> Workers:
        """The workers; raises BadParameter for a scheduler without Dask."""
        try:
            return Workers(self.jobs or cores(), self.scheduler)
        except MtpBenchError as error:
            raise typer.BadParameter(str(error), param_hint="--scheduler") from None


class Command(TyperCommand):
    """A command that says what to do about too many arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse ``args``; fails for too many of them."""
        ctx.allow_extra_args = ctx.info_name in SEVERAL
        extra = super().parse_args(ctx, args)
        if extra and not ctx.resilient_parsing:
            ctx.fail(f"unexpected {', '.join(map(repr, extra))}: {SEVERAL[ctx.info_name]}")
        return extra


def opened(command: Callable[..., None]) -> Callable[..., None]:
    """``command`` for typer, with each parameter that is a dataclass of options replaced by its options."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], list[str]]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        own, kind = [parameter], parameter.annotation
        if is_dataclass(kind) and isinstance(kind, type):
            own = list(inspect.signature(kind, eval_str=True).parameters.values())
            groups[parameter.name] = kind, [option.name for option in own]
        parameters += [option.replace(kind=inspect.Parameter.KEYWORD_ONLY) for option in own]

    @wraps(command)
    def call(**values: Any) -> None:
        for name, (group, names) in groups.items():
            values[name] = group(**{option: values.pop(option) for option in names})
        command(**values)

    call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    call.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return call


def require_no_tracks(on: EnvScenes) -> None:
    """Raise BadParameter for stored tracks in a command that does not read them."""
    if on.tracks is not None:
        raise typer.BadParameter("this command does not learn from stored tracks: leave it out", param_hint="--tracks")


def absolute(path: Path | None) -> str | None:
    """An absolute path, valid from any working folder."""
    return None if path is None else str(path.expanduser().absolute())


def one_of(value: str, known: Sequence[str], option: str) -> None:
    """Raise BadParameter unless ``value`` is one of ``known``."""
    if value not in known:
        close = closest(value, known)
        meant = f"; did you mean {close!r}?" if close else ""
        raise typer.BadParameter(f"{value!r}, expected one of: {', '.join(known)}{meant}", param_hint=option)
