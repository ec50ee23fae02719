"""CLEAR MOT and the protocol's events of tracks that are given frame by frame (protocol, "Events")."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np

from ..errors import ShapeError
from .events import clear_identity, find_events
from .frames import Frame, read_frames
from .matching import match, match_sticky
from .pairs import Pairs, near_pairs

Mode = Literal["frame", "sticky"]


def tracking_counts(frames: Iterable[Frame], gate: float = 2.0, mode: Mode = "frame") -> dict[str, int | float | None]:
    """``TP FP FN IDS FRAG MOTA MOTP ids lost reacquired`` of tracks against truth, by BEV centre distance.

    ``frames`` iterates (scene, t, true ids [M], true xy [M, 2], track ids [N], track xy [N, 2]) in metres; ids are
    integers or strings; lists or arrays, which may be empty; scenes may be interleaved. ``gate`` is inclusive. All
    numbers come from the matching of ``mode``: "frame" has no memory, "sticky" keeps the pairs of the previous frame.
    ``IDS`` and ``FRAG`` are CLEAR's, ``ids``, ``lost`` and ``reacquired`` the protocol's events; MOTP is the mean
    distance of matched pairs, metres. MOTA is None without truth, MOTP without a match. Raises ShapeError for a
    negative gate, an unknown mode, a position that is not finite or an id twice in a frame.
    """
    if not (np.isfinite(gate) and gate >= 0):
        raise ShapeError(f"gate is {gate}, expected a distance of 0 m or more")
    truth, tracks = read_frames(frames)
    pairs = Pairs(*near_pairs(truth.frame, truth.xy, tracks.frame, tracks.xy, gate))
    if mode == "frame":
        matched = match(pairs, len(truth))
    elif mode == "sticky":
        matched = match_sticky(pairs, len(truth), truth.history.previous(), tracks.history.previous())
    else:
        raise ShapeError(f"mode is {mode!r}, expected 'frame' or 'sticky'")
    events = find_events(truth.history, matched, tracks.history, tracks.identity)
    switches, fragments = clear_identity(truth.history, matched, tracks.identity)
    row = np.flatnonzero(matched >= 0)
    tp = len(row)
    fn, fp = len(truth) - tp, len(tracks) - tp
    gap = truth.xy[row] - tracks.xy[matched[row]]
    return {
        "TP": tp,
        "FP": fp,
        "FN": fn,
        "IDS": len(switches),
        "FRAG": len(fragments),
        "MOTA": 1.0 - (fn + fp + len(switches)) / len(truth) if len(truth) else None,
        "MOTP": float(np.hypot(gap[:, 0], gap[:, 1]).mean()) if tp else None,
        "ids": len(events.ids),
        "lost": len(events.lost),
        "reacquired": len(events.reacquired),
    }
