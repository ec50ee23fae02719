"""``mtp-bench envs`` and ``mtp-bench data``."""

from pathlib import Path
from typing import Annotated

from typer import BadParameter, Option

from ..cards import load_card, with_split
from ..core import MtpBenchError, card_ids, long_work
from ..running import read_status
from ..viz import data_lines, env_table, show, show_table, status_json, status_table
from .options import DataOption, JsonOption, NoDoctorOption, SplitOption
from .output import write_json


def envs(json_file: JsonOption = None) -> None:
    """List the environments."""
    cards = [load_card(env_id) for env_id in card_ids()]
    content = {}
    for card in cards:
        content[card.id] = {**card.model_dump(mode="json"), "digest": card.digest}
    write_json(json_file, content)
    show_table(env_table(cards))


def data(
    env: Annotated[str | None, Option(help="Only this environment.")] = None,
    root: DataOption = None,
    json_file: JsonOption = None,
    split: SplitOption = None,
    no_doctor: NoDoctorOption = False,
) -> None:
    """Show which data is found, or with --env what is missing, and how to get it.

    With --env status 1 for data that is broken or not there. It also shows licence,
    citation and doubts about the data.
    """
    if env is None:
        _show_all(root, split, json_file)
        return
    card = load_card(env)
    if split is not None:
        card = with_split(card, split)
    status = read_status(card, root, no_doctor)
    write_json(json_file, {card.id: status_json(status)})
    show("\n".join(data_lines(status)))
    if status.problems or not status.usable:
        raise MtpBenchError(f"data of {card.id} is missing or broken; see above")


def _show_all(root: str | None, split: str | None, json_file: Path | None) -> None:
    """Show the state of the data of all environments, without examining it."""
    if split is not None:
        raise BadParameter(
            "the splits of environments differ: name one with --env",
            param_hint="--split",
        )
    statuses = {}
    with long_work("checking data") as progress:
        progress.started(len(card_ids()))
        for env_id in card_ids():
            statuses[env_id] = read_status(load_card(env_id), root, no_doctor=True)
            progress.done(env_id)
    content = {env_id: status_json(status) for env_id, status in statuses.items()}
    write_json(json_file, content)
    show_table(status_table(statuses))
    show(
        "`mtp-bench data --env ENVIRONMENT` shows what is missing and how to get it, "
        "the licence, and doubts about the data."
    )
