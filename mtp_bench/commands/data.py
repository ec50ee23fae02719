"""``mtp-bench envs`` and ``mtp-bench data``."""

from collections.abc import Mapping
from typing import Annotated

from typer import BadParameter, Option

from ..cards import load_card, with_split
from ..core import MtpBenchError, card_ids, long_work
from ..running import read_status
from ..sources import DataStatus
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
    """Show which data is found, what is missing, how to get it, and doubts about it.

    Status 1 for broken files; with --env also for data that is not there.
    """
    if split is not None and env is None:
        raise BadParameter(
            "the splits of environments differ: name one with --env",
            param_hint="--split",
        )
    env_names = [env] if env else card_ids()
    cards = [load_card(env_id) for env_id in env_names]
    if split is not None:
        cards = [with_split(card, split) for card in cards]
    statuses = {}
    with long_work("checking data") as progress:
        progress.started(len(cards))
        for card in cards:
            statuses[card.id] = read_status(card, root, no_doctor)
            progress.done(card.id)
    content = {env_id: status_json(status) for env_id, status in statuses.items()}
    write_json(json_file, content)
    show_table(status_table(statuses))
    show("\n".join(data_lines(statuses)))
    _require_complete(statuses, is_needed=env is not None)


def _require_complete(statuses: Mapping[str, DataStatus], is_needed: bool) -> None:
    """Raise MtpBenchError for broken data, and for missing data that is needed."""
    incomplete: list[str] = []
    for env_id, status in statuses.items():
        if status.problems or (is_needed and not status.usable):
            incomplete.append(env_id)
    if incomplete:
        raise MtpBenchError(
            f"data is missing or broken for {', '.join(incomplete)}; see the listing "
            "above"
        )
