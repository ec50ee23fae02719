"""Runs as a recording shows them: names, paths, hypotheses, and colours.

The colours can be read on dark and light grounds.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core import Ints, MtpBenchError
from ..focus import Focus
from ..framing import focuses_of
from ..incident import Incident
from ..palette import BLUE, FALSE, GREEN, ORANGE, PURPLE, YELLOW, Color
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
# a prime number of them: the ids of a switch seldom share one
TRACKS: tuple[Color, ...] = (
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
TOP_HYPOTHESES = 4
_DRAWABLE = r"[^\n\x20-\x7e\xa1-\xac\xae-\u017f\u0391-\u03a1\u03a3-\u03c9\u0410-\u044f]"


def track_colors(track_id: Ints) -> Colors:
    """Return the colour [N, 3] of each track id [N].

    It is grey for -1, and the same in every frame and run.
    """
    table = np.array([*TRACKS, UNKNOWN], dtype=np.uint8)
    return table[np.where(track_id < 0, len(TRACKS), track_id % len(TRACKS))]


def drawable(text: str) -> str:
    """Replace signs that the viewer's only font may lack by "?".

    The viewer would crash at one of them.
    """
    return re.sub(_DRAWABLE, "?", text)


def object_names(replay: Replay) -> dict[int, str]:
    """Return names such as "car 4" by object number."""
    truth = replay.scene.truth
    object_ids, rows = np.unique(truth.object_id, return_index=True)
    classes = dict(zip(object_ids.tolist(), truth.class_id[rows].tolist(), strict=True))
    return {
        object_id: drawable(replay.object_name(object_id, class_id))
        for object_id, class_id in classes.items()
    }


def path_part(name: str) -> str:
    """Return the name as a part of a path: "car-4".

    The viewer shows no other signs as they are.
    """
    return re.sub(r"[^A-Za-z0-9_.]+", "-", name).strip("-")


@dataclass(frozen=True, eq=False)
class ShownAgent:
    """One agent in a recording."""

    replay: Replay
    # the heaviest first, with weights at the event, or means over the scene
    hypotheses: dict[int, float]
    name: str = ""  # empty for the only agent
    root: str = ""  # prefix of the paths of its entities
    shared_prefix: str = ""  # of the paths of the map, the truth and the detections
    focus: Focus | None = None  # the event that the views look at

    @cached_property
    def lanes(self) -> dict[int, str]:
        """Path of the identity lane of each object by number."""
        names = object_names(self.replay)
        parts = {number: path_part(name) for number, name in names.items()}
        count = Counter(parts.values())
        paths = {}
        for number, part in parts.items():
            suffix = f"-{number}" if count[part] > 1 else ""
            paths[number] = f"identity/{part}{suffix}"
        return paths

    def titled(self, text: str) -> str:
        """Put the agent's name before ``text`` if there are several agents."""
        return drawable(f"{self.name}: {text}" if self.name else text)


def shown_agents(
    replays: Sequence[Replay], is_all: bool, at: Incident | None
) -> list[ShownAgent]:
    """Name the runs of one scene.

    All look at the event ``at`` of the first one. The entities of the first run have no
    prefix, those of the others "agents/2-NAME/" and so on.
    """
    scenes = {replay.scene.name for replay in replays}
    if len(scenes) != 1:
        scene_names = ", ".join(sorted(scenes)) or "none"
        raise MtpBenchError(f"a recording shows one scene, got {scene_names}")
    focuses: Sequence[Focus | None] = [None] * len(replays)
    if at is not None:
        focuses = focuses_of(replays, at)
    agents: list[ShownAgent] = []
    for number, replay in enumerate(replays, 1):
        hypotheses = _hypotheses(replay, is_all, at)
        name = f"{number}-{path_part(replay.agent)}" if len(replays) > 1 else ""
        root = f"agents/{name}/" if agents else ""
        focus = focuses[number - 1]
        agents.append(ShownAgent(replay, hypotheses, name, root, focus=focus))
    return agents


def _hypotheses(replay: Replay, is_all: bool, at: Incident | None) -> dict[int, float]:
    """Return hypotheses with weights, heaviest first.

    They are all that ever hold a track, or the TOP_HYPOTHESES heaviest of them. Without
    any it is hypothesis 0.
    """
    weights = np.exp(replay.rollout.hypothesis_log_weight.astype(np.float64))
    weight = weights.mean(axis=0) if at is None else weights[at.frame]
    alive = np.flatnonzero(replay.answers.hypotheses.member.any(axis=0))
    alive = alive[np.argsort(-weight[alive], kind="stable")]
    if not is_all:
        alive = alive[:TOP_HYPOTHESES]
    return {int(h): float(weight[h]) for h in alive} or {0: 1.0}
