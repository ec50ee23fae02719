"""A binary heap of named keys; equal keys come in the order of their names."""

import numpy as np

from ...core import Floats, Ints
from .compile import part


@part
def push(keys: Floats, names: Ints, size: int, key: float, name: int) -> int:
    """Put a named key into the heap and return its size."""
    i = size
    while i > 0:
        parent = (i - 1) >> 1
        if keys[parent] < key or (keys[parent] == key and names[parent] < name):
            break
        keys[i] = keys[parent]
        names[i] = names[parent]
        i = parent
    keys[i] = key
    names[i] = name
    return size + 1


@part
def pop(keys: Floats, names: Ints, size: int) -> int:
    """Move the smallest entry behind the heap and return its size.

    The entry is then at the index of that size.
    """
    size -= 1
    min_key = keys[0]
    min_name = names[0]
    key = keys[size]
    name = names[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        right = child + 1
        if right < size and (
            keys[right] < keys[child]
            or (keys[right] == keys[child] and names[right] < names[child])
        ):
            child = right
        if key < keys[child] or (key == keys[child] and name < names[child]):
            break
        keys[i] = keys[child]
        names[i] = names[child]
        i = child
    keys[i] = key
    names[i] = name
    keys[size] = min_key
    names[size] = min_name
    return size


@part
def sorted_numbers(keys: Floats, size: int) -> Ints:
    """Sort the numbers of the first ``size`` keys by key.

    Equal keys are sorted by number. No key may be NaN.
    """
    heap_keys = np.empty(size)
    names = np.empty(size, np.int64)
    order = np.empty(size, np.int64)
    for i in range(size):
        push(heap_keys, names, i, keys[i], i)
    for i in range(size):
        order[i] = names[pop(heap_keys, names, size - i)]
    return order
