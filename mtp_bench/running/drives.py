"""Closed loop: agents side by side by how their forecasts drive, and their recorded scenes."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count, product
from typing import Any

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
from .playing import AgentFailedError, run_jobs
from .reference import frozen_reference
from .settings import Setting, setting_of

SENTENCE = (
    "Drive score: mean over scenes of 0 after a collision at fault, else of progress (5 of 12), no near miss (5) and "
    "comfort (2). Below a number: 95 % interval. To stp: minus stp in the same scenes. Phantom brakes: hard braking "
    "on a free way. bADE (m, less is better): of the targets in each agent's own drives."
)
CONTROLS: tuple[Role, ...] = (
    "ground_truth",
    "single",
)  # roles of baselines that every comparison runs
IN_FULL: tuple[Role, ...] = ("standing", "blind")  # lower references


@dataclass(frozen=True)
class DrivingComparison:
    """Rows of driving, the best first, and the agents that failed with their reasons."""

    env: str
    rows: list[DrivingRow]
    drives: dict[str, AgentDrives]
    failures: dict[str, str]

    @property
    def table(self) -> Table:
        """The rows as a table."""
        scenes = counted(max(row.scenes for row in self.rows), "scene")
        return Table(
            "driving",
            f"{self.env}, {scenes}: drive score, more is better",
            SENTENCE,
            self.rows,
        )


def compare_driving(
    agents: Sequence[object], evaluation: EnvEvaluation, full: bool = False
) -> DrivingComparison:
    """Let each agent drive in the scenes of a closed loop, beside stp and ground-truth tracks.

    ``full``: also beside the lower references, every detection as standing and no objects. An agent that fails in any
    scene is named in ``failures``; MtpBenchError if a control fails.
    """
    role, card = controls(), evaluation.card
    if evaluation.options.tracks is not None:
        card.require_same_scenes("which takes no stored tracks", "leave --tracks out")
    names = dict.fromkeys(
        [*(role[each] for each in CONTROLS + IN_FULL * full), *agents]
    )
    settings = [setting_of(submission_of(agent), card) for agent in names]
    drives, failures = drives_of(settings, evaluation)
    for each in CONTROLS:
        if role[each] in failures:
            raise SubmissionError(
                f"control {role[each]!r} failed: {failures[role[each]]}"
            )
    truth = drives[role["ground_truth"]].drives
    frozen = frozen_reference(card)
    known = frozen.ways(truth) if frozen is not None and frozen.holds(truth) else {}
    reference = {
        name: known.get(name, sum(drive.way for drive in own) / len(own))
        for name, own in truth.items()
    }
    rows = driving_rows(list(drives.values()), reference, drives[role["single"]])
    return DrivingComparison(card.id, rows, drives, failures)


def drives_of(
    settings: Sequence[Setting], evaluation: EnvEvaluation
) -> tuple[dict[str, AgentDrives], dict[str, str]]:
    """Drives of each setting by its label, and the reasons of those that failed."""
    options, scenes = evaluation.options, evaluation.scenes
    jobs = [
        evaluation.jobs(setting, seed, scenes)
        for setting, seed in product(settings, options.seeds)
    ]
    results = iter(run_jobs(list(chain(*jobs)), options, _driven, caught=True))
    found, failures = dict[str, AgentDrives](), dict[str, str]()
    for setting in settings:
        own = [[next(results) for _ in scenes] for _ in options.seeds]
        failed = [
            each for run in own for each in run if isinstance(each, AgentFailedError)
        ]
        if failed:
            failures[setting.label] = failed[0].reason
        else:
            drives = {name: [run[i][0] for run in own] for i, name in enumerate(scenes)}
            found[setting.label] = AgentDrives(
                setting.label, drives, [[score for _, score in run] for run in own]
            )
    return found, failures


def recorded_card(card: Card, rollouts: Sequence[Rollout]) -> Card:
    """The card of the recorded scenes of drives, on which any agent can then be run, with no loop.

    The scenes are those that the agents of ``rollouts`` drove in, with the detections that they were shown; they are
    kept as own scenes in the cache; of two drives in one scene, as of two seeds, the second is NAME-2. Raises
    RolloutError for a rollout without a whole drive.
    """
    sha, worlds = (
        hashlib.sha256(card.digest.encode()),
        dict[str, tuple[str, Mapping[str, Any]]](),
    )
    for rollout in rollouts:
        drive, n, steps = rollout.drive, rollout.frames, round(RATE / card.task.rate)
        if (
            drive is None
            or not len(drive.risk)
            == len(drive.cause)
            == len(drive.acceleration[::steps])
            == n
        ):
            got = f"scene {rollout.scene!r} of {card.id} has no drive, or one that does not fit its {n} frames"
            raise RolloutError(
                f"{got}; expected risk, cause and acceleration of each frame: run the agent again"
            )
        sha.update(digest(rollout).encode())
        names = chain(
            [rollout.scene], (f"{rollout.scene}-{number}" for number in count(2))
        )
        worlds[next(name for name in names if name not in worlds)] = (
            rollout.scene,
            drive.world,
        )
    folder = cache_root() / "drives" / sha.hexdigest()[:32] / card.id
    if not folder.is_dir():
        with whole_folder(folder) as part:
            for name, (driven, world) in worlds.items():
                try:
                    scene = replace(
                        whole_scene(unpack(dict(world)), card, driven), name=name
                    )
                except (
                    KeyError,
                    IndexError,
                    TypeError,
                    ValueError,
                ) as error:  # its file may have been edited
                    got = f"scene {name!r} of {card.id}: the world of its drive cannot be read ({error})"
                    raise RolloutError(
                        f"{got}; expected recorded traffic: run the agent again"
                    ) from None
                save_scene(scene, part, card.task.classes, "parquet")
    return with_files(card, folder).model_copy(update={"detector": None})


def _driven(scene: Scene, rollout: Rollout, card: Card) -> tuple[Drive, SceneScore]:
    """The drive without its recording, and the score of its forecasts."""
    assert rollout.drive is not None
    return replace(rollout.drive, world={}), score_scene(scene, rollout, card)
