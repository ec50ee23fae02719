"""Closed loop: agents compared by how their forecasts drive, and recorded scenes."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from ..agent import Role, controls, submission_of
from ..cards import Card, with_files
from ..core import (
    Drive,
    Rollout,
    RolloutError,
    Scene,
    SubmissionError,
    Table,
    cache_root,
    counted,
    whole_folder,
)
from ..env import digest
from ..scoring import AgentDrives, DrivingRow, SceneScore, driving_rows, score_scene
from ..sources import save_scene
from ..traffic import RATE, unpack, whole_scene
from .evaluation import EnvEvaluation
from .playing import AgentFailedError
from .reference import frozen_reference
from .settings import Setting, setting_of

SENTENCE = (
    "Drive score: mean over scenes of 0 after a collision at fault, else of progress "
    "(5 of 12), no near miss (5) and comfort (2). Below a number: 95 % interval. To "
    "stp: minus stp in the same scenes. Phantom brakes: hard braking on a free way. "
    "bADE (m, less is better): of the targets in each agent's own drives."
)
# Roles of baselines that every comparison runs, and of lower references.
CONTROLS: tuple[Role, ...] = ("ground_truth", "single")
LOWER_REFERENCES: tuple[Role, ...] = ("standing", "blind")


@dataclass(frozen=True)
class DrivingComparison:
    """Rows of driving, the best first, and the agents that failed with reasons."""

    env: str
    rows: list[DrivingRow]
    drives: dict[str, AgentDrives]
    failures: dict[str, str]

    @property
    def table(self) -> Table:
        """The rows as a table."""
        scenes = counted(max(row.scenes for row in self.rows), "scene")
        title = f"{self.env}, {scenes}: drive score, more is better"
        return Table("driving", title, SENTENCE, self.rows)


def compare_driving(
    agents: Sequence[object], evaluation: EnvEvaluation, full: bool = False
) -> DrivingComparison:
    """Let each agent drive in the scenes of a closed loop, beside the controls.

    The controls are stp and ground-truth tracks. With ``full`` there are also the lower
    references: one predicts that every detection stands still, the other sees no
    objects. An agent that fails in any scene is named in ``failures``; MtpBenchError if
    a control fails.
    """
    card = evaluation.card
    if evaluation.options.tracks is not None:
        card.require_same_scenes("which takes no stored tracks", "leave --tracks out")
    role_names = controls()
    roles = CONTROLS + LOWER_REFERENCES if full else CONTROLS
    every_agent = map(submission_of, [*(role_names[role] for role in roles), *agents])
    submissions = {submission.name: submission for submission in every_agent}
    settings = [setting_of(submission, card) for submission in submissions.values()]
    drives, failures = drives_of(settings, evaluation)
    for role in CONTROLS:
        if role_names[role] in failures:
            raise SubmissionError(
                f"control {role_names[role]!r} failed: {failures[role_names[role]]}"
            )
    ways_m = reference_ways(card, drives[role_names["ground_truth"]])
    stp = drives[role_names["single"]]
    rows = driving_rows(list(drives.values()), ways_m, stp)
    return DrivingComparison(card.id, rows, drives, failures)


def reference_ways(card: Card, truth: AgentDrives) -> dict[str, float]:
    """Return the ego's way with ground-truth tracks by scene, m driven.

    The frozen distances, if there are any, else means over the drives of ``truth``.
    """
    ways_m: dict[str, float] = {}
    for scene_name, drives in truth.drives.items():
        ways_m[scene_name] = sum(drive.way for drive in drives) / len(drives)
    frozen = frozen_reference(card)
    if frozen is not None and frozen.holds(truth.drives):
        ways_m |= frozen.ways(truth.drives)
    return ways_m


def drives_of(
    settings: Sequence[Setting], evaluation: EnvEvaluation
) -> tuple[dict[str, AgentDrives], dict[str, str]]:
    """Return the drives of settings by label, and why others failed."""
    agent_drives: dict[str, AgentDrives] = {}
    failures: dict[str, str] = {}
    for setting, runs in evaluation.runs(settings, _drive_and_score):
        label = setting.label
        if isinstance(runs, AgentFailedError):
            failures[label] = runs.reason
            continue
        drives = {
            scene_name: [run[index][0] for run in runs]
            for index, scene_name in enumerate(evaluation.scenes)
        }
        seed_scores = [[score for _, score in run] for run in runs]
        agent_drives[label] = AgentDrives(label, drives, seed_scores)
    return agent_drives, failures


def recorded_card(card: Card, rollouts: Sequence[Rollout]) -> Card:
    """Return a card of recorded scenes of drives, without closed loop.

    Any agent can then be run on the scenes that the agents of ``rollouts`` drove in,
    with the detections that they were shown. They are kept as own scenes in the cache;
    of two drives in one scene, as of two seeds, the second is NAME-2. Raises
    RolloutError for a rollout without a whole drive.
    """
    content = hashlib.sha256(card.digest.encode())
    drives: dict[str, Rollout] = {}  # by the name of the recorded scene
    for rollout in rollouts:
        _require_drive(rollout, card)
        content.update(digest(rollout).encode())
        drives[_free_name(rollout.scene, drives)] = rollout
    folder = cache_root() / "drives" / content.hexdigest()[:32] / card.id
    if not folder.is_dir():
        with whole_folder(folder) as part:
            for recorded_name, rollout in drives.items():
                _save_scene(recorded_name, rollout, card, part)
    # the detections are stored as they were shown
    update = {"detector": None, "perturb": None}
    return with_files(card, folder).model_copy(update=update)


def _require_drive(rollout: Rollout, card: Card) -> None:
    """Raise RolloutError unless the drive has a value for each frame."""
    drive = rollout.drive
    frame_steps = round(RATE / card.task.rate)  # of the simulation, per frame
    if drive is not None:
        columns = (drive.risk, drive.cause, drive.acceleration[::frame_steps])
        if all(len(column) == rollout.frames for column in columns):
            return
    raise RolloutError(
        f"scene {rollout.scene!r} of {card.id} has no drive, or one that does not fit "
        f"its {rollout.frames} frames; expected risk, cause and acceleration of each "
        "frame: run the agent again"
    )


def _free_name(scene_name: str, taken_names: dict[str, Rollout]) -> str:
    """Return the name of a scene, with a number if it is taken."""
    free_name = scene_name
    numbers = count(2)
    while free_name in taken_names:
        free_name = f"{scene_name}-{next(numbers)}"
    return free_name


def _save_scene(recorded_name: str, rollout: Rollout, card: Card, folder: Path) -> None:
    """Write the scene that a drive recorded.

    Raises RolloutError.
    """
    assert rollout.drive is not None
    try:
        world = unpack(rollout.drive.world)
        scene = replace(whole_scene(world, card, rollout.scene), name=recorded_name)
    except (LookupError, TypeError, ValueError) as error:  # an edited file
        raise RolloutError(
            f"scene {recorded_name!r} of {card.id}: the world of its drive cannot be "
            f"read ({error}); expected recorded traffic: run the agent again"
        ) from None
    save_scene(scene, folder, card.task.classes, "parquet")


def _drive_and_score(
    scene: Scene, rollout: Rollout, card: Card
) -> tuple[Drive, SceneScore]:
    """Return the drive without its recording, and the score of its forecasts."""
    assert rollout.drive is not None
    return replace(rollout.drive, world={}), score_scene(scene, rollout, card)
