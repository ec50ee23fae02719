"""``mtp-bench doctor``."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from ..core import MtpBenchError, write_text
from .options import EnvScenes, JsonOption, file_option
from .output import error_text, say, write_json

if TYPE_CHECKING:
    from ..cards import Card
    from ..running import RunOptions

_DOUBTS = 1  # exit status
_ERROR = 2


@dataclass(frozen=True)
class _DataScenes(EnvScenes):
    """Scenes of an environment or a user."""

    env: Annotated[
        str,
        Option(
            help="Environment id; with --files: whose rate and classes the files have.",
        ),
    ] = "MTP-nuScenes-v0"


def doctor(
    on: _DataScenes,
    run: Annotated[
        Path | None, Argument(help="Folder of a stored run, whose scenes are examined.")
    ] = None,
    cure: Annotated[
        Path | None,
        Option(help="New folder for a corrected copy of own scenes (--files)."),
    ] = None,
    page: Annotated[
        Path | None,
        file_option(
            "--page",
            text="HTML file to write, with a picture per doubt.",
            suffixes=(".html",),
        ),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Examine data: do truth, detections, ego and clock fit together?

    Status 0 for healthy data, 1 for doubts, 2 for an error.
    """
    try:
        has_doubts = _examine(on, run, cure, page, json_file)
    except (MtpBenchError, OSError) as error:
        say(f"error: {error_text(error)}")
        raise SystemExit(_ERROR) from None
    if has_doubts:
        raise SystemExit(_DOUBTS)


def _examine(
    on: _DataScenes,
    run: Path | None,
    cure: Path | None,
    page: Path | None,
    json_file: Path | None,
) -> bool:
    """Write what is asked for, and return if there are doubts."""
    from ..running import doctor as examine_scenes, require_own
    from ..viz import doubt_page, show

    options = on.options()
    card = options.card(on.env)
    options = options.unchanged
    if run is not None:
        card, options = _scenes_of(run, options)
    if on.files is not None and (run is not None or card.detector is not None):
        what = f"{card.id} simulates detections" if run is None else f"{run} is a run"
        raise MtpBenchError(
            f"{what}, so {on.files} would not be examined: examine it alone, with an "
            "environment (--env) of its rate that plays stored detections, such as "
            "MTP-nuScenes-v0 (2 Hz) and MTP-KITTI-v0 (10 Hz), or a card of your own"
        )
    if cure is not None:
        require_own(card)
        if on.files and cure.absolute().is_relative_to(on.files.absolute()):
            raise MtpBenchError(f"{cure} is inside of {on.files}: name another folder")
    checkup = examine_scenes(card, options)
    write_json(json_file, checkup.to_json())
    if page is not None:
        write_text(page, doubt_page(checkup, card, options))
    show("\n".join(checkup.lines()))
    if cure is not None:
        show(_cured_line(card, cure, options))
    return bool(checkup.doubts)


def _scenes_of(run: Path, options: "RunOptions") -> "tuple[Card, RunOptions]":
    """Return the card of a stored run, and options with its scenes."""
    from ..running import open_run

    try:
        opened = open_run(run, options.data)
    except MtpBenchError as error:
        error.add_note("own scenes are named with --files")
        raise
    names = tuple(rollout.scene for rollout in opened.rollouts())
    return opened.card, replace(options, names=names)


def _cured_line(card: "Card", folder: Path, options: "RunOptions") -> str:
    """Write the corrected copy, and return what it changes."""
    from ..running import cure as cure_scenes

    cured = cure_scenes(card, folder, options)
    if cured.skipped:
        say(f"{folder}: {cured.skipped}; --env says which classes are kept")
    if not cured.scenes:
        return f"{folder}: an unchanged copy, as nothing can be cured"
    errors = [
        "no target to score" if error_m is None else f"{error_m:.3f} m"
        for error_m in (cured.before_m, cured.after_m)
    ]
    names = ", ".join(cured.scenes)
    return f"{folder}: {names} corrected; bADE of stp {' -> '.join(errors)}"
