"""The tree of shared tracks, frame by frame: which leaves the hypotheses of a frame need, and what these remember.

A leaf is a distinct track state after a frame; it belongs to all hypotheses that took the same detections for it.
"""

from typing import NamedTuple

import numpy as np

from ...core import UNBORN, Bools, Floats, Ints
from .compile import kernel, part

# rows of a memory: class, identity, detections taken, frames since the last one
CLASS, ID, HITS, AGE = range(4)
_UNSEEN = -1
_SEEN = -2


@part
def _mixed(leaf: int) -> int:
    """A number for a leaf, such that sums of the numbers of different leaves hardly ever agree."""
    mixed = (leaf + 1) * 40503 % 65537
    return (
        mixed * mixed * mixed % 4294967291
    )  # never beyond 64 bits, so that plain Python agrees


@part
def _sort(values: Ints, n: int) -> None:
    """Sort the first ``n`` values, a handful, in place."""
    for i in range(1, n):
        value = values[i]
        j = i - 1
        while j >= 0 and values[j] > value:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = value


class _Taken(NamedTuple):
    """Detections that the new hypotheses took."""

    choice: Ints  # [N, K] detection of each old leaf, from 1 on; 0: none; negative: not in the hypothesis
    by_any: Bools  # [K, D] whether any leaf of the hypothesis took the detection
    takers: Ints  # [D] how many hypotheses took it


class _Leaves(NamedTuple):
    """The new leaves: first those of each old leaf, from ``start[i]`` to ``start[i + 1]``, then new tracks."""

    leaf: Ints  # old leaf, -1: a new track
    detection: Ints  # -1: none
    start: Ints  # [N + 1]


@part
def _spread(
    column: Ints,
    parent: Ints,
    member: Bools,
    age: Ints,
    max_age: Ints,
    taken: _Taken,
    new: _Leaves,
) -> int:
    """Write the choices, and the new leaves of each old one: a leaf per choice; returns their number.

    Arguments as for `grow`.
    """
    choice, by_any, takers = taken
    leaf, detection, start = new
    place = np.full(
        len(takers) + 1, _UNSEEN
    )  # whether the present old leaf has had a choice before
    choices = np.empty(len(parent), np.int64)
    count = 0
    for i in range(len(age)):
        n = 0
        start[i] = count
        for h in range(len(parent)):
            if not member[parent[h], i]:
                choice[i, h] = _UNSEEN
                continue
            d = column[h, i]
            choice[i, h] = d + 1
            if d >= 0:
                by_any[h, d] = True
                takers[d] += 1
            if place[d + 1] == _UNSEEN:
                place[d + 1] = _SEEN
                choices[n] = d + 1
                n += 1
        _sort(choices, n)
        for j in range(n):
            place[choices[j]] = _UNSEEN
            if choices[j] > 0 or age[i] + 1 < max_age[i]:
                leaf[count] = i
                detection[count] = choices[j] - 1
                count += 1
    start[len(age)] = count
    return count


@part
def _hold(taken: _Taken, new: _Leaves, member: Bools, name: Ints) -> None:
    """Let each hypothesis hold its leaves, and name it by the sum of their numbers."""
    choice, by_any, takers = taken
    _, detection, start = new
    leaves = len(choice)
    count = member.shape[1]
    place = np.full(len(takers) + 1, _UNSEEN)
    number = np.empty(count, np.int64)
    for e in range(count):
        number[e] = _mixed(e)
    for i in range(leaves):
        for e in range(start[i], start[i + 1]):
            place[detection[e] + 1] = e  # new leaf of each choice of this old one
        for h in range(len(name)):
            e = place[choice[i, h]] if choice[i, h] >= 0 else _UNSEEN
            if e >= 0:
                member[h, e] = True
                name[h] += number[e]
        for e in range(start[i], start[i + 1]):
            place[detection[e] + 1] = _UNSEEN
    for e in range(start[leaves], count):  # new tracks
        for h in range(len(name)):
            if not by_any[h, detection[e]]:
                member[h, e] = True
                name[h] += number[e]


@kernel(
    "Tuple((i8[::1], i8[::1], b1[:, ::1], i8[::1]))(i8[:, ::1], i8[::1], b1[:, ::1], i8[::1], i8[::1], i8)"
)
def grow(
    column: Ints,  # [K, N] detection that each leaf takes in each new hypothesis, -1: none
    parent: Ints,  # [K] old hypothesis that each new one comes from
    member: Bools,  # [H, N]
    age: Ints,  # [N] frames since the last detection
    max_age: Ints,  # [N] a track ends after this many
    detections: int,  # D
) -> tuple[Ints, Ints, Bools, Ints]:
    """The distinct leaves [E] that the new hypotheses hold: old leaf, detection (-1: none); membership; its names.

    First the old leaves in their order, each with its choices, "none" before the detections; then the new tracks (old
    leaf -1) of detections that some hypothesis leaves over. A track without a detection for too long is left out.
    Membership is [K, E]; hypotheses that hold the same leaves have the same name [K].
    """
    hypotheses, leaves = column.shape
    most = min(hypotheses, detections + 1) * leaves + detections
    taken = _Taken(
        np.empty((leaves, hypotheses), np.int64),
        np.zeros((hypotheses, detections), np.bool_),
        np.zeros(detections, np.int64),
    )
    new = _Leaves(
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(leaves + 1, np.int64),
    )
    count = _spread(column, parent, member, age, max_age, taken, new)
    for d in range(detections):
        if taken.takers[d] < hypotheses:
            new.leaf[count], new.detection[count] = -1, d
            count += 1
    now = np.zeros((hypotheses, count), np.bool_)
    name = np.zeros(hypotheses, np.int64)
    _hold(taken, new, now, name)
    return new.leaf[:count].copy(), new.detection[:count].copy(), now, name


@kernel("i8[::1](b1[:, ::1], i8[::1])")
def distinct_rows(member: Bools, name: Ints) -> Ints:
    """Rows [H'] of a membership [H, N] that are not equal to an earlier one; equal rows have equal names [H]."""
    kept = np.empty(len(name), np.int64)
    count = 0
    for h in range(len(name)):
        fresh = True
        for j in range(count):
            if name[kept[j]] != name[h]:
                continue
            same = True
            for i in range(member.shape[1]):
                same &= member[kept[j], i] == member[h, i]
            fresh &= not same
        if fresh:
            kept[count] = h
            count += 1
    return kept[:count].copy()


@kernel(
    "i8(i8[::1], i8[::1], i8[:, ::1], f8[::1], i8[::1], f8[::1], i8, i8[:, ::1], f8[::1])"
)
def descend(
    leaf: Ints,  # [E] old leaf of each new one, -1: a new track
    detection: Ints,  # [E] detection that it took, -1: none
    memory: Ints,  # [4, N] of the old leaves, see `CLASS`
    score: Floats,  # [N] sum of the scores of their detections
    box_class: Ints,  # [D]
    box_score: Floats,  # [D]
    next_id: int,  # of new tracks
    new_memory: Ints,  # [4, E], written
    new_score: Floats,  # [E], written
) -> int:
    """Write the memories of the new leaves; returns the next free identity."""
    for e in range(len(leaf)):
        i = leaf[e]
        d = detection[e]
        if i < 0:
            new_memory[CLASS, e], new_memory[ID, e], new_score[e] = (
                box_class[d],
                next_id,
                0.0,
            )
            new_memory[HITS, e], new_memory[AGE, e] = 1, 0
            next_id += 1
        else:
            new_memory[CLASS, e], new_memory[ID, e], new_score[e] = (
                memory[CLASS, i],
                memory[ID, i],
                score[i],
            )
            new_memory[HITS, e] = memory[HITS, i] + (1 if d >= 0 else 0)
            new_memory[AGE, e] = 0 if d >= 0 else memory[AGE, i] + 1
        if d >= 0:
            new_score[e] += box_score[d]
    return next_id


@kernel(
    "Tuple((f8[:, :, ::1], i8[:, ::1]))(i8[::1], f8[:, :, ::1], i8[:, ::1], i8[:, ::1], i8, i8)"
)
def histories(
    leaf: Ints,  # [n] of the last layer
    measured: Floats,  # [P, capacity, 7] a ring of the last layers of the tree
    detection: Ints,  # [P, capacity]
    parent: Ints,  # [P, capacity] leaf of the layer before, -1 at birth
    last: int,  # place of the last layer in the ring
    filled: int,  # layers in the ring
) -> tuple[Floats, Ints]:
    """Boxes of the last P frames along the branches that end in ``leaf`` [n, P, 7], and the detections taken [n, P].

    The detection is -1 where none was taken, and `UNBORN` before birth, where the box is 0.
    """
    layers = len(measured)
    past = np.empty((len(leaf), layers, 7))
    taken = np.empty((len(leaf), layers), np.int64)
    for n in range(len(leaf)):
        at = leaf[n]
        layer = last + 1
        for back in range(layers):
            if at < 0 or back >= filled:
                taken[n, layers - 1 - back] = UNBORN
                for k in range(7):
                    past[n, layers - 1 - back, k] = 0.0
                continue
            layer = layer - 1 if layer > 0 else layers - 1
            box = measured[layer, at]
            into = past[n, layers - 1 - back]
            into[0], into[1], into[2], into[3] = box[0], box[1], box[2], box[3]
            into[4], into[5], into[6] = box[4], box[5], box[6]
            taken[n, layers - 1 - back] = detection[layer, at]
            at = parent[layer, at]
    return past, taken
