"""Do true probabilities drive best? What agents gain by stating others, and which contacts come true.

    python benchmarks/driving.py measure --env MTP-Drive-Intersection-v0 --agents stp,mtp,tracking_free,gt_tracks --changes --scenes 60 -o FOLDER
    python benchmarks/driving_honesty.py gains FOLDER [--list attacks] [--json FILE]
    python benchmarks/driving_honesty.py apart FOLDER [--agents blind,standing,stp,gt_tracks] [--json FILE]
    python benchmarks/driving_honesty.py chances --env MTP-Drive-Intersection-v0 --scenes 40 [--agents stp,gt_tracks] [--json FILE]

`gains`: drive score of each changed agent less that of the agent as it is, in the same scenes, with the sign-flip test;
p also by Holm over the rows of a run. `apart`: drive score of each agent less that of the one before. `chances`: contacts
that the planner expects within three seconds, beside those that come true, on training scenes, for four profiles of each
decision: free, at constant speed, braking gently, and braking hard before going on. "true places" states what will happen,
with certainty: a planner that is right about such forecasts leaves only the error of the forecasts themselves.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.driving_attacks import ATTACKS, CHANGES, SCAN, base_of, change_of
from benchmarks.driving_measure import STP, TRUTH, played, read_kept
from mtp_bench.cards import Card, load_card
from mtp_bench.cards.changes import with_split
from mtp_bench.core import (
    Bools,
    Drive,
    Floats,
    Ints,
    Rollout,
    Truth,
    boxes_meet,
    to_metres,
)
from mtp_bench.core.parallel import Workers, parallel_map
from mtp_bench.env.environment import MTPEnv
from mtp_bench.scoring.driving import scene_score
from mtp_bench.scoring.statistics import paired_difference
from mtp_bench.traffic.highway.driven import hit_from_behind
from mtp_bench.traffic.highway.world import CLASSES as ROAD_USERS, RATE
from mtp_bench.traffic.planner import (
    _FIRST_MPS2,
    _LATER_MPS2,
    Obstacles,
    Planner,
    _reduce_runs,
    _resampled,
    _without_creeping,
)

ORACLE = "true places"
SECONDS = 3.0
TIMES = np.arange(1, round(SECONDS * RATE) + 1) / RATE
NEAR_M = 2.5  # from a forecast to its road user
FAR_M = 12.0  # between centres, from which boxes never meet
MOVING_M = 2.5  # in two seconds
ON_FOOT = ROAD_USERS.index("pedestrian")
CLASSES = ("stands", "goes the ego's way", "crosses or comes", "on foot")
# accelerations of the profiles beside the free one: in the first second, and later
PROFILES = ((0.0, 0.0), (-2.0, 0.0), (-4.5, 1.5))


Rows = dict[str, dict[str, Any]]
LISTS: dict[str, Callable[[str], bool]] = {
    "scan": lambda agent: change_of(agent) in ("", *SCAN),
    "attacks": lambda agent: agent in (TRUTH, STP, *ATTACKS),
}


def gains(folder: Path, listed: str) -> Rows:
    """Row of each changed agent by its label, in the scenes where it and its base have driven.

    ``listed``: "scan" for the mild changes, "attacks" for those of stp that the page lists.
    """
    drives = {
        agent: run for agent, run in _drives(folder).items() if LISTS[listed](agent)
    }
    order = {change: place for place, change in enumerate(CHANGES)}
    agents = sorted(drives, key=lambda name: order.get(change_of(name), -1))
    rows = {agent: _row(drives, agent, base_of(agent)) for agent in agents}
    _add_holm(rows)
    return rows


def apart(folder: Path, agents: Sequence[str]) -> Rows:
    """Row of each agent, with its gain over the agent before it."""
    drives = _drives(folder)
    pairs = zip(agents, [agents[0], *agents], strict=False)
    rows = {agent: _row(drives, agent, before) for agent, before in pairs}
    _add_holm(rows)
    return rows


def _drives(folder: Path) -> dict[str, dict[str, Drive]]:
    """Drives of a folder by agent and scene."""
    drives = defaultdict[str, dict[str, Drive]](dict)
    for path in sorted((folder / "seed0").glob("*/*.pickle")):
        kept = read_kept(path)
        if kept is not None and not kept.failure:
            drives[path.stem][path.parent.name] = kept.drive
    return drives


def _row(drives: dict[str, dict[str, Drive]], agent: str, base: str) -> dict[str, Any]:
    """Figures of an agent, and its gain over another one in the scenes of both."""
    scenes = [scene for scene in drives[agent] if scene in drives[base]]
    run = [drives[agent][scene] for scene in scenes]
    way_m = [drives[TRUTH][scene].way for scene in scenes]
    score = _scores(run, way_m)
    row: dict[str, Any] = {
        "scenes": len(scenes),
        "at fault": 100 * float(np.mean([drive.at_fault for drive in run])),
        "phantom brakes": 100 * float(np.mean([drive.phantom_brakes for drive in run])),
        "score": float(score.mean()),
    }
    if agent != base:
        base_score = _scores([drives[base][scene] for scene in scenes], way_m)
        gain = paired_difference(score, base_score, np.ones(len(scenes)))
        assert gain is not None
        row |= {"gain": gain.mean, "interval": gain.interval, "p": gain.p}
    return row


def _scores(run: Sequence[Drive], way_m: Sequence[float]) -> Floats:
    pairs = zip(run, way_m, strict=True)
    return np.array([scene_score(drive, way) for drive, way in pairs])


def _add_holm(rows: Rows) -> None:
    """Add the p by Holm to rows with a gain: the chance that any of them is as large."""
    tested = sorted((row["p"], agent) for agent, row in rows.items() if "gain" in row)
    largest = 0.0
    for place, (p, agent) in enumerate(tested):
        largest = max(largest, min(1.0, p * (len(tested) - place)))
        rows[agent]["p by Holm"] = largest


@dataclass(frozen=True, eq=False)
class Recorded:
    """A drive as it happened, with the planner of its ego."""

    rollout: Rollout
    station: Floats  # [N + 1] m, of the ego in each state
    planner: Planner
    truth: Truth  # of each state
    dt: float  # s between decisions

    @classmethod
    def of(cls, env: MTPEnv, rollout: Rollout) -> Recorded:
        """The drive that ``env`` has just ended."""
        episode: Any = env._episode
        station = np.array(episode.stations)
        truth = episode.traffic.world().truth
        return cls(rollout, station, episode.planner, truth, env.task.dt)

    @property
    def states(self) -> list[int]:
        """States of the decisions that have `SECONDS` left."""
        last = self.truth.frames - 1 - round(SECONDS * RATE)
        decided = (np.arange(self.rollout.frames) * self.dt * RATE).round().astype(int)
        states: list[int] = decided[decided <= last].tolist()
        return states

    def stated(self, frame: int) -> tuple[Obstacles, Bools]:
        """Forecasts of the agent in a decision, and which objects are on foot."""
        rows = self.rollout.objects.rows(frame)
        box = self.rollout.object_box[rows].astype(float)
        path = box[:, None, None, :2] + to_metres(self.rollout.forecast[rows])
        weight = np.exp(self.rollout.forecast_log_weight[rows].astype(float))
        weight *= self.rollout.object_confidence[rows][:, None]
        on_foot = self.rollout.object_class[rows] == ON_FOOT
        return Obstacles(box, path, weight, self.dt), on_foot

    def true_places(self, state: int) -> tuple[Obstacles, Bools]:
        """Certain forecasts of what happens, and which road users are on foot."""
        rows = self.truth.rows(state)
        number = self.truth.object_id[rows]
        steps = RATE * self.dt * np.arange(1, round(SECONDS / self.dt) + 1)
        later = [self.boxes(number, state + round(step)) for step in steps]
        path = np.stack(later, axis=1)[:, None, :, :2]
        stays = np.isfinite(path).all(axis=(1, 2, 3))
        weight = np.ones((stays.sum(), 1))
        seen = Obstacles(self.truth.box[rows][stays], path[stays], weight, self.dt)
        return seen, self.truth.class_id[rows][stays] == ON_FOOT

    def boxes(self, number: Ints, state: int) -> Floats:
        """Boxes [n, 7] of road users in a state, NaN where they are not there."""
        rows = self.truth.rows(state)
        place = {
            each: row for row, each in enumerate(self.truth.object_id[rows].tolist())
        }
        box = np.vstack([self.truth.box[rows], np.full(7, np.nan)])
        return box[[place.get(each, -1) for each in number.tolist()]]

    def contacts(self, state: int, seen: Obstacles, on_foot: Bools) -> Contacts:
        """Contacts of the forecast objects in a state."""
        s = float(self.station[state])
        speed = RATE * float(self.station[min(state + 1, len(self.station) - 1)] - s)
        planner = self.planner
        forecast = _without_creeping(_resampled(seen), planner._weights.creep)
        steps = forecast.path.shape[2]
        stations, _ = planner.profiles(s, speed, forecast.dt, steps)
        progress = (stations[:, -1] - s) / (forecast.dt * steps) - planner._effort
        pairs = np.column_stack([_FIRST_MPS2, _LATER_MPS2])
        others = [int((pairs == pair).all(axis=1).argmax()) for pair in PROFILES]
        stations = stations[list(dict.fromkeys([int(progress.argmax()), *others]))]
        _, follows = planner._in_lane(s, forecast.box)
        met = planner._contacts(s, float(stations.max()), forecast, follows)
        within = met.step < round(SECONDS / forecast.dt)
        met = type(met)(**{name: values[within] for name, values in vars(met).items()})
        expected = np.zeros(len(seen.box))
        if len(met.step):
            chance, sample = _reduce_runs(
                np.maximum, planner._touches(stations, met)[0], met.sample
            )
            weighed = chance * forecast.weight.ravel()[sample]
            share, row = _reduce_runs(
                np.add, weighed, sample // forecast.weight.shape[1]
            )
            expected[row] = np.minimum(share, 1.0).sum(axis=0)
        time = forecast.dt * np.arange(steps + 1)
        true = self._true(
            state, forecast, [np.interp(TIMES, time, each) for each in stations]
        )
        return Contacts(self._kinds(forecast, on_foot), expected, true * ~follows)

    def _true(
        self, state: int, forecast: Obstacles, stations: Sequence[Floats]
    ) -> Floats:
        """Profiles [O] in which the road user of a forecast is met, not from behind."""
        rows = self.truth.rows(state)
        number = self.truth.object_id[rows]
        away = self.truth.box[rows][None, :, :2] - forecast.box[:, None, :2]
        distance = np.hypot(away[..., 0], away[..., 1])
        row, column = linear_sum_assignment(np.minimum(distance, NEAR_M))
        near = distance[row, column] < NEAR_M
        row = row[near]
        path = np.stack(
            [
                self.boxes(number[column[near]], state + k)
                for k in range(1, len(TIMES) + 1)
            ]
        )
        true = np.zeros(len(forecast.box))
        for each in stations:
            ego = _boxes_at(self.planner, each)
            close = (
                np.hypot(*(path[..., :2] - ego[:, None, :2]).transpose(2, 0, 1)) < FAR_M
            )
            step, which = np.nonzero(close)
            meets = boxes_meet(path[step, which], ego[step])
            step, which = step[meets], which[meets]
            front = [
                k
                for k in range(len(step))
                if not hit_from_behind(ego[step[k]], path[step[k], which[k]])
            ]
            true[row[np.unique(which[front])]] += 1.0
        return true

    def _kinds(self, forecast: Obstacles, on_foot: Bools) -> Ints:
        """Class of motion [O] of forecast objects, indices into `CLASSES`."""
        weight = forecast.weight / np.maximum(
            forecast.weight.sum(axis=1, keepdims=True), 1e-9
        )
        last = min(round(2.0 / forecast.dt), forecast.path.shape[2]) - 1
        move = (
            weight[..., None] * (forecast.path[:, :, last] - forecast.box[:, None, :2])
        ).sum(axis=1)
        moves = np.hypot(*move.T) > MOVING_M
        _, _, heading = self.planner._way.along(*forecast.box.T[:2])
        along = (
            np.cos(
                np.where(moves, np.arctan2(*move.T[::-1]), forecast.box[:, 3]) - heading
            )
            > 0.5
        )
        return np.select([on_foot, ~moves, along], [3, 0, 1], default=2)


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of O objects, summed over profiles."""

    kind: Ints
    expected: Floats
    true: Floats

    def sums(self) -> Floats:
        """Expected and true contacts by class of motion [4, 2]."""
        columns = (self.expected, self.true)
        return np.stack(
            [np.bincount(self.kind, values, len(CLASSES)) for values in columns], axis=1
        )


def _boxes_at(planner: Planner, stations: Floats) -> Floats:
    """Boxes [n, 7] of the ego."""
    box = np.zeros((len(stations), 7))
    place, heading = planner._way.at(stations)
    box[:, :2], box[:, 3], box[:, 4:6] = place, heading, planner._size
    return box


def chances_of_scene(card: Card, name: str, agents: Sequence[str]) -> dict[str, Floats]:
    """Expected and true contacts [4, 2] by class of motion, of each agent in a scene."""
    sums: dict[str, Floats] = {}
    for agent in agents:
        env, rollout = played(agent, card, name, 0)
        recorded = Recorded.of(env, rollout)
        sums[agent] = np.zeros((len(CLASSES), 2))
        for frame, state in enumerate(recorded.states):
            sums[agent] += recorded.contacts(state, *recorded.stated(frame)).sums()
        if agent == TRUTH:
            sums[ORACLE] = np.zeros((len(CLASSES), 2))
            for state in recorded.states:
                sums[ORACLE] += recorded.contacts(
                    state, *recorded.true_places(state)
                ).sums()
    return sums


def chances(
    card: Card, agents: Sequence[str], scenes: int, jobs: int
) -> dict[str, Any]:
    """Expected and true contacts on training scenes, by agent and class of motion."""
    card = with_split(card, "train")
    names = MTPEnv(card).scene_names[:scenes]
    calls = [(card, name, agents) for name in names]
    found = parallel_map(chances_of_scene, calls, Workers(jobs))
    total = {agent: sum(each[agent] for each in found) for agent in found[0]}
    return {
        agent: dict(zip(CLASSES, sums.tolist(), strict=True))
        for agent, sums in total.items()
    }


def print_gains(rows: Rows) -> None:
    """A line per agent, the largest gain first."""
    for agent, row in sorted(rows.items(), key=lambda item: -item[1].get("gain", 9.0)):
        text = f"{agent:45s} {row['scenes']:4d} scenes  score {row['score']:.3f}  at fault {row['at fault']:.1f}"
        text += f"  phantom brakes {row['phantom brakes']:.0f}"
        if "gain" in row:
            low, high = row["interval"] or (0.0, 0.0)
            text += f"  gain {row['gain']:+.3f} [{low:+.3f}, {high:+.3f}]  p {row['p']:.3f}, by Holm {row['p by Holm']:.3f}"
        print(text)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True, dest="command")
    one = commands.add_parser("gains")
    one.add_argument("folder", type=Path)
    one.add_argument("--list", choices=LISTS, default="scan")
    pairs = commands.add_parser("apart")
    pairs.add_argument("folder", type=Path)
    pairs.add_argument("--agents", default=f"blind,standing,{STP},{TRUTH}")
    two = commands.add_parser("chances")
    two.add_argument("--env", default="MTP-Drive-Intersection-v0")
    two.add_argument("--agents", default=f"{STP},tracking_free,{TRUTH}")
    two.add_argument("--scenes", type=int, default=40)
    two.add_argument("--jobs", type=int, default=1)
    for each in (one, pairs, two):
        each.add_argument("--json", type=Path)
    given = parser.parse_args()
    if given.command == "gains":
        made = gains(given.folder, given.list)
        print_gains(made)
    elif given.command == "apart":
        made = apart(given.folder, given.agents.split(","))
        print_gains(made)
    else:
        made = chances(
            load_card(given.env), given.agents.split(","), given.scenes, given.jobs
        )
        for agent, sums in made.items():
            parts = [f"{name} {e:.0f} : {t:.0f}" for name, (e, t) in sums.items()]
            print(f"{agent}: expected : true contacts, " + ", ".join(parts))
    if given.json:
        given.json.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
