"""``mtp-bench envs``."""

from ..cards import load_card
from ..core import card_ids
from ..viz import env_table, show_table
from .options import JsonOption
from .output import write_json


def envs(json_file: JsonOption = None) -> None:
    """List the environments."""
    cards = [load_card(env_id) for env_id in card_ids()]
    content = {}
    for card in cards:
        content[card.id] = {**card.model_dump(mode="json"), "digest": card.digest}
    write_json(json_file, content)
    show_table(env_table(cards))
