"""The tree of shared tracks, frame by frame.

Which leaves the hypotheses of a frame need, and what these remember. A leaf is a
distinct track state after a frame; it belongs to all hypotheses that took the same
detections for it.
"""

from typing import NamedTuple

import numpy as np

from ...core import UNBORN, Bools, Floats, Ints
from .compile import kernel, part

# rows of a memory: class, identity, detections taken, frames since the last one
CLASS, ID, HITS, AGE = range(4)
_UNUSED = -1
_USED = -2


@part
def _leaf_number(leaf: int) -> int:
    """Hash a leaf: sums of different leaves hardly ever agree."""
    mixed = (leaf + 1) * 40503 % 65537
    # never beyond 64 bits, so that plain Python agrees
    return mixed * mixed * mixed % 4294967291


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


class _TakenDetections(NamedTuple):
    """Detections that the new hypotheses took."""

    # [N, K] detection of each old leaf, from 1 on; 0: none; -1: not in the
    # hypothesis
    choice: Ints
    by_hypothesis: Bools  # [K, D] whether any leaf of it took the detection
    taker_count: Ints  # [D] hypotheses that took it


class _Leaves(NamedTuple):
    """The new leaves: those of old leaf i from ``start[i]`` on, then new tracks."""

    leaf: Ints  # old leaf, -1: a new track
    detection: Ints  # -1: none
    start: Ints  # [N + 1]


@part
def _write_choices(
    i: int, column: Ints, parent: Ints, member: Bools, detections: _TakenDetections
) -> None:
    """Write the choice of old leaf ``i`` in each hypothesis."""
    choice, by_hypothesis, taker_count = detections
    for h in range(len(parent)):
        if not member[parent[h], i]:
            choice[i, h] = _UNUSED
            continue
        d = column[h, i]
        choice[i, h] = d + 1
        if d >= 0:
            by_hypothesis[h, d] = True
            taker_count[d] += 1


@part
def _distinct_choices(choice: Ints, mark: Ints, distinct: Ints) -> int:
    """Write the sorted distinct choices and return their number.

    Negative values of ``choice`` [K] are left out. ``mark`` [D + 1] is unused before
    and after.
    """
    n = 0
    for value in choice:
        if value >= 0 and mark[value] == _UNUSED:
            mark[value] = _USED
            distinct[n] = value
            n += 1
    _sort(distinct, n)
    for j in range(n):
        mark[distinct[j]] = _UNUSED
    return n


@part
def _spread(
    column: Ints,
    parent: Ints,
    member: Bools,
    age: Ints,
    max_age: Ints,
    detections: _TakenDetections,
    leaves: _Leaves,
) -> int:
    """Write a leaf per choice of old leaves and count them.

    Arguments as for `grow`.
    """
    choice = detections.choice
    mark = np.full(len(detections.taker_count) + 1, _UNUSED)
    distinct = np.empty(len(parent), np.int64)
    count = 0
    for i in range(len(age)):
        leaves.start[i] = count
        _write_choices(i, column, parent, member, detections)
        n = _distinct_choices(choice[i], mark, distinct)
        for j in range(n):
            if distinct[j] > 0 or age[i] + 1 < max_age[i]:
                leaves.leaf[count] = i
                leaves.detection[count] = distinct[j] - 1
                count += 1
    leaves.start[len(age)] = count
    return count


@part
def _hold(
    detections: _TakenDetections, leaves: _Leaves, member: Bools, name: Ints
) -> None:
    """Let each hypothesis hold its leaves, and name it.

    The name is the sum of their `_leaf_number`s.
    """
    choice, by_hypothesis, taker_count = detections
    _, detection, start = leaves
    old_count = len(choice)
    count = member.shape[1]
    # the last one, for choice -1, stays unused
    leaf_of_choice = np.full(len(taker_count) + 2, _UNUSED)
    number = np.empty(count, np.int64)
    for e in range(count):
        number[e] = _leaf_number(e)
    for i in range(old_count):
        for e in range(start[i], start[i + 1]):
            leaf_of_choice[detection[e] + 1] = e
        for h in range(len(name)):
            e = leaf_of_choice[choice[i, h]]
            if e >= 0:
                member[h, e] = True
                name[h] += number[e]
        for e in range(start[i], start[i + 1]):
            leaf_of_choice[detection[e] + 1] = _UNUSED
    for e in range(start[old_count], count):  # new tracks
        for h in range(len(name)):
            if not by_hypothesis[h, detection[e]]:
                member[h, e] = True
                name[h] += number[e]


@kernel(
    "Tuple((i8[::1], i8[::1], b1[:, ::1], i8[::1]))"
    "(i8[:, ::1], i8[::1], b1[:, ::1], i8[::1], i8[::1], i8)"
)
def grow(
    column: Ints,  # [K, N] detection of each leaf in each new hypothesis, -1: none
    parent: Ints,  # [K] old hypothesis that each new one comes from
    member: Bools,  # [H, N]
    age: Ints,  # [N] frames since the last detection
    max_age: Ints,  # [N] a track ends after this many
    detections: int,  # D
) -> tuple[Ints, Ints, Bools, Ints]:
    """Find the distinct leaves [E] that the new hypotheses hold.

    First the old leaves in their order, each with its choices, "none" before the
    detections; then the new tracks (old leaf -1) of detections that some hypothesis
    leaves over. A track without a detection for too long is left out.

    Returns the old leaf and the detection (-1: none) of each, the membership [K, E],
    and names [K]: hypotheses that hold the same leaves have the same name.
    """
    hypotheses, old_count = column.shape
    max_count = min(hypotheses, detections + 1) * old_count + detections
    taken_detections = _TakenDetections(
        np.empty((old_count, hypotheses), np.int64),
        np.zeros((hypotheses, detections), np.bool_),
        np.zeros(detections, np.int64),
    )
    leaves = _Leaves(
        np.empty(max_count, np.int64),
        np.empty(max_count, np.int64),
        np.empty(old_count + 1, np.int64),
    )
    count = _spread(column, parent, member, age, max_age, taken_detections, leaves)
    for d in range(detections):
        if taken_detections.taker_count[d] < hypotheses:
            leaves.leaf[count] = -1
            leaves.detection[count] = d
            count += 1
    new_member = np.zeros((hypotheses, count), np.bool_)
    name = np.zeros(hypotheses, np.int64)
    _hold(taken_detections, leaves, new_member, name)
    return leaves.leaf[:count].copy(), leaves.detection[:count].copy(), new_member, name


@kernel("i8[::1](b1[:, ::1], i8[::1])")
def distinct_rows(member: Bools, name: Ints) -> Ints:
    """Find the rows that equal no earlier one.

    They are rows [H'] of a membership [H, N]. Equal rows have equal names [H].
    """
    rows = np.empty(len(name), np.int64)
    count = 0
    for h in range(len(name)):
        is_distinct = True
        for j in range(count):
            if name[rows[j]] != name[h]:
                continue
            is_equal = True
            for i in range(member.shape[1]):
                is_equal &= member[rows[j], i] == member[h, i]
            is_distinct &= not is_equal
        if is_distinct:
            rows[count] = h
            count += 1
    return rows[:count].copy()


@kernel(
    "i8(i8[::1], i8[::1], i8[:, ::1], f8[::1], i8[::1], f8[::1], i8, "
    "i8[:, ::1], f8[::1])"
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
    """Write the memories of new leaves and return the next identity."""
    for e in range(len(leaf)):
        i = leaf[e]
        d = detection[e]
        if i < 0:
            new_memory[CLASS, e] = box_class[d]
            new_memory[ID, e] = next_id
            new_memory[HITS, e] = 0
            new_score[e] = 0.0
            next_id += 1
        else:
            new_memory[CLASS, e] = memory[CLASS, i]
            new_memory[ID, e] = memory[ID, i]
            new_memory[HITS, e] = memory[HITS, i]
            new_memory[AGE, e] = memory[AGE, i] + 1
            new_score[e] = score[i]
        if d >= 0:
            new_memory[HITS, e] += 1
            new_memory[AGE, e] = 0
            new_score[e] += box_score[d]
    return next_id


@kernel(
    "Tuple((f8[:, :, ::1], i8[:, ::1]))"
    "(i8[::1], f8[:, :, ::1], i8[:, ::1], i8[:, ::1], i8, i8)"
)
def histories(
    leaf: Ints,  # [n] of the last layer
    measured: Floats,  # [P, capacity, 7] a ring of the last layers of the tree
    detection: Ints,  # [P, capacity]
    parent: Ints,  # [P, capacity] leaf of the layer before, -1 at birth
    last_layer: int,  # its place in the ring
    layer_count: int,  # of those filled in the ring
) -> tuple[Floats, Ints]:
    """Return boxes and detections of the last P frames.

    They lie along the branches that end in ``leaf``. The boxes are [n, P, 7]. The
    detection [n, P] is -1 where
    none was taken, and `UNBORN` before birth, where the box is 0.
    """
    layers = len(measured)
    past = np.zeros((len(leaf), layers, 7))
    past_detection = np.full((len(leaf), layers), UNBORN)
    for n in range(len(leaf)):
        branch_leaf = leaf[n]
        layer = last_layer
        frame = layers - 1
        while branch_leaf >= 0 and frame >= layers - layer_count:
            for k in range(7):
                past[n, frame, k] = measured[layer, branch_leaf, k]
            past_detection[n, frame] = detection[layer, branch_leaf]
            branch_leaf = parent[layer, branch_leaf]
            layer = layer - 1 if layer > 0 else layers - 1
            frame -= 1
    return past, past_detection
