"""Numbers in the order of their keys, equal keys in the order of the numbers: a binary heap and a merge sort."""

from __future__ import annotations

from ...types import Floats, Ints
from .arrays import ints, up_to
from .compile import kernel


@kernel
def push(keys: Floats, names: Ints, size: int, key: float, name: int) -> int:
    """Put ``key``, called ``name``, into the heap of ``size`` entries; its new size."""
    i = size
    while i > 0:
        above = (i - 1) >> 1
        if keys[above] < key or (keys[above] == key and names[above] < name):
            break
        keys[i], names[i] = keys[above], names[above]
        i = above
    keys[i], names[i] = key, name
    return size + 1


@kernel
def pop(keys: Floats, names: Ints, size: int) -> int:
    """Move the least entry behind the heap, to number ``size`` - 1; its new size, which is that number."""
    size -= 1
    least_key, least_name = keys[0], names[0]
    key, name = keys[size], names[size]
    i = 0
    while True:
        below = 2 * i + 1
        if below >= size:
            break
        right = below + 1
        if right < size and (keys[right] < keys[below] or (keys[right] == keys[below] and names[right] < names[below])):
            below = right
        if key < keys[below] or (key == keys[below] and name < names[below]):
            break
        keys[i], names[i] = keys[below], names[below]
        i = below
    keys[i], names[i] = key, name
    keys[size], names[size] = least_key, least_name
    return size


@kernel
def sorted_numbers(keys: Floats) -> Ints:
    """Numbers of the keys, least first."""
    size, width = len(keys), 16
    order, spare = up_to(size), ints(size)
    for i in range(1, size):
        j = i
        while j % width > 0 and keys[order[j - 1]] > keys[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    while width < size:
        for low in range(0, size, 2 * width):
            a, b, high = low, min(low + width, size), min(low + 2 * width, size)
            middle = b
            for i in range(low, high):
                if a < middle and (b >= high or keys[order[a]] <= keys[order[b]]):
                    spare[i] = order[a]
                    a += 1
                else:
                    spare[i] = order[b]
                    b += 1
        order, spare = spare, order
        width *= 2
    return order
