"""What is remembered of identities that somebody else gives: their pasts, hits and ages, as `Tracks` need them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from ..tracks import UNBORN, Tracks
from ..types import Floats, Ints
from .repair import bridged


@dataclass
class _Life:
    """One identity."""

    first: int  # frame in which it was first said
    said: deque[tuple[int, int, Floats]]  # frame, row of the detection or -1, box; the last P
    hits: int = 0
    scores: float = 0.0  # sum over the detections that it took
    last_score: float = 0.0


@dataclass(frozen=True, eq=False)
class Said:
    """What is said of N tracks of a frame: who and where they are, and what they took of D detections."""

    track_id: Ints  # [N] each once
    box: Floats  # [N, 7] now
    class_id: Ints  # [N]
    score: Floats  # [N] stands in for that of detections until the track takes one
    detection: Ints  # [N] row of the observation, -1 for none
    measured: Floats  # [N, 7] box of the detection taken; of a track that took none, its own


class Histories:
    """The lives of all identities of a scene; an identity that returns after a gap goes on."""

    def __init__(self, past: int) -> None:
        self._past, self._frame = past, 0
        self._lives: dict[int, _Life] = {}

    def after(self, said: Said, detection_score: Floats) -> Tracks:
        """Tracks of one hypothesis after the next frame; ``detection_score`` [D] of all rows of its observation."""
        self._frame += 1
        ids = said.track_id.tolist()
        lives = [self._lives.setdefault(i, _Life(self._frame, deque(maxlen=self._past))) for i in ids]
        for at, life in enumerate(lives):
            self._tell(life, int(said.detection[at]), said.measured[at], float(said.score[at]), detection_score)
        past, taken = self._window(lives)
        return Tracks(
            track_id=said.track_id,
            box=said.box,
            class_id=said.class_id,
            score=np.array([life.scores / life.hits if life.hits else life.last_score for life in lives]),
            detection=said.detection,
            past=past,
            past_valid=taken >= 0,
            member=np.ones((1, len(lives)), dtype=bool),
            log_weight=np.zeros(1),
            parent=np.zeros(1, dtype=np.int64),
            last_score=np.array([life.last_score for life in lives]),
            hits=np.array([max(life.hits, 1) for life in lives], dtype=np.int64),
            age=np.array([self._frame - life.first + 1 for life in lives], dtype=np.int64),
            past_detection=taken,
        )

    def _tell(self, life: _Life, row: int, measured: Floats, score: float, detection_score: Floats) -> None:
        life.said.append((self._frame, row, measured))
        if row >= 0:
            life.hits += 1
            life.last_score = float(detection_score[row])
            life.scores += life.last_score
        elif not life.hits:
            life.last_score = score

    def _window(self, lives: list[_Life]) -> tuple[Floats, Ints]:
        """Boxes [N, P, 7] of the last P frames and the rows taken [N, P].

        Between two frames in which an identity was said its box moves on a straight line; before the first one of the
        window it was not there: how it got here from a place long ago is not known.
        """
        length = self._past
        past, taken = np.zeros((len(lives), length, 7)), np.full((len(lives), length), UNBORN)
        said = np.zeros(taken.shape, dtype=bool)
        for at, life in enumerate(lives):
            for frame, row, box in life.said:
                column = length - 1 - self._frame + frame
                if column >= 0:
                    past[at, column:], taken[at, column:], taken[at, column], said[at, column] = box, -1, row, True
        return bridged(past, said)[0], taken
