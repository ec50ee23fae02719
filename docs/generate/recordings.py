"""Pictures of environments and of failures, drawn while the site is built; those of recordings are never committed.

Without the data, pages say how to draw them. The site that is published is built without it.
"""

from __future__ import annotations

import logging
import os
import tempfile
from functools import cache
from pathlib import Path

from docs.make_pictures import REAL, take
from mtp_bench import Card, MtpBenchError, card_ids, load_card
from mtp_bench.sources import describe

from .pictures import moving_picture, placeholder

WHY = "visualization/why.md"  # the page with failures
FRAMES, FAILURES = "environment/pictures", "pictures"
OWN = "drawn from the data of whoever built this copy of the site; the dataset's licence does not let it be published"
NOT_SHOWN = (  # the line of the page that gives way to the pictures
    "They are not shown here: the licences of the recordings do not allow it. "
    "`make docs DATA=folder` draws them into a site of your own."
)
DOCS = Path(__file__).resolve().parents[1]
_log = logging.getLogger("mkdocs.hooks.recordings")


@cache
def frames() -> dict[str, bytes | str]:
    """A moving picture of every environment, by its place in the site; a drawing where the data is missing."""
    cards = [load_card(env_id) for env_id in card_ids()]
    drawn = {
        card.id: moving_picture(card.id) if card.simulated else _recorded(card.id)
        for card in cards
    }
    missing = {
        card.id: placeholder(card.id, describe(card, DOCS).about.name)
        for card in cards
        if not drawn[card.id]
    }
    webp = {
        f"{FRAMES}/{env_id}.webp": content
        for env_id, content in drawn.items()
        if content
    }
    return {
        **webp,
        **{f"{FRAMES}/{env_id}.svg": content for env_id, content in missing.items()},
    }


def picture(card: Card) -> str:
    """Place of the picture of an environment, from its page."""
    (place,) = {f"{FRAMES}/{card.id}.webp", f"{FRAMES}/{card.id}.svg"} & set(frames())
    return place.removeprefix("environment/")


@cache
def failures() -> dict[str, tuple[bytes, str]]:
    """Picture of real failures whose data is here, and what to say of it, by their places in the site."""
    found: dict[str, tuple[bytes, str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, shot in REAL.items() if _has_data() else ():
            path = Path(folder, f"{name}.png")
            try:
                sentence = take(shot, path)
            except MtpBenchError as error:  # this dataset is missing
                _log.info("no picture of %s: %s", shot.env_id, error)
                continue
            place = f"{FAILURES}/{name}.png"
            text = f"[![{sentence}](../{place})](../{place})\n\n*{shot.env_id}, scene {shot.scene}: {OWN}.*"
            found[place] = path.read_bytes(), text
    return found


def shown(markdown: str) -> str:
    """The page with failures, with the pictures of recordings that there are."""
    if NOT_SHOWN not in markdown:
        raise ValueError(f"{WHY} has no line {NOT_SHOWN!r}")
    return markdown.replace(
        NOT_SHOWN, "\n\n".join(text for _, text in failures().values()) or NOT_SHOWN
    )


def _recorded(env_id: str) -> bytes | None:
    try:
        return moving_picture(env_id) if _has_data() else None
    except MtpBenchError as error:  # its data is missing
        _log.info("no picture of %s: %s", env_id, error)
        return None


def _has_data() -> bool:
    """True if a data root was named; the user's own data folder is never published unasked."""
    root = os.environ.get("MTP_BENCH_DATA")
    if root and not Path(root).expanduser().is_dir():
        raise SystemExit(f"MTP_BENCH_DATA is {root}, expected a folder with datasets")
    return bool(root)
