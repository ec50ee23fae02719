"""``mtp-bench maintain``: commands of the maintainers of the leaderboard and of the environments."""

import shlex
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option, Typer

from ..core import RecordError
from ..judge import (
    COMMITMENT,
    LEAST_HIDDEN,
    SEALS,
    beside,
    retire as retire_seal,
    seal as make_seal,
    take_in,
    trusted,
)
from ..running import RunOptions, freeze as write
from ..viz import counted, show
from .options import (
    BaseOption,
    DataOption,
    EnvOption,
    EnvScenes,
    JobsOption,
    JsonOption,
    TextOption,
    WorkerChoice,
)
from .output import prepare, print_or_write, some_of, working, write_json

maintain = Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Commands of the maintainers.",
)


@maintain.command(short_help="Draw secret scenes, or publish a secret.")
def seal(
    env: Annotated[
        str | None, Option(help="Environment id, or path of a card.")
    ] = None,
    scenes: Annotated[
        int | None,
        Option(
            "--count", min=1, max=1000, help="Number of hidden scenes; ranks need 50."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            help="File of the secret, beside its commitment. With --retire: folder.",
        ),
    ] = None,
    retire: Annotated[
        Path | None,
        Option(
            help="Publish this secret in the folder of seals: it ranks no further submission."
        ),
    ] = None,
) -> None:
    """Draw secret scenes of a simulated environment and commit to them, or publish a secret."""
    if retire is not None:
        if env is not None or scenes is not None:
            raise BadParameter(
                "publishes a secret: leave --env and --count out", param_hint="--retire"
            )
        path = retire_seal(retire, output or SEALS)
        show(
            f"{path}: the secret is public from now on; draw another seal for the next round"
        )
        return
    if env is None or scenes is None or output is None:
        raise BadParameter("--env, --count and --output are needed, or --retire")
    promise, public = make_seal(env, scenes, output), beside(output, COMMITMENT)
    to = f"{counted(scenes, 'hidden scene')} of {promise.env}"
    show(
        f"{public}: publish this commitment to {to} in leaderboard/seals, sha256 {promise.commitment}"
    )
    if scenes < LEAST_HIDDEN:
        show(
            f"for trials alone: {counted(scenes, 'scene')} are too few to rank, ranks need {LEAST_HIDDEN}"
        )
    show(
        f"{output}: keep this secret; `mtp-bench verify RECORD --rerun --hidden {shlex.quote(str(output))}` runs them"
    )


@maintain.command()
def presence(
    detector: Annotated[
        str, Argument(help="A detector with a file in mtp_bench/tracking/detectors.")
    ],
    root: DataOption = None,
    output: TextOption = None,
) -> None:
    """Fit the presence model of a detector that ships, on its training scenes."""
    from ..training import fit_detector

    with working("reading scenes, then fitting to them", RunOptions(root)) as watched:
        text = fit_detector(detector, watched)
    print_or_write(output, text)


@maintain.command()
def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen event weights of a shipped environment."""
    options = EnvScenes(env, root).options(WorkerChoice(jobs))
    prepare(env, options)
    path, reference = write(env, options)
    totals = ", ".join(
        f"{name} {total}" for name, total in reference.totals["sum_of_weights"].items()
    )
    what = f"{counted(reference.totals['targets'], 'target')}, sum of weights {totals}"
    if ways := [
        scene.way for scene in reference.scenes.values() if scene.way is not None
    ]:
        what = f"{counted(len(ways), 'way')} with ground-truth tracks, {sum(ways) / len(ways):.1f} m on average"
    show(f"{path}: {what}; hash {reference.digest}")


@maintain.command(short_help="Check the records of a pull request.")
def intake(
    leaderboard: Annotated[
        Path, Argument(help="Folder leaderboard that a pull request proposes.")
    ],
    owner: Annotated[str, Option(help="Login of its author.")],
    base: BaseOption = None,
    json_file: JsonOption = None,
) -> None:
    """Check the records and names of a pull request; no code of a submission is run."""
    trust = trusted(base)
    outcome = take_in(leaderboard, trust, owner)
    write_json(
        json_file,
        {
            "accepted": list(map(str, outcome.accepted)),
            "refused": list(outcome.refused),
        },
    )
    for text in (
        *(f"{path}: can be taken in" for path in outcome.accepted),
        *outcome.notes,
    ):
        show(text)
    if outcome.refused:
        raise RecordError(some_of(outcome.refused))
    if not outcome.accepted:
        show(f"no record to take in: all are as in {trust.folder}")
