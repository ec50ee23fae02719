"""Files of `benchmarks/driving.py measure`: one per scene, agent and seed of the detector.

Each file holds a drive without its recording, and what happened near the ego (`Moments`); one beside it the score of
the agent's own episode, and at seed 0 that of the recorded scene in which ground-truth tracks drove. A failure is kept,
and tried again by the next run. Files appear complete, so several processes may fill one folder.
"""

from __future__ import annotations

import os
import pickle
import time
import warnings
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.driving_attacks import base_of, changed
from mtp_bench.agent.loader import submission_of
from mtp_bench.cards import Card
from mtp_bench.core import HARD_BRAKING, Drive, Floats, Ints, Rollout, Scene
from mtp_bench.core.parallel import Workers, unordered_map
from mtp_bench.env.environment import MTPEnv
from mtp_bench.running.drives import recorded_card
from mtp_bench.running.playing import agent_task, run_scene
from mtp_bench.running.settings import setting_of
from mtp_bench.scoring import SceneScore, evaluated, score_scene
from mtp_bench.scoring.weights import EVENT_KINDS, tracking_events
from mtp_bench.traffic.drive_record import near_misses, occupied
from mtp_bench.traffic.highway.world import RATE

TRUTH, STP = "gt_tracks", "stp"
AGENTS = (
    TRUTH,
    STP,
    "blind",
    "standing",
    "mtp",
    "stp_same_samples",
    "tracking_free",
    "mtp_modes",
    "stp_modes",
    "gt_tracks_modes",
    "stp_min_score",
    "mtp_min_score",
    "ab3dmot",
    "affinity",
    "stp_hedged",
    "stp_modes_tracklets",
    "mtp_modes_tracklets",
    "perfect_association",
    "perfect_association_same_samples",
    "perfect_association_modes",
    "stp_ptp",
    "mtp_ptp",
    "gt_tracks_ptp",
    "perfect_association_ptp",
    "perfect_association_modes_tracklets",
)
NEAR, AHEAD = 30.0, 15.0  # m around the ego, and before it
MOVING = 0.5  # m/s
CPU_SECONDS = 2.0  # of an agent in a scene: a first guess
RECORDED, SCORES = (
    "recorded.rollout",
    ".scores",
)  # rollout of TRUTH, with the recording; suffix of a file of scores
Array = Floats


@dataclass(frozen=True, eq=False)
class Moments:
    """Events near the ego in a drive of F frames."""

    events: Array  # [n, 5] frame, index into EVENTS, m ahead of the ego, m to its left, class
    objects: Array  # [F] true objects within NEAR
    moving: Array  # [F] of them those that move
    speed: Array  # [F] m/s of the ego
    phantom: Array  # [b] s from the start, when a hard brake without a cause began
    missed: Array  # [m] s from the start, when a near miss began

    def switches(self, ahead: bool = False) -> Ints:
        """Number of identity switches [F] within NEAR in each frame; or of those ``ahead`` of the ego, within AHEAD."""
        frame, kind, x, y, _ = self.events.T
        counted = kind == EVENT_KINDS.index("ids")
        if ahead:
            counted &= (x > 0) & (np.hypot(x, y) < AHEAD)
        return np.bincount(frame[counted].astype(np.int64), minlength=len(self.speed))


@dataclass(frozen=True, eq=False)
class Kept:
    """An agent in a scene; ``failure`` says why there is nothing else."""

    failure: str
    known_drive: Drive | None = None
    known_moments: Moments | None = None
    seconds: tuple[float, float] = (
        0.0,
        0.0,
    )  # of the processor: own episode, open loop

    @property
    def drive(self) -> Drive:
        """The drive, without its recording."""
        assert self.known_drive is not None, self.failure
        return self.known_drive

    @property
    def moments(self) -> Moments:
        """Moments near the ego."""
        assert self.known_moments is not None, self.failure
        return self.known_moments


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of an agent in a scene."""

    own: SceneScore  # of its own episode
    open_loop: SceneScore | None  # of the recorded scene; None for seeds above 0


def path_of(folder: Path, seed: int, scene: str, agent: str) -> Path:
    """File of an agent in a scene."""
    return folder / f"seed{seed}" / scene / f"{agent}.pickle"


def read_kept(path: Path) -> Kept | None:
    """The content of a file; None without one."""
    return pickle.loads(zlib.decompress(path.read_bytes())) if path.is_file() else None


def read_scores(path: Path) -> Scores:
    """Scores beside what is kept."""
    scores: Scores = pickle.loads(
        zlib.decompress(path.with_suffix(SCORES).read_bytes())
    )
    return scores


def seeded(card: Card, seed: int) -> Card:
    """The card with another seed of its detector."""
    assert card.detector is not None
    return card.model_copy(
        update={"detector": card.detector.model_copy(update={"seed": seed})}
    )


def missing_agents(
    folder: Path, seed: int, scene: str, agents: Sequence[str]
) -> list[str]:
    """Agents without a result in a scene."""
    kept = {agent: read_kept(path_of(folder, seed, scene, agent)) for agent in agents}
    return [agent for agent, one in kept.items() if one is None or one.failure]


def measure_scene(
    card: Card,
    name: str,
    agents: Sequence[str],
    folder: Path,
    seed: int = 0,
    scored: bool = True,
) -> dict[str, str]:
    """Let agents that have no result yet drive in a scene, and forecast the recorded one; reasons of failures.

    Changed agents drive only; all agents do without ``scored``.
    """
    card, failures, recorded = seeded(card, seed), {}, None
    for agent in missing_agents(folder, seed, name, agents):
        try:
            if not scored or agent != base_of(agent):
                kept = _driven(agent, card, name, seed)
            else:
                if agent != TRUTH and seed == 0 and recorded is None:
                    recording = _recorded(card, name, folder, seed)
                    recorded = recorded_card(card, [recording])
                kept = _measured(agent, card, recorded, name, folder, seed)
        except Exception as error:  # of an agent: the others go on
            kept = Kept(failure=" ".join(f"{type(error).__name__}: {error}".split()))
            failures[agent] = kept.failure
        _write(path_of(folder, seed, name, agent), kept)
    return failures


def _driven(agent: str, card: Card, name: str, seed: int) -> Kept:
    start = time.process_time()
    rollout = played(agent, card, name, seed)[1]
    assert rollout.drive is not None
    drive = replace(rollout.drive, world={})
    return Kept("", drive, None, (time.process_time() - start, 0.0))


def _measured(
    agent: str, card: Card, recorded: Card | None, name: str, folder: Path, seed: int
) -> Kept:
    start = time.process_time()
    env, rollout = played(agent, card, name, seed)
    assert rollout.drive is not None
    if agent == TRUTH:
        _write(path_of(folder, seed, name, agent).with_name(RECORDED), rollout)
    own, noted = score_scene(env.scene, rollout, env.card), moments(env, rollout)
    middle, open_loop = time.process_time(), None
    if agent == TRUTH and seed == 0:
        open_loop = own  # the recorded scene is its own
    elif recorded is not None:
        open_env, forecasts = played(agent, recorded, name, seed)
        open_loop = score_scene(open_env.scene, forecasts, open_env.card)
    seconds = middle - start, time.process_time() - middle
    _write(
        path_of(folder, seed, name, agent).with_suffix(SCORES), Scores(own, open_loop)
    )
    return Kept("", replace(rollout.drive, world={}), noted, seconds)


def _recorded(card: Card, name: str, folder: Path, seed: int) -> Rollout:
    """The drive of ground-truth tracks, made unless it is there."""
    path = path_of(folder, seed, name, TRUTH).with_name(RECORDED)
    if not path.is_file():
        _write(path, played(TRUTH, card, name, seed)[1])
    return read_rollout(path)


def read_rollout(path: Path) -> Rollout:
    """A rollout with its recording."""
    rollout: Rollout = pickle.loads(zlib.decompress(path.read_bytes()))
    return rollout


def played(agent: str, card: Card, name: str, seed: int) -> tuple[MTPEnv, Rollout]:
    """An agent's drive in a scene, or its forecasts of a recorded one, and the env that it ended."""
    setting = setting_of(submission_of(base_of(agent)), card)
    env = MTPEnv(card, **setting.env_keywords(card), evaluation=True)
    with np.errstate(), warnings.catch_warnings():
        task = agent_task(env, seed, name)
        made = changed(agent, setting.submission.factory(setting.parameters)(task))
        return env, run_scene(made, env, name, seed, agent)


def _write(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part{os.getpid()}")
    part.write_bytes(zlib.compress(pickle.dumps(content), 1))
    part.replace(path)


def moments(env: MTPEnv, rollout: Rollout) -> Moments:
    """Events near the ego in the drive that ``env`` has just ended."""
    episode: Any = env._episode
    traffic, stations, drive = (
        episode.traffic,
        np.array(episode.stations),
        rollout.drive,
    )
    assert drive is not None
    scene, speed = evaluated(env.scene), np.diff(stations) * RATE
    ahead, left, frame = _around_ego(scene)
    near = (np.hypot(ahead, left) <= NEAR) & ~scene.truth.neutral
    row, kind = np.nonzero(
        tracking_events(env.scene, rollout, env.card) & near[:, None]
    )
    events = np.stack(
        [frame[row], kind, ahead[row], left[row], scene.truth.class_id[row]], axis=1
    )
    moving = near & (np.hypot(*scene.truth.velocity.T) > MOVING)
    step = np.minimum(
        (np.arange(scene.frames) * RATE * env.task.dt).round().astype(int),
        len(speed) - 1,
    )
    phantom: Array = np.zeros(0)
    missed: Array = np.zeros(0)
    if drive.phantom_brakes:
        alone = ~occupied(traffic.world(), traffic.way, stations[:-1], traffic.size)
        phantom = _starts((drive.acceleration < HARD_BRAKING) & alone)
    if drive.near_misses:
        missed = _starts(near_misses(traffic.world(), speed, traffic.size))
    objects, moved = (
        np.bincount(frame[mask], minlength=scene.frames).astype(float)
        for mask in (near, moving)
    )
    return Moments(events.astype(float), objects, moved, speed[step], phantom, missed)


def _around_ego(scene: Scene) -> tuple[Array, Array, Ints]:
    """Metres ahead and to the left of the ego, and the frame, of each true box [R]."""
    frame = scene.truth.frame_of_rows
    x, y = (scene.truth.box[:, :2] - scene.ego[frame, :2]).T
    yaw = scene.ego[frame, 3]
    return np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x, frame


def _starts(mask: NDArray[np.bool_]) -> Array:
    """Seconds from the start at which runs of True begin."""
    return np.asarray(
        np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0) == 1) / RATE
    )


def measure(
    card: Card,
    scenes: Sequence[str],
    agents: Sequence[str],
    seeds: Sequence[int],
    folder: Path,
    jobs: int,
    scored: bool,
    say: Callable[[str], None],
) -> None:
    """Fill the folder, scene by scene, and ``say`` how long it takes."""
    left = {
        (seed, name): len(missing_agents(folder, seed, name, agents))
        for seed in seeds
        for name in scenes
    }
    calls = [
        (card, name, agents, folder, seed, scored)
        for (seed, name), count in left.items()
        if count
    ]
    total, done, start = sum(left.values()), 0, time.perf_counter()
    guess = total * CPU_SECONDS / jobs / 60
    say(
        f"{len(calls)} scenes, {total} drives left of {len(left) * len(agents)}; at first guess {guess:.0f} min"
    )
    for place, failures in unordered_map(measure_scene, calls, Workers(jobs)):
        _, name, _, _, seed, _ = calls[place]
        done += left[seed, name]
        spent = (time.perf_counter() - start) / 60
        say(
            f"{done} of {total}, {name}, seed {seed}: {spent:.1f} min, {spent * (total - done) / done:.0f} min to go"
        )
        for agent, reason in failures.items():
            say(f"  {agent} failed: {reason}")
