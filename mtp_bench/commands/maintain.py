"""``mtp-bench maintain``: commands of the maintainers."""

import shlex
from pathlib import Path
from typing import Annotated

from typer import Argument, BadParameter, Option, Typer

from ..core import RecordError, long_work
from ..judge import (
    COMMITMENT,
    LEAST_HIDDEN,
    SEALS,
    retire as retire_seal,
    seal as make_seal,
    seal_path,
    take_in,
    trusted,
)
from ..running import RunOptions, freeze as write
from ..scoring import Reference
from ..viz import counted, show
from .options import (
    BaseOption,
    DataOption,
    EnvOption,
    JobsOption,
    JsonOption,
    TextOption,
    WorkerChoice,
)
from .output import prepare, print_or_write, some_of, write_json

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
            help="File of the secret; its commitment goes beside it. "
            "With --retire: folder.",
        ),
    ] = None,
    retire: Annotated[
        Path | None,
        Option(
            help="Publish this secret in the folder of seals: it ranks no further "
            "submission."
        ),
    ] = None,
) -> None:
    """Draw secret scenes of a simulated environment, or publish a secret.

    Drawing them also commits to them.
    """
    if retire is not None:
        if env is not None or scenes is not None:
            raise BadParameter(
                "publishes a secret: leave --env and --count out", param_hint="--retire"
            )
        path = retire_seal(retire, output or SEALS)
        show(
            f"{path}: the secret is public from now on; "
            "draw another seal for the next round"
        )
        return
    if env is None or scenes is None or output is None:
        raise BadParameter("--env, --count and --output are needed, or --retire")
    promise = make_seal(env, scenes, output)
    show(
        f"{seal_path(output, COMMITMENT)}: publish this commitment to "
        f"{counted(scenes, 'hidden scene')} of {promise.env} in leaderboard/seals, "
        f"sha256 {promise.commitment}"
    )
    if scenes < LEAST_HIDDEN:
        show(
            f"for trials alone: {counted(scenes, 'scene')} are too few to rank, "
            f"ranks need {LEAST_HIDDEN}"
        )
    word = shlex.quote(str(output))
    show(
        f"{output}: keep this secret; "
        f"`mtp-bench verify RECORD --rerun --hidden {word}` runs them"
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

    with long_work("reading scenes, then fitting to them") as progress:
        text = fit_detector(detector, RunOptions(root, progress=progress))
    print_or_write(output, text)


@maintain.command()
def freeze(env: EnvOption, root: DataOption = None, jobs: JobsOption = 0) -> None:
    """Write the frozen event weights of a shipped environment."""
    options = RunOptions(root, workers=WorkerChoice(jobs).workers())
    prepare(env, options)
    path, reference = write(env, options)
    show(f"{path}: {_summary(reference)}; hash {reference.digest}")


def _summary(reference: Reference) -> str:
    """Return the totals of weights, or of a closed loop's drives."""
    ways = [scene.way for scene in reference.scenes.values() if scene.way is not None]
    if ways:
        mean_m = sum(ways) / len(ways)
        drives = counted(len(ways), "way")
        return f"{drives} with ground-truth tracks, {mean_m:.1f} m on average"
    weights = reference.totals["sum_of_weights"]
    totals = ", ".join(
        f"{subset_name} {total}" for subset_name, total in weights.items()
    )
    targets = counted(reference.totals["targets"], "target")
    return f"{targets}, sum of weights {totals}"


@maintain.command(short_help="Check the records of a pull request.")
def intake(
    leaderboard: Annotated[
        Path, Argument(help="Folder leaderboard that a pull request proposes.")
    ],
    owner: Annotated[str, Option(help="Login of its author.")],
    base: BaseOption = None,
    json_file: JsonOption = None,
) -> None:
    """Check the records and names of a pull request.

    No code of a submission is run.
    """
    trust = trusted(base)
    outcome = take_in(leaderboard, trust, owner)
    accepted = list(map(str, outcome.accepted))
    refused = list(outcome.refused)
    write_json(json_file, {"accepted": accepted, "refused": refused})
    for path in accepted:
        show(f"{path}: can be taken in")
    for note in outcome.notes:
        show(note)
    if refused:
        raise RecordError(some_of(refused))
    if not accepted:
        show(f"no record to take in: all are as in {trust.folder}")
