"""The one matching rule, by successive cheapest augmenting paths over exact integers."""

from collections.abc import Mapping

Keys = tuple[float, float, float]  # cost, confidence of the left one, minADE


def best_pairs(pairs: Mapping[tuple[int, int], Keys]) -> dict[int, int]:
    """Left -> right: most pairs, then the surest left ones, then the least cost, then the largest minADE.

    Only pairs inside the gate are given. Reading: sums of cost and minADE over the pairs are compared to the nanometre.
    """
    result: dict[int, int] = {}
    for part in _components(pairs):
        levels = sorted({confidence for _, confidence, _ in part.values()})
        # One forecast of a level outweighs any number of those below: sums compare like sorted lists of confidences.
        worth = {level: (len(part) + 1) ** i for i, level in enumerate(levels)}
        price = {pair: _price(worth[sure], cost, error) for pair, (cost, sure, error) in part.items()}
        result.update(_cheapest(price))
    return result


def _price(worth: int, cost: float, min_ade: float) -> int:
    """The three keys as the digits of one integer, to be summed and minimised."""
    return -(worth << 160) + (round(cost * 1e9) << 80) - round(min(min_ade, 1000.0) * 1e9)


def _components(pairs: Mapping[tuple[int, int], Keys]) -> list[dict[tuple[int, int], Keys]]:
    """The pairs, divided into those that can reach each other."""
    parts: list[tuple[set[int], set[int], dict[tuple[int, int], Keys]]] = []
    for (a, b), value in pairs.items():
        joined = ({a}, {b}, {(a, b): value})
        apart = []
        for part in parts:
            if a in part[0] or b in part[1]:
                joined = (joined[0] | part[0], joined[1] | part[1], joined[2] | part[2])
            else:
                apart.append(part)
        parts = [*apart, joined]
    return [part[2] for part in parts]


def _cheapest(price: dict[tuple[int, int], int]) -> dict[int, int]:
    """Of the largest matchings the cheapest: a cheapest augmenting path keeps the matching cheapest for its size."""
    lefts, rights = sorted({a for a, _ in price}), {b for _, b in price}
    right_of: dict[int, int] = {}
    while True:
        left_of = {b: a for a, b in right_of.items()}
        length: dict[int, int] = {a: 0 for a in lefts if a not in right_of}
        reached: dict[int, tuple[int, int]] = {}  # right -> length of the path, last left
        changed = True
        while changed:  # Bellman-Ford: walk out by any pair, back by a matched one
            changed = False
            for (a, b), value in price.items():
                if a in length and right_of.get(a) != b and (b not in reached or length[a] + value < reached[b][0]):
                    reached[b] = (length[a] + value, a)
                    changed = True
                    if b in left_of:
                        length[left_of[b]] = reached[b][0] - price[left_of[b], b]
        ends = [(reached[b][0], b) for b in rights if b in reached and b not in left_of]
        if not ends:
            return right_of
        b = min(ends)[1]
        while True:  # turn the path over
            a = reached[b][1]
            freed = right_of.get(a)
            right_of[a] = b
            if freed is None:
                break
            b = freed
