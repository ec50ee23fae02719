"""``mtp-bench fit-noise``."""

from dataclasses import replace
from typing import Annotated

from typer import Option

from ..core import long_work
from ..training import fit_noise as fit
from .options import EnvScenes, TextOption
from .output import prepare, print_or_write


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
    options = on.options()
    prepare(on.env, options)
    with long_work("reading scenes, then fitting the noise") as progress:
        options = replace(options, progress=progress)
        text = fit(
            on.env, options, min_score or (), alike or (), name, reach, field_of_view
        )
    print_or_write(output, text)
