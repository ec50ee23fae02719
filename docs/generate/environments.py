"""One page per environment, from its card, the spaces and what is known of its data."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mtp_bench import Card, Task, card_ids, load_card
from mtp_bench.agent.action import ACTION_FIELDS
from mtp_bench.cards.card import LaneSection
from mtp_bench.env.spaces import action_numbers, observation_space
from mtp_bench.scoring import DEFINITIONS
from mtp_bench.sources import describe
from mtp_bench.traffic.drive_episode import CRASH
from mtp_bench.traffic.highway.world import HighwaySource

from . import recordings
from .pictures import speed

ROOT = Path(__file__).resolve().parents[2]
ARGUMENTS = """\
Another split, detector, data root, or other sizes are keywords of `gym.make`: see
[`EnvKeywords`](../reference/environment.md#mtp_bench.env.arguments.EnvKeywords)."""
TABLE = "environment/index.md"  # the page with the table of all of them
CAPTION = '`stp` in the first scene, as `render()` draws it with `render_mode="rgb_array"`, {speed}'
RECORDED = """\
!!! note "No picture"
    Recordings are not ours to publish. With the data on your machine `make docs DATA=folder` draws one here,
    `gym.make("{id}", render_mode="rgb_array")` draws every frame, and these commands show a run:

    ```sh
    mtp-bench run stp --env {id} --scenes 1 -o runs/{id}
    mtp-bench events runs/{id}
    mtp-bench view runs/{id}
    ```
"""


def navigation() -> list[dict[str, str]]:
    """The pages in the order of the navigation."""
    return [{env_id: _place(env_id)} for env_id in ordered()]


def pages() -> dict[str, str]:
    """Place and Markdown of every page."""
    return {_place(env_id): page(load_card(env_id)) for env_id in ordered()}


def linked(table: str) -> str:
    """The table of environments with links to their pages, which only the site has."""
    return re.sub(r"^\| `(MTP-[^`]+)`", r"| [`\1`](\1.md)", table, flags=re.MULTILINE)


def ordered() -> list[str]:
    """Ids in the order of the table of environments."""
    table = (ROOT / "docs" / TABLE).read_text()
    listed = re.findall(r"^\| `(MTP-[^`]+)`", table, flags=re.MULTILINE)
    return [*listed, *sorted(set(card_ids()) - set(listed))]


def page(card: Card) -> str:
    """The page of one environment."""
    parts = [
        f"# {card.id}",
        _picture(card),
        f"{card.summary}.",
        _properties(card),
        "## Observation",
        "What an agent sees of one frame; rows beyond what is there are padding, and `detection_valid` says which.",
        _observations(rules(card)),
        "## Action",
        "What it answers. [`mtp_bench.make_action`](../reference/environment.md) makes it from arrays without padding.",
        _actions(rules(card)),
        "## Reward",
        _reward(card),
        "## Arguments",
        ARGUMENTS,
        "## Data and licence",
        _data(card),
        "## History",
        history(card),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def rules(card: Card) -> Task:
    """The task of a card with the sizes that it names."""
    task, size = card.task, card.size
    return Task(
        env_id=card.id,
        classes=task.classes,
        dt=1 / task.rate,
        past=task.past,
        future=task.future,
        k=task.samples,
        samples=task.samples,
        detections=size.detections,
        tracks=size.tracks,
        objects=size.objects,
        hypotheses=size.hypotheses,
        detector=card.detector_name,
        lanes=card.lanes.pieces if card.lanes else 0,
        lane_points=card.lanes.points if card.lanes else 0,
    )


def _place(env_id: str) -> str:
    return f"environment/{env_id}.md"


def _picture(card: Card) -> str:
    place = recordings.picture(card)
    if place.endswith(".svg"):
        return RECORDED.format(id=card.id)
    return f"![{card.id} from above]({place})\n\n*{caption(card)}.*"


def caption(card: Card) -> str:
    """Words below a moving picture."""
    factor = speed(card.task.rate)
    words = CAPTION.format(
        speed="as fast as the world" if factor == 1 else f"{factor:g} times as fast"
    )
    return words if card.simulated else f"{words}; {recordings.OWN}"


def _properties(card: Card) -> str:
    task = card.task
    measure = (
        "3D IoU at least"
        if task.event_gate.measure == "iou_3d"
        else "distance of centres, m, at most"
    )
    detections = "simulated" if card.detector is not None else "stored"
    rows = {
        "Make it": f'`gym.make("{card.id}")`',
        "Rate": f"{task.rate:g} Hz",
        "Past": f"{task.past} frames, the current one included",
        "Future": f"{task.future} frames: {task.future / task.rate:.3g} s",
        "Samples": f"k = {task.samples} per object",
        "Classes": ", ".join(task.classes),
        "Detections": f"{card.detector_name}, {detections}",
        **({"Lanes": lanes_of(card.lanes)} if card.lanes else {}),
        "A track follows an object": f"{measure}: {per_class(task.event_gate.threshold)}",
        "A forecast belongs to it": f"distance of centres, m, at most: {per_class(task.forecast_gate)}",
        **(
            {"Closed loop": "forecasts drive the ego: [driving](driving.md)"}
            if card.drive is not None
            else {}
        ),
        "Miss error c": f"{per_class(task.miss_error)} (m)",
        "An action has": f"{action_numbers(rules(card)):,} numbers".replace(",", " "),
    }
    return "\n".join(
        [
            "| rule | here |",
            "|---|---|",
            *(f"| {name} | {text} |" for name, text in rows.items()),
        ]
    )


def lanes_of(lanes: LaneSection) -> str:
    """Sizes of the lanes that a card shows."""
    return f"{lanes.pieces} pieces of {lanes.points} points within {lanes.reach:g} m"


def per_class(values: dict[str, float]) -> str:
    """One number where all classes have the same."""
    if len(set(values.values())) == 1:
        return f"{next(iter(values.values())):g}"
    return ", ".join(f"{name} {value:g}" for name, value in values.items())


def _observations(task: Task) -> str:
    meanings = re.findall(
        r"^\| (`[^|]+`) \| \([^|]*\) \| ([^|]+) \|$", _cards_page(), flags=re.MULTILINE
    )
    meaning = {
        name: text for names, text in meanings for name in re.findall(r"`(\w+)`", names)
    }
    lines = ["| field | shape | dtype | range | meaning |", "|---|---|---|---|---|"]
    for name, space in observation_space(task).spaces.items():
        shape, text = _shape(space.shape or ()), meaning[name]
        lines.append(
            f"| `{name}` | {shape} | {space.dtype} | {_range(space)} | {text} |"
        )
    return "\n".join(lines)


def _actions(task: Task) -> str:
    lines = ["| field | shape | dtype | entries | meaning |", "|---|---|---|---|---|"]
    for field in ACTION_FIELDS:
        shape, dtype = _shape(field.shape_in(task)), np.dtype(field.content.dtype)
        meaning = field.meaning + (" Optional." if field.optional else "")
        lines.append(
            f"| `{field.name}` | {shape} | {dtype} | {field.expected_in(task)} | {meaning} |"
        )
    return "\n".join(lines)


def _cards_page() -> str:
    return (ROOT / "envs/README.md").read_text()


def _shape(shape: tuple[int, ...]) -> str:
    return f"({', '.join(map(str, shape))})"


def _range(space: object) -> str:
    """Least and greatest entry of a space."""
    if not hasattr(space, "low"):
        return "0 or 1"
    low, high = (np.asarray(getattr(space, name)).ravel() for name in ("low", "high"))
    return f"{low.min():g} to {high.max():g}"


def _reward(card: Card) -> str:
    if card.drive is not None:
        return f"Metres that the ego drives, less {CRASH:g} for a collision at fault ([driving](driving.md))."
    task = card.task
    half = {name: value / 2 for name, value in task.miss_error.items()}
    return (
        f"Minus the error of the frame ([what that is](index.md#reward)). A target that is not forecast costs "
        f"{per_class(task.miss_error)} m, a false forecast {per_class(half)} m."
    )


def _data(card: Card) -> str:
    about = describe(
        card, ROOT / "docs"
    ).about  # what is known of it, whatever lies on this machine
    lines = [
        f"**{about.name}**: {about.licence}.",
        f"Cite: {about.citation}.",
        f"How to get it: {about.how_to_get}.",
    ]
    if about.known_fault:
        lines.append(f"**Known fault**: {about.known_fault}.")
    if about.layout:
        lines.append(f"```text\n{about.layout}\n```")
    lines.append("Licences of everything: [Datasets and licences](../data/index.md).")
    return "\n\n".join(_linked(line) for line in lines)


def _linked(text: str) -> str:
    """The text with addresses that can be clicked."""
    return re.sub(r"(?<![<(])https?://[^\s,;:]+[^\s,;:.)]", r"<\g<0>>", text)


def history(card: Card) -> str:
    """Versions of an environment, with what made its scenes."""
    version = card.id.rsplit("-", 1)[1]
    made = (
        f", scenes of generator {card.source.generator}"
        if isinstance(card.source, HighwaySource)
        else ""
    )
    return (
        f"- `{version}`: the first version; definitions {DEFINITIONS}{made}; digest of the card `{card.digest}`.\n\n"
        "A published card never changes: a changed task gets the next number ([Versions](../project/versions.md))."
    )
