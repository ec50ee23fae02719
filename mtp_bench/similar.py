"""Classes that nothing is known of, and the classes whose settings they take."""

from __future__ import annotations

from collections.abc import Iterable

from .errors import closest

_ALIKE = (  # the first of a row that is known stands for the others
    ("car", "van", "truck", "bus", "trailer", "construction_vehicle", "tram", "vehicle", "forklift", "tractor"),
    ("bicycle", "cyclist", "motorcycle", "scooter", "rider"),
    ("pedestrian", "person", "worker", "child"),
)


def similar_class(name: str, known: Iterable[str]) -> str | None:
    """The class of ``known`` that is most like the class ``name``; None where the name looks misspelt.

    Itself, else one of its kind (vehicles, two wheels, people), else the first one.
    """
    names = tuple(known)
    if name in names:
        return name
    kind = next((row for row in _ALIKE if name in row), ())
    same = next((other for other in kind if other in names), None)
    if same is not None:
        return same
    return None if not names or closest(name, names) else names[0]
