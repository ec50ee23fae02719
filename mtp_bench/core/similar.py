"""Classes without settings of their own, and those whose settings they take."""

from collections.abc import Collection, Iterable

from .errors import closest

_VEHICLES = """
    car van truck bus trailer construction_vehicle tram vehicle forklift tractor cart
    minibus box_truck large_vehicle emergency_vehicle
"""
_TWO_WHEELS = """
    bicycle cyclist motorcycle scooter rider bike motorbike tricycle bicyclist motorcyclist
"""
_PEOPLE = "pedestrian person worker child adult people"
# the first of a kind that has settings stands for the others
_KINDS = (_VEHICLES.split(), _TWO_WHEELS.split(), _PEOPLE.split())
_SAME_SPELLING = 0.7  # similarity of two spellings of one name


def class_hint(name: str, names: Iterable[str]) -> str:
    """Return the words that name the class meant.

    ``names``: the classes that exist. Empty if none is similar. A vehicle of another
    kind is similar, but not the same: a truck that is called a car may be a mistake.
    """
    names = tuple(names)
    word = name.lower().rsplit(".", maxsplit=1)[-1]  # of "vehicle.car"
    same_kind = of_kind(word, names)
    same_spelling = closest(word, names, _SAME_SPELLING)
    if same_kind is not None and not same_spelling and word in _KINDS[0]:
        return f"similar is {same_kind!r}"
    meant = same_spelling or same_kind
    return f"did you mean {meant!r}?" if meant else ""


def similar_class(name: str, names: Iterable[str]) -> str | None:
    """Return the class of ``names`` that is most like the class ``name``.

    If ``names`` has the class itself, it is returned; otherwise one of its kind
    (vehicles, two wheels, people); otherwise the first one. None where the name looks
    misspelt.
    """
    names = tuple(names)
    if name in names:
        return name
    same_kind = of_kind(name, names)
    if same_kind is not None:
        return same_kind
    if not names or closest(name, names, _SAME_SPELLING):
        return None
    return names[0]


def of_kind(name: str, names: Collection[str]) -> str | None:
    """Return the first of ``names`` of the kind of the class ``name``.

    Kinds are vehicles, two wheels and people.
    """
    for kind in _KINDS:
        if name.lower() in kind:
            return next((word for word in kind if word in names), None)
    return None
