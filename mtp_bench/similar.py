"""Classes that nothing is known of, and the classes whose settings they take."""

import difflib
from collections.abc import Iterable

_VEHICLES = "car van truck bus trailer construction_vehicle tram vehicle forklift tractor cart minibus box_truck"
_TWO_WHEELS = "bicycle cyclist motorcycle scooter rider bike motorbike tricycle bicyclist motorcyclist"
_ALIKE = (  # the first of a row that is known stands for the others
    (*_VEHICLES.split(), "large_vehicle", "emergency_vehicle"),
    _TWO_WHEELS.split(),
    ("pedestrian", "person", "worker", "child", "adult", "people"),
)


def similar_class(name: str, known: Iterable[str]) -> str | None:
    """The class of ``known`` that is most like the class ``name``; None where the name looks misspelt.

    Itself, else one of its kind (vehicles, two wheels, people), else the first one.
    """
    names = tuple(known)
    if name in names:
        return name
    kind = next((row for row in _ALIKE if name.lower() in row), ())
    same = next((other for other in kind if other in names), None)
    if same is not None:
        return same
    misspelt = difflib.get_close_matches(name.lower(), [other.lower() for other in names], n=1, cutoff=0.7)
    return None if not names or misspelt else names[0]
