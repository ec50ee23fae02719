"""A binary heap of numbers in the order of their keys, equal keys in the order of the numbers."""

import numpy as np

from ...core import Floats, Ints
from .compile import part


@part
def push(keys: Floats, names: Ints, size: int, key: float, name: int) -> int:
    """Put ``key``, called ``name``, into the heap of ``size`` entries; its new size."""
    i = size
    while i > 0:
        above = (i - 1) >> 1
        if keys[above] < key or (keys[above] == key and names[above] < name):
            break
        keys[i] = keys[above]
        names[i] = names[above]
        i = above
    keys[i] = key
    names[i] = name
    return size + 1


@part
def pop(keys: Floats, names: Ints, size: int) -> int:
    """Move the least entry behind the heap, to number ``size`` - 1; its new size, which is that number."""
    size -= 1
    least_key = keys[0]
    least_name = names[0]
    key = keys[size]
    name = names[size]
    i = 0
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        right = below + 1
        if right < size and (
            keys[right] < keys[below]
            or (keys[right] == keys[below] and names[right] < names[below])
        ):
            below = right
        if key < keys[below] or (key == keys[below] and name < names[below]):
            break
        keys[i] = keys[below]
        names[i] = names[below]
        i = below
    keys[i] = key
    names[i] = name
    keys[size] = least_key
    names[size] = least_name
    return size


@part
def sorted_numbers(keys: Floats, size: int) -> Ints:
    """Numbers of the first ``size`` keys, by ascending keys, equal keys by their numbers; no key is NaN."""
    waiting = np.empty(size)
    names = np.empty(size, np.int64)
    order = np.empty(size, np.int64)
    for i in range(size):
        push(waiting, names, i, keys[i], i)
    for i in range(size):
        order[i] = names[pop(waiting, names, size - i)]
    return order
