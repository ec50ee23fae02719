"""Classes that nothing is known of, and the classes whose settings they take."""

from collections.abc import Collection, Iterable

from .errors import closest

_VEHICLES = "car van truck bus trailer construction_vehicle tram vehicle forklift tractor cart minibus box_truck"
_TWO_WHEELS = "bicycle cyclist motorcycle scooter rider bike motorbike tricycle bicyclist motorcyclist"
_ALIKE = (  # the first of a row that is known stands for the others
    (*_VEHICLES.split(), "large_vehicle", "emergency_vehicle"),
    _TWO_WHEELS.split(),
    ("pedestrian", "person", "worker", "child", "adult", "people"),
)
_SPELT = 0.7  # similarity of two spellings of one name


def class_hint(name: str, known: Iterable[str]) -> str:
    """The part of a message about a class that is not ``known`` which names the one that may be meant; empty if none.

    A vehicle of another kind is similar, but not the same: a truck that is called a car may be a mistake.
    """
    names, word = (
        tuple(known),
        name.lower().rsplit(".", maxsplit=1)[-1],
    )  # of "vehicle.car"
    other, spelt = of_kind(word, names), closest(word, names, _SPELT)
    if other is not None and not spelt and word in _ALIKE[0]:
        return f"similar is {other!r}"
    meant = spelt or other
    return f"did you mean {meant!r}?" if meant else ""


def similar_class(name: str, known: Iterable[str]) -> str | None:
    """The class of ``known`` that is most like the class ``name``; None where the name looks misspelt.

    Itself, else one of its kind (vehicles, two wheels, people), else the first one.
    """
    names = tuple(known)
    same = name if name in names else of_kind(name, names)
    return (
        same
        if same is not None or not names or closest(name, names, _SPELT)
        else names[0]
    )


def of_kind(name: str, names: Collection[str]) -> str | None:
    """The first class of the kind of ``name`` (vehicles, two wheels, people) that is among ``names``."""
    kind = next((row for row in _ALIKE if name.lower() in row), ())
    return next((other for other in kind if other in names), None)
