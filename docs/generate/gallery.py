"""The gallery: every environment with its moving picture, its sizes, its history and its place on the board."""

from __future__ import annotations

import math
import re

from mtp_bench import Card, load_card
from mtp_bench.env.spaces import action_numbers, observation_space

from . import recordings
from .environments import ROOT, history, lanes_of, ordered, rules
from .pictures import speed

PAGE = "environment/gallery.md"
HEAD = """\
# Gallery

This page helps to choose an environment: its picture, its sizes and where its results are.

Each picture shows `stp` in the first scene from above, as `render()` draws it: true boxes are green, detections yellow,
tracks blue, forecasts pink. In a [closed loop](driving.md) the black line is the plan of the ego. The [table](index.md)
compares the environments in short.
"""


def page() -> str:
    """The page in Markdown."""
    return "\n".join([HEAD, *(_entry(load_card(env_id)) for env_id in ordered())])


def _entry(card: Card) -> str:
    """One environment: a picture and a table beside it."""
    place = recordings.picture(card)
    notes = [] if card.simulated or place.endswith(".svg") else [recordings.OWN]
    if place.endswith(".webp") and speed(card.task.rate) != 1:
        notes.append(f"played at {speed(card.task.rate):.2g} times the real speed")
    words = "; ".join(notes)
    note = f"\n\n*{words[0].upper()}{words[1:]}.*" if notes else ""
    picture = f"<div markdown>\n\n![{card.id} from above]({place}){note}\n\n</div>"
    facts = "\n".join(
        [
            "| | |",
            "|---|---|",
            *(f"| {name} | {text} |" for name, text in _facts(card).items()),
        ]
    )
    summary = card.summary[0].upper() + card.summary[1:]
    return f'## {card.id}\n\n{summary}.\n\n<div class="gallery" markdown>\n\n{picture}\n\n{facts}\n\n</div>\n'


def _facts(card: Card) -> dict[str, str]:
    task, size = card.task, card.size
    seen = observation_space(rules(card)).spaces
    numbers = sum(math.prod(space.shape or ()) for space in seen.values())
    return {
        "Rate": f"{task.rate:g} Hz",
        "Past, future": f"{task.past} frames ({task.past / task.rate:.3g} s), "
        f"{task.future} frames ({task.future / task.rate:.3g} s)",
        "Samples": f"k = {task.samples} per object",
        "Classes": ", ".join(task.classes),
        "Observation": f"{_spaced(numbers)} numbers: at most {size.detections} detections"
        + (f"; lanes: {lanes_of(card.lanes)}" if card.lanes else ""),
        "Action": f"{_spaced(action_numbers(rules(card)))} numbers: at most {size.hypotheses} hypotheses, "
        f"{_spaced(size.tracks)} tracks, {size.objects} objects",
        "History": history(card).split("; digest")[0].removeprefix("- "),
        "More": f"[spaces and rules]({card.id}.md), {_results(card.id)}",
    }


def _results(env_id: str) -> str:
    """The link to the table of an environment on the board, which states older definitions in its name."""
    board = (ROOT / "leaderboard/index.html").read_text()
    found = re.search(rf'id="({re.escape(env_id)}(?:@[\d.]+)?)"', board)
    return (
        f"[results](../leaderboard/board.html#{found[1]})"
        if found
        else "no results yet"
    )


def _spaced(number: int) -> str:
    return f"{number:,}".replace(",", " ")
