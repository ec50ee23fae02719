"""``mtp-bench data``."""

from typing import Annotated

from typer import BadParameter, Option

from ..cards import load_card, with_split
from ..core import MtpBenchError, card_ids, long_work
from ..running import read_status
from ..viz import data_lines, show, show_table, status_json, status_table
from .options import DataOption, JsonOption, SplitOption, env_ids
from .output import write_json


def data(
    env: Annotated[
        str | None, Option(help="Only this environment.", autocompletion=env_ids)
    ] = None,
    root: DataOption = None,
    json_file: JsonOption = None,
    split: SplitOption = None,
) -> None:
    """Show which data is found, what is missing and how to get it.

    Status 1 for broken files; with --env also for data that is not there.
    """
    if split is not None and env is None:
        raise BadParameter(
            "the splits of environments differ: name one with --env",
            param_hint="--split",
        )
    cards = [load_card(env_id) for env_id in ([env] if env else card_ids())]
    if split is not None:
        cards = [with_split(card, split) for card in cards]
    statuses = {}
    with long_work("checking data") as progress:
        progress.started(len(cards))
        for card in cards:
            statuses[card.id] = read_status(card, root)
            progress.done(card.id)
    write_json(
        json_file, {env_id: status_json(status) for env_id, status in statuses.items()}
    )
    show_table(status_table(statuses))
    show("\n".join(data_lines(statuses)))
    lacking = [
        env_id
        for env_id, status in statuses.items()
        if status.problems or (env and not status.usable)
    ]
    if lacking:
        raise MtpBenchError(
            f"data is missing or broken for {', '.join(lacking)}; see the listing above"
        )
