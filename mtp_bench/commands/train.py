"""``mtp-bench train``: fits of the parameters of baselines on training splits."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, Typer

from ..core import MtpBenchError, long_work, reported
from ..running import Fold, RunOptions
from .options import (
    EnvScenes,
    JobsOption,
    TextOption,
    WorkerChoice,
    choice,
    file_option,
    one_of,
    opened,
)
from .output import prepare, print_or_write, say, working

if TYPE_CHECKING:
    from ..cards import Card
    from ..training import TrainingRequest

_FRAMES = 2400  # of simulated traffic that is learnt from by default, as the weights that ship did at most
OBSERVE = ("detections", "truth")
ON = ("truth", "tracklets")
DEVICES = ("auto", "cpu", "cuda")


def motion_noise(
    on: EnvScenes,
    observe: Annotated[
        str, choice(OBSERVE, text="Pasts from detections, tracked, or from truth.")
    ] = "detections",
    jobs: JobsOption = 0,
    output: TextOption = None,
) -> None:
    """Fit the motion noise of the kinematic predictors on the training split of an environment (or another).

    The scenes of ``--fold`` are left out before ``--scenes`` takes the first ones.
    """
    from ..training import fit_env

    options, without = _learnt_from(on, jobs)
    prepare(on.env, options)
    with working("reading scenes, then fitting to them", options) as watched:
        text = fit_env(on.env, watched, observe, without)
    print_or_write(output, text)


def _learnt_from(on: EnvScenes, jobs: int) -> tuple[RunOptions, Fold | None]:
    """The options of a training, and the fold that it leaves out: another command scores its scenes."""
    options = on.options(WorkerChoice(jobs)).on_split("train")
    return replace(options, fold=None), options.fold


def predictor(
    network: Annotated[str, Argument(metavar="NAME", help="A network, such as modes.")],
    on: EnvScenes,
    pasts: Annotated[
        str | None,
        choice(
            ON,
            "--on",
            text="truth: ground-truth tracks. tracklets: tracks of a tracker. Default: as the network states.",
        ),
    ] = None,
    also: Annotated[
        list[str] | None,
        Option(help="Learn from this environment too; may be repeated."),
    ] = None,
    hypotheses: Annotated[
        int, Option(min=1, max=1000, help="Hypotheses of the tracker of the tracklets.")
    ] = 20,
    epochs: Annotated[
        int | None, Option(min=1, help="At most so many; default: by network.")
    ] = None,
    seed: Annotated[int, Option(min=0, help="Seed of all random numbers.")] = 0,
    device: Annotated[
        str, choice(DEVICES, text="auto (a GPU if there is one), cpu or cuda.")
    ] = "auto",
    jobs: JobsOption = 0,
    output: Annotated[
        Path | None,
        file_option(
            "-o",
            "--output",
            text="File of the weights; default: where agents look for them.",
        ),
    ] = None,
) -> None:
    """Train a predictor on the training split of an environment (or another).

    The scenes of ``--fold`` are left out before ``--scenes`` takes the first ones; by default 2400 frames of simulated
    traffic, and all scenes of recorded data.
    """
    with long_work("loading PyTorch"):
        from ..prediction import network_of, networks
        from ..training import TrainingPlan, TrainingRequest, device_of

    one_of(network, tuple(networks()), "NAME")
    recipe = network_of(network).recipe
    plan = TrainingPlan(epochs or recipe.epochs, seed=seed)
    options, without = _learnt_from(on, jobs)
    _require_place(output, options)
    request = TrainingRequest(
        network,
        on.env,
        pasts or recipe.on,
        hypotheses,
        without,
        tuple(also or ()),
        plan,
        device,
    )
    device_of(device)  # before the scenes are read
    cards = [options.card(env) for env in (on.env, *request.also)]
    options = _enough(options, cards[0])
    for env in (on.env, *request.also):
        prepare(env, options)
    path, card = _trained(request, options, output)
    away = (
        "" if card["fold"] is None else f", without the scenes of fold {card['fold']}"
    )
    print(
        f"{path}: validation minADE {card['validation_minADE']} m, epoch {card['best_epoch']} of {plan.epochs}{away}"
    )


def _enough(options: RunOptions, card: "Card") -> RunOptions:
    """The options, with as many scenes of simulated traffic as give `_FRAMES` frames unless they state a number."""
    seconds = card.source.traits.scene_seconds
    scenes = round(_FRAMES / (seconds * card.task.rate)) if seconds else None
    return replace(options, scenes=options.scenes or scenes)


def _trained(
    request: "TrainingRequest",
    options: RunOptions,
    output: Path | None = None,
    minutes: int | None = None,
) -> tuple[Path, dict[str, Any]]:
    """The file of weights of a training, and its card, with progress; ``minutes``: about how long it takes."""
    from ..training import train_predictor, training_windows

    found = training_windows(request, options)
    with reported(f"training {request.network}", 60 * (minutes or 0)) as progress:
        progress.started(request.chosen_plan.epochs)
        return train_predictor(
            found,
            request,
            output,
            lambda epoch, error: progress.done(f"minADE {error:.3f} m"),
        )


def train_missing(agents: Sequence[str], env: str, options: RunOptions) -> None:
    """Train the networks of ``agents`` that have no weights for an env, on its training split, the quickest first."""
    from ..agent import load_submission
    from ..core import states_of
    from ..training import TrainingRequest

    card = options.card(env)
    networks = dict.fromkeys(
        name for agent in agents for name in load_submission(agent).networks
    )
    missing = [
        state
        for state in states_of(networks, card.id, card.weights_of)
        if state.missing
    ]
    if not missing:
        return
    missing.sort(key=lambda state: state.minutes or 0)
    total = sum(state.minutes or 0 for state in missing)
    say(
        f"training {', '.join(state.network for state in missing)} first: about {total} min on two cores"
    )
    learnt_from = _enough(
        RunOptions(options.data, split="train", workers=options.workers), card
    )
    for state in missing:
        network, on = state.network.rsplit("-", 1)
        source = env if state.env_id == card.id else state.env_id
        prepare(source, learnt_from)
        path, _ = _trained(
            TrainingRequest(network, source, on), learnt_from, minutes=state.minutes
        )
        say(f"{state.network}: {path}")


def _require_place(output: Path | None, options: RunOptions) -> None:
    """Refuse to put weights of other data than the training split where every run of the env finds them."""
    changes = {
        "--detections": options.detection_file,
        "--detector": options.detector,
        "--files": options.files,
    }
    other = next(
        (name for name, given in changes.items() if given is not None),
        f"--split {options.split}",
    )
    if output is None and other != "--split train":
        raise MtpBenchError(
            f"{other}: without -o the weights would be those of every run of this env, expected a file of their own; "
            'an agent takes it as its parameter "weights"'
        )


def presence(on: EnvScenes, output: TextOption = None) -> None:
    """Fit the probability that a track's object is there to detections of your own: scenes of --files, or a split.

    Without ``--files`` and ``--split`` these are the training scenes; those of ``--fold`` are left out. Agents take the
    file as ``--presence``.
    """
    from ..training import fit_split, open_split

    options = on.options()
    options = options if on.files is not None else options.on_split("train")
    prepare(on.env, options)
    with working("reading scenes, then fitting to them", options) as watched:
        text, quality = fit_split(
            open_split(on.env, replace(watched, fold=None), watched.fold)
        )
    print_or_write(output, text)
    if output is not None:
        brier = ", ".join(
            f"{row['brier']:.3f} of {name}" for name, row in quality.items()
        )
        print(
            f"{output}: {quality['presence']['rows']} boxes of tracks; Brier score on those held out: {brier}"
        )


train = Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Fit predictors and more.",
)
train.command("motion-noise")(opened(motion_noise))
train.command("predictor")(opened(predictor))
train.command("presence")(opened(presence))
