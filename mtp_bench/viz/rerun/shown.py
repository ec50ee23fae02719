"""Runs as a recording shows them: names, paths, hypotheses, and colours that can be read on dark and light grounds."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core import Ints, MtpBenchError, require_known
from ..focus import Focus
from ..framing import focuses_of
from ..incident import Incident
from ..palette import BLUE, FALSE, GREEN, NOW, ORANGE, PURPLE, YELLOW, Color
from ..run_replay import Replay

Colors = NDArray[np.uint8]  # [..., 3] red green blue

# What is right or wrong has a colour of its own, which no track takes.
TRUTH = GREEN
NEUTRAL = (0, 79, 58)
DETECTION = YELLOW
EGO = (255, 255, 255)
CENTER = (44, 44, 52)
BORDER = (92, 92, 104)
UNTRACKED = (84, 84, 84)
UNKNOWN = (150, 150, 150)
SWITCH = (235, 70, 180)
SKY = (50, 145, 215)
TRACKS: tuple[
    Color, ...
] = (  # a prime number of them: the ids of a switch seldom share one
    ORANGE,
    SKY,
    PURPLE,
    BLUE,
    (140, 150, 70),
    (166, 112, 0),
    (150, 130, 240),
)
EVENTS = {
    "ids": SWITCH,
    "lost": FALSE,
    "reacquired": SKY,
    "spurious": UNKNOWN,
    "collision": FALSE,
}
ROLES: dict[str, Color] = {  # of a thing in an event
    "truth": TRUTH,
    "before": SKY,
    "now": NOW,
    "named": PURPLE,
    "detection": UNKNOWN,
    "ego": (140, 140, 150),
}
LEVELS = (
    "tracks",
    "top",
    "all",
)  # of detail, each with the content of the one before it
TOP_HYPOTHESES = 4


def track_colors(track_id: Ints) -> Colors:
    """Colour [N, 3] of each track id [N]: the same in every frame and run; grey for -1."""
    table = np.array([*TRACKS, UNKNOWN], dtype=np.uint8)
    return table[np.where(track_id < 0, len(TRACKS), track_id % len(TRACKS))]


def packed(colors: Colors | Color) -> NDArray[np.uint32]:
    """Opaque colours [N] as one number each, from red, green, blue [N, 3]."""
    rgb = np.asarray(colors, dtype=np.uint32).reshape(-1, 3)
    number: NDArray[np.uint32] = rgb @ np.array(
        [1 << 24, 1 << 16, 1 << 8], dtype=np.uint32
    ) + np.uint32(255)
    return number


def drawable(text: str) -> str:
    """The text with "?" for every sign that the viewer's only font may lack: one of them would end the viewer."""
    return re.sub(
        r"[^\n\x20-\x7e\xa1-\xac\xae-\u017f\u0391-\u03a1\u03a3-\u03c9\u0410-\u044f]",
        "?",
        text,
    )


def object_names(run: Replay) -> dict[int, str]:
    """Name of each true object by its number, such as "car 4"."""
    truth, classes = run.scene.truth, run.card.task.classes
    ids, first = np.unique(truth.object_id, return_index=True)
    nouns = [
        classes[class_id].replace("_", " ")
        for class_id in truth.class_id[first].tolist()
    ]
    return {
        i: drawable(f"{noun} {run.scene.short_name(i)}")
        for i, noun in zip(ids.tolist(), nouns, strict=True)
    }


def path_part(name: str) -> str:
    """The name as a part of a path, in which the viewer shows no other signs as they are: "car-4"."""
    return re.sub(r"[^A-Za-z0-9_.]+", "-", name).strip("-")


@dataclass(frozen=True, eq=False)
class ShownAgent:
    """One agent in a recording."""

    replay: Replay
    hypotheses: dict[
        int, float
    ]  # the heaviest first, with their weights at the event, or the means over the scene
    name: str = ""  # empty for the only agent
    root: str = ""  # prefix of the paths of its entities
    shared: str = ""  # prefix of the paths of the map, the truth and the detections
    focus: Focus | None = None  # the event that the views look at

    @cached_property
    def lanes(self) -> dict[int, str]:
        """Path of the identity lane of each true object by its number."""
        names = {
            number: path_part(name)
            for number, name in object_names(self.replay).items()
        }
        count = Counter(names.values())
        return {
            i: f"identity/{name}{f'-{i}' if count[name] > 1 else ''}"
            for i, name in names.items()
        }

    def titled(self, text: str) -> str:
        """``text`` for a view of this agent, with its name if there are several agents."""
        return drawable(f"{self.name}: {text}" if self.name else text)


def shown_agents(
    replays: Sequence[Replay], level: str, at: Incident | None
) -> list[ShownAgent]:
    """The runs of one scene, each with a name of its own; ``at``: an event of the first one, at which all look.

    The entities of the first run have no prefix, those of the others "agents/NAME/".
    """
    require_known("level", level, LEVELS)
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        raise MtpBenchError(
            f"a recording shows one scene, got {', '.join(sorted(scenes)) or 'none'}"
        )
    focuses = [None] * len(replays) if at is None else focuses_of(replays, at)
    agents: list[ShownAgent] = []
    for replay, focus in zip(replays, focuses, strict=True):
        base = path_part(replay.agent) or "agent"
        names = [base, *(f"{base}-{number}" for number in range(2, len(replays) + 1))]
        name = next(
            each for each in names if each not in {agent.name for agent in agents}
        )
        root = f"agents/{name}/" if agents else ""
        shown, name = _hypotheses(replay, level, at), name if len(replays) > 1 else ""
        agents.append(ShownAgent(replay, shown, name, root, "", focus))
    return agents


def _hypotheses(replay: Replay, level: str, at: Incident | None) -> dict[int, float]:
    """The hypotheses of a level with their weights, the heaviest first: all that ever hold a track, else a few."""
    weight = np.exp(replay.rollout.hypothesis_log_weight.astype(np.float64))
    weight = weight.mean(axis=0) if at is None else weight[at.frame]
    alive = np.flatnonzero(replay.answers.hypotheses.member.any(axis=0))
    alive = alive[np.argsort(-weight[alive], kind="stable")][
        : None if level == "all" else TOP_HYPOTHESES
    ]
    return {int(h): float(weight[h]) for h in alive} or {0: 1.0}
