"""The tracker written from its description alone, with textbook matrices and one track at a time, to compare with."""

from dataclasses import dataclass, replace

import numpy as np

from mtp_bench.core import Floats, Ints, Observation, Task, Tracks
from mtp_bench.tracking.parameters import detector_parameters
from tests.support.plain_affinity import gains
from tests.support.textbook_k_best import k_best

MOVE = np.eye(10) + np.eye(10, k=7)  # x += vx, y += vy, z += vz
PROCESS = np.diag([1.0] * 7 + [0.01] * 3)
AT_BIRTH = np.diag([10.0] * 7 + [10_000.0] * 3)
VELOCITY_DEVIATION = 0.5  # m/s

State = tuple[Floats, Floats]  # mean [10] x y z yaw l w h vx vy vz per frame, covariance [10, 10]


@dataclass(frozen=True, eq=False)
class _Leaf:
    """A track as one or more hypotheses have it after a frame."""

    track_id: int
    class_id: int
    state: State
    hits: int = 0
    score: float = 0.0  # sum over the detections taken
    age: int = 0  # frames since the last one
    detection: int = -1
    object: int = -1  # given to the detection that started it
    past: tuple[tuple[bool, Floats], ...] = ()  # whether a detection was taken, and its box (else the track's)

    @property
    def box(self) -> Floats:
        return self.state[0][:7]


class PlainTracker:
    """AB3DMOT by the book with the ``hypotheses`` best global associations.

    ``greedy`` asks for greedy assignment where the parameters say so, which works with one hypothesis.
    """

    def __init__(self, hypotheses: int = 1, greedy: bool = False) -> None:
        self._hypotheses = hypotheses
        self._greedy = greedy

    def reset(self, task: Task) -> None:
        self._task, self._parameters = task, detector_parameters(task.detector, task.classes)
        self._frame = self._born = 0
        self._leaves: list[_Leaf] = []
        self._held: list[list[int]] = [[]]  # leaves of each hypothesis
        self._cost = np.zeros(1)  # [H]

    def step(self, observation: Observation) -> Tracks:
        """Tracks to output after this frame: hit often enough, and not unseen for too long."""
        valid = np.asarray(observation["detection_valid"]).astype(bool)
        seen = {
            name: np.asarray(value, dtype=int if name == "detection_class" else np.float64)[valid]
            for name, value in observation.items()
            if name.startswith("detection_")
        }
        self._given = seen.get("detection_id", np.full(len(seen["detection_box"]), -1.0))
        self._frame += 1
        ahead = [replace(leaf, state=predicted(leaf.state), age=leaf.age + 1) for leaf in self._leaves]
        column, parent = self._associate(ahead, seen["detection_box"], seen["detection_class"])
        self._grow(ahead, column, parent, seen)
        return self._output()

    def _associate(self, ahead: list[_Leaf], box: Floats, box_class: Ints) -> tuple[Ints, Ints]:
        """Detection of each leaf and parent of the new hypotheses, cheapest first; their costs are kept."""
        class_id = np.array([leaf.class_id for leaf in ahead], dtype=int)
        mean = np.reshape([leaf.box for leaf in ahead], (-1, 7))
        gain = gains(mean, class_id, box, box_class, self._parameters)
        for i, leaf in enumerate(ahead):
            gain[i, [d for d in range(len(box)) if max(leaf.object, self._given[d]) >= 0]] = -np.inf
            gain[i, [d for d in range(len(box)) if leaf.object == self._given[d] >= 0]] = 1e6
        if self._greedy:
            chosen = [self._parameters[c].assignment == "greedy" for c in class_id]
            gain = _only_greedy_pairs(gain, np.flatnonzero(chosen))
        member = np.zeros((len(self._held), len(ahead)), dtype=bool)
        for hypothesis, leaves in enumerate(self._held):
            member[hypothesis, leaves] = True
        cost, column, parent = k_best(-gain, self._hypotheses, member, self._cost)
        self._cost = cost - cost[0]
        return column, parent

    def _grow(self, ahead: list[_Leaf], column: Ints, parent: Ints, seen: dict[str, np.ndarray]) -> None:
        """Replace the leaves by the distinct children of the hypotheses: (old leaf, detection), then the births."""
        n, found = len(ahead), []
        for row, p in zip(column.tolist(), parent, strict=True):
            mine = {(i, row[i]) for i in self._held[p]}
            born = set(range(len(seen["detection_box"]))) - {d for _, d in mine}
            found.append({(i, d) for i, d in mine if d >= 0 or self._survives(ahead[i])} | {(n, d) for d in born})
        children = sorted(set().union(*found))
        self._leaves = [self._child(None if i == n else ahead[i], d, seen) for i, d in children]
        kept = [h for h, leaves in enumerate(found) if leaves not in found[:h]]  # of equal ones the cheapest
        self._held = [[children.index(child) for child in sorted(found[h])] for h in kept]
        self._cost = self._cost[kept]

    def _survives(self, leaf: _Leaf) -> bool:
        return leaf.age < self._parameters[leaf.class_id].max_age

    def _child(self, leaf: _Leaf | None, detection: int, seen: dict[str, np.ndarray]) -> _Leaf:
        """The track after taking a detection, -1 for none; without a leaf it is a new one."""
        box = None if detection < 0 else seen["detection_box"][detection]
        if box is not None:
            velocity = seen["detection_velocity"][detection] if self._task.velocity else np.zeros(2)
            state = updated(None if leaf is None else leaf.state, box, velocity, self._task.dt)
            if leaf is None:
                given = int(self._given[detection])
                leaf = _Leaf(self._born, int(seen["detection_class"][detection]), state, object=given)
                self._born += 1
            score = leaf.score + float(seen["detection_score"][detection])
            leaf = replace(leaf, state=state, hits=leaf.hits + 1, score=score, age=0)
        assert leaf is not None
        past = (*leaf.past, (box is not None, leaf.box if box is None else box))
        return replace(leaf, detection=detection, past=past[-self._task.past :])

    def _output(self) -> Tracks:
        rules = [self._parameters[leaf.class_id].min_hits for leaf in self._leaves]
        shown = [i for i, least in enumerate(rules) if self._leaves[i].hits >= least or self._frame <= least]
        out = [self._leaves[i] for i in shown]
        past, valid = np.zeros((len(out), self._task.past, 7)), np.zeros((len(out), self._task.past), dtype=bool)
        for row, leaf in enumerate(out):
            for back, (took, box) in enumerate(reversed(leaf.past), start=1):
                past[row, -back], valid[row, -back] = box, took
        return Tracks(
            track_id=np.array([leaf.track_id for leaf in out], dtype=int),
            box=np.reshape([leaf.box for leaf in out], (-1, 7)),
            class_id=np.array([leaf.class_id for leaf in out], dtype=int),
            score=np.array([leaf.score / leaf.hits for leaf in out]),
            detection=np.array([leaf.detection for leaf in out], dtype=int), past=past, past_valid=valid,
            member=np.array([[i in held for i in shown] for held in self._held], dtype=bool),
            log_weight=-self._cost - np.logaddexp.reduce(-self._cost),
        )  # fmt: skip


def predicted(state: State) -> State:
    mean, covariance = state
    return MOVE @ mean, MOVE @ covariance @ MOVE.T + PROCESS


def updated(state: State | None, box: Floats, velocity: Floats, dt: float) -> State:
    """The state after a detected box [7] and its velocity [2] in m/s, 0 0 if not measured; None: a new track."""
    variance = np.array([1.0] * 7 + [np.inf] * 3)
    if state is None:
        state = np.append(box, np.zeros(3)), AT_BIRTH
        variance[:7] = np.inf  # the box is where it begins
    if velocity.any():
        variance[7:] = (VELOCITY_DEVIATION * dt) ** 2
    (mean, covariance), rows = state, np.flatnonzero(np.isfinite(variance))
    innovation = np.concatenate([box, velocity * dt, [0.0]]) - mean
    while abs(innovation[3]) > np.pi / 2:  # nearest of the two directions of the box's axis
        innovation[3] -= np.pi * np.sign(innovation[3])
    noisy = covariance[np.ix_(rows, rows)] + np.diag(variance[rows])
    gain = covariance[:, rows] @ np.linalg.inv(noisy)
    mean = mean + gain @ innovation[rows]
    if 3 in rows:
        mean[3] = np.arctan2(np.sin(mean[3]), np.cos(mean[3]))
    rest = np.eye(10) - gain @ np.eye(10)[rows]
    # the form that loses the fewest digits
    return mean, rest @ covariance @ rest.T + gain @ np.diag(variance[rows]) @ gain.T


def _only_greedy_pairs(gain: Floats, rows: Ints) -> Floats:
    """Gains where ``rows`` keep only their pair if the best pair comes first, then the best of the rest."""
    result, left = gain.copy(), np.full_like(gain, -np.inf)
    left[rows], result[rows] = gain[rows], -np.inf
    while left.size and left.max() >= 0:
        i, j = np.unravel_index(np.argmax(left), left.shape)
        result[i, j] = left[i, j] + 1.0  # taken even where it gains nothing
        left[i], left[:, j] = -np.inf, -np.inf
    return result
