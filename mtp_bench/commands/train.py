"""``mtp-bench train`` and ``fit-noise``: fits of parameters on training splits."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, Typer

from ..core import MtpBenchError, long_work
from ..running import Fold, RunOptions
from .options import (
    EnvScenes,
    JobsOption,
    TextOption,
    WorkerChoice,
    choice,
    file_option,
    one_of,
    with_expanded_options,
)
from .output import prepare, print_or_write, say

if TYPE_CHECKING:
    from ..cards import Card
    from ..training import TrainingRequest

# Frames of simulated traffic that are learnt from by default, as the weights that ship
# did at most.
_SIMULATED_FRAMES = 2400
OBSERVE = ("detections", "truth")
ON = ("truth", "tracklets")
DEVICES = ("auto", "cpu", "cuda")
_HYPOTHESES = Option(
    min=1, max=1000, help="Hypotheses of the tracker of the tracklets."
)
_EPOCHS = Option(min=1, help="At most so many; default: by network.")
_DEVICE = choice(DEVICES, text="auto (a GPU if there is one), cpu or cuda.")
_WEIGHTS = file_option(
    "-o", "--output", text="File of the weights; default: where agents look for them."
)


def motion_noise(
    on: EnvScenes,
    observe: Annotated[
        str, choice(OBSERVE, text="Pasts from detections, tracked, or from truth.")
    ] = "detections",
    jobs: JobsOption = 0,
    output: TextOption = None,
) -> None:
    """Fit the motion noise of the kinematic predictors on the training split.

    ``--split`` names another one. The scenes of ``--fold`` are left out before
    ``--scenes`` takes the first ones.
    """
    from ..training import fit_env

    options, left_out = _training_options(on, jobs)
    prepare(on.env, options)
    with long_work("reading scenes, then fitting to them") as progress:
        options = replace(options, progress=progress)
        text = fit_env(on.env, options, observe, left_out)
    print_or_write(output, text)


def _training_options(on: EnvScenes, jobs: int) -> tuple[RunOptions, Fold | None]:
    """Return the options of a training, and the fold that it leaves out.

    Another command scores the scenes of the fold.
    """
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
            text="truth: ground-truth tracks. tracklets: tracks of a tracker. "
            "Default: as the network states.",
        ),
    ] = None,
    also: Annotated[
        list[str] | None,
        Option(help="Learn from this environment too; may be repeated."),
    ] = None,
    hypotheses: Annotated[int, _HYPOTHESES] = 20,
    epochs: Annotated[int | None, _EPOCHS] = None,
    seed: Annotated[int, Option(min=0, help="Seed of all random numbers.")] = 0,
    device: Annotated[str, _DEVICE] = "auto",
    jobs: JobsOption = 0,
    output: Annotated[Path | None, _WEIGHTS] = None,
) -> None:
    """Train a predictor on the training split of an environment.

    ``--split`` names another one. The scenes of ``--fold`` are left out before
    ``--scenes`` takes the first ones; by default 2400 frames of simulated traffic, and
    all scenes of recorded data.
    """
    with long_work("loading PyTorch"):
        from ..prediction import network_of, networks
        from ..training import TrainingPlan, TrainingRequest, device_of

    one_of(network, tuple(networks()), "NAME")
    recipe = network_of(network).recipe
    plan = TrainingPlan(epochs or recipe.epochs, seed=seed)
    options, left_out = _training_options(on, jobs)
    if output is None:
        _require_default_data(options)
    request = TrainingRequest(
        network,
        on.env,
        pasts or recipe.on,
        hypotheses,
        left_out,
        tuple(also or ()),
        plan,
        device,
    )
    device_of(device)  # raises before the scenes are read
    env_ids = (on.env, *request.also)
    cards = [options.card(env_id) for env_id in env_ids]
    options = _with_default_scenes(options, cards[0])
    for env_id in env_ids:
        prepare(env_id, options)
    path, weights_card = _train(request, options, output)
    note = ""
    if weights_card["fold"] is not None:
        note = f", without the scenes of fold {weights_card['fold']}"
    print(
        f"{path}: validation minADE {weights_card['validation_minADE']} m, "
        f"epoch {weights_card['best_epoch']} of {plan.epochs}{note}"
    )


def _with_default_scenes(options: RunOptions, card: "Card") -> RunOptions:
    """Return the options with the default number of scenes of simulated traffic."""
    seconds = card.source.traits.scene_seconds
    if options.scenes is not None or not seconds:
        return options
    scenes = round(_SIMULATED_FRAMES / (seconds * card.task.rate))
    return replace(options, scenes=scenes)


def _train(
    request: "TrainingRequest",
    options: RunOptions,
    output: Path | None = None,
    minutes: int = 0,
) -> tuple[Path, dict[str, Any]]:
    """Train, and return the file of weights and the description in it.

    ``minutes``: about how long it takes; 0: not known.
    """
    from ..training import train_predictor, training_windows

    windows = training_windows(request, options)
    with long_work(f"training {request.network}", 60 * minutes) as progress:
        progress.started(request.chosen_plan.epochs)

        def end_epoch(_: int, min_ade: float) -> None:
            progress.done(f"minADE {min_ade:.3f} m")

        return train_predictor(windows, request, output, end_epoch)


def train_missing(agents: Sequence[str], env: str, options: RunOptions) -> None:
    """Train the networks of ``agents`` that have no weights for an env.

    They learn from its training split, the quickest first.
    """
    from ..agent import load_submission
    from ..core import states_of
    from ..training import TrainingRequest

    card = options.card(env)
    network_names: dict[str, None] = {}
    for agent in agents:
        network_names |= dict.fromkeys(load_submission(agent).networks)
    states = states_of(network_names, card.id, card.weights_of)
    minutes = {state: state.minutes or 0 for state in states if state.missing}
    if not minutes:
        return
    missing = sorted(minutes, key=minutes.__getitem__)
    networks = ", ".join(state.network for state in missing)
    say(f"training {networks} first: about {sum(minutes.values())} min on two cores")
    training = RunOptions(options.data, split="train", workers=options.workers)
    training = _with_default_scenes(training, card)
    for state in missing:
        network_name, pasts = state.network.rsplit("-", 1)
        source = env if state.env_id == card.id else state.env_id
        prepare(source, training)
        request = TrainingRequest(network_name, source, pasts)
        path, _ = _train(request, training, minutes=minutes[state])
        say(f"{state.network}: {path}")


def _require_default_data(options: RunOptions) -> None:
    """Raise MtpBenchError for other data than the training split of the env.

    Weights without a file of their own are found by every run of the env.
    """
    changes = {
        "--detections": options.detections,
        "--detector": options.detector,
        "--files": options.files,
        "--perturb": options.perturb,
        f"--split {options.split}": None if options.split == "train" else options.split,
    }
    for option, value in changes.items():
        if value is not None:
            raise MtpBenchError(
                f"{option}: without -o the weights would be those of every run of this "
                "env, expected a file of their own; an agent takes it as its parameter "
                '"weights"'
            )


def presence(on: EnvScenes, output: TextOption = None) -> None:
    """Fit the probability that a track's object is there to your own detections.

    The scenes are those of ``--files`` or ``--split``, else the training scenes; those
    of ``--fold`` are left out. Agents take the file as ``--presence``.
    """
    from ..training import fit_split, open_split

    options = on.options()
    if on.files is None:
        options = options.on_split("train")
    prepare(on.env, options)
    with long_work("reading scenes, then fitting to them") as progress:
        left_out = options.fold
        options = replace(options, fold=None, progress=progress)
        text, quality = fit_split(open_split(on.env, options, left_out))
    print_or_write(output, text)
    if output is not None:
        scores = [
            f"{row['brier']:.3f} of {model_name}" for model_name, row in quality.items()
        ]
        print(
            f"{output}: {quality['presence']['rows']} boxes of tracks; "
            f"Brier score on those held out: {', '.join(scores)}"
        )


train = Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    help="Fit predictors and more.",
)
train.command("motion-noise")(with_expanded_options(motion_noise))
train.command("predictor")(with_expanded_options(predictor))
train.command("presence")(with_expanded_options(presence))


def fit_noise(
    on: EnvScenes,
    min_score: Annotated[
        list[str] | None,
        Option(help="Operating point: a number, or class=number; repeatable."),
    ] = None,
    alike: Annotated[
        list[str] | None, Option(help="bus=car: fit both classes together; repeatable.")
    ] = None,
    name: Annotated[
        str | None,
        Option(
            help="Name of the profile; agents use the settings of its part before "
            "the first hyphen."
        ),
    ] = None,
    reach: Annotated[
        float | None, Option(min=1, max=1000, help="Reach of the detector, metres.")
    ] = None,
    field_of_view: Annotated[
        float | None, Option(min=1, max=360, help="Degrees around the heading.")
    ] = None,
    output: TextOption = None,
) -> None:
    """Fit the noise of a simulated detector to the detections of an environment.

    The output is a section of a card.
    """
    from ..training import fit_noise as fit

    options = on.options()
    prepare(on.env, options)
    with long_work("reading scenes, then fitting the noise") as progress:
        options = replace(options, progress=progress)
        text = fit(
            on.env, options, min_score or (), alike or (), name, reach, field_of_view
        )
    print_or_write(output, text)
