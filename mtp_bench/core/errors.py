"""Errors, checks of arrays that raise them, and names that are like a misspelt one.

Each error says what was got, what was expected, where, and what to do.
"""

import difflib
import re
import unicodedata
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


class MtpBenchError(Exception):
    """Base of every error that a user can cause.

    The command line prints it without a traceback.
    """


class CardError(MtpBenchError):
    """An environment card is missing, misspelt or inconsistent."""


class ActionError(MtpBenchError):
    """A strict env was given an action outside its action space."""


class DataError(MtpBenchError):
    """A data root, a file or a row of a dataset is missing or broken."""


class MissingDataError(DataError):
    """A data root or a file of a dataset is not there."""


class SubmissionError(MtpBenchError):
    """A submission folder cannot be loaded or its agent breaks the contract."""


class RolloutError(MtpBenchError):
    """A stored rollout is missing, incomplete or was made for another card."""


class RecordError(MtpBenchError):
    """A leaderboard record is missing, incomplete, changed or not comparable."""


class ShapeError(MtpBenchError, ValueError):
    """An array has another shape, type or content than its function needs."""


class UnknownNameError(MtpBenchError, KeyError):
    """A name that does not exist.

    The text suggests the nearest.
    """

    def __init__(
        self, kind: str, got: str, names: Iterable[str], hint: str = ""
    ) -> None:
        self.got = got
        names = tuple(names)
        self._arguments = (kind, got, names, hint)
        text = f"unknown {kind} {got!r}{nearest(got, names)}"
        if hint:
            text += f" ({hint})"
        super().__init__(text)

    def __reduce__(self) -> tuple[type["UnknownNameError"], tuple[Any, ...]]:
        return type(self), self._arguments  # for pickle, from a worker process

    def __str__(self) -> str:  # KeyError would show the repr of the text
        return str(self.args[0])


def require_known(
    kind: str, got: object, names: Collection[str], hint: str = ""
) -> None:
    """Raise UnknownNameError unless ``got``, a name of a ``kind``, is in ``names``."""
    if got not in names:
        raise UnknownNameError(kind, str(got), names, hint)


def describe_problem(got: str, expected: str, where: str, advice: str) -> str:
    """Join the parts of a message that are not empty.

    All of them give "<got>, expected <expected> (<where>); <advice>".
    """
    text = got
    if expected:
        text += f", expected {expected}"
    if where:
        text += f" ({where})"
    if advice:
        text += f"; {advice}"
    return text


_MAX_NAMES = 16  # listed in an error text


def nearest(got: str, names: Iterable[str]) -> str:
    """Return the end of a message: the nearest name, else all names."""
    names = sorted(names)
    similar = closest(got, names)
    if similar:
        return f": did you mean {similar!r}?"
    if not names:
        return ": none is known"
    text = ", ".join(names[:_MAX_NAMES])
    if len(names) > _MAX_NAMES:
        text += f" and {len(names) - _MAX_NAMES} more"
    return f": known are {text}"


def closest(got: object, names: Iterable[str], cutoff: float = 0.5) -> str:
    """Return the name most similar to the text of ``got``.

    Empty if each has a similarity below ``cutoff``, 0 to 1.
    """
    # names that differ by case alone are the same
    lower = {name.lower(): name for name in sorted(names)}
    matches = difflib.get_close_matches(str(got).lower(), lower, n=1, cutoff=cutoff)
    return lower[matches[0]] if matches else ""


def require_shape(
    name: str, array: NDArray[Any], shape: tuple[int | None, ...]
) -> None:
    """Raise ShapeError unless ``array`` has ``shape``.

    None stands for any length.
    """
    fits = array.ndim == len(shape) and all(
        n in (None, size) for n, size in zip(shape, array.shape, strict=True)
    )
    if not fits:
        expected = tuple("any" if n is None else n for n in shape)
        raise ShapeError(f"{name} has shape {array.shape}, expected {expected}")


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Raise ShapeError for an entry of ``array`` that is not finite."""
    places = np.argwhere(~np.isfinite(array))
    if len(places):
        index = tuple(places[0].tolist())
        raise ShapeError(
            f"{name}{list(index)} is {array[index]}, "
            f"expected a finite number ({len(places)} such)"
        )


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
_SAME_SPELLING = 0.7  # similarity of names that may be two spellings of one
_OTHER_SPELLING = 0.9  # similarity of names that are


def class_hint(name: str, names: Iterable[str]) -> str:
    """Return the words that name the class meant.

    ``names``: the classes that exist. Empty if none is similar. A vehicle of another
    kind is similar, but not the same: a truck that is called a car may be a mistake.
    """
    names = tuple(names)
    word = name.lower().rsplit(".", maxsplit=1)[-1]  # of "vehicle.car"
    same_kind = of_kind(word, names)
    same_spelling = closest(word, names, _SAME_SPELLING)
    is_vehicle = word in _VEHICLES.split()
    if same_kind is not None and not same_spelling and is_vehicle:
        return f"similar is {same_kind!r}"
    meant = same_spelling or same_kind
    return f"did you mean {meant!r}?" if meant else ""


def other_spelling(name: str, names: Collection[str]) -> str:
    """Return the class of ``names`` that ``name`` spells otherwise, empty if none.

    "vehicle.Cars" stands for "car", "motorcyclist" for no "motorcycle".
    """
    if name in names:
        return ""
    numbers = re.findall(r"\d+", name)
    plain_names = {
        _plain(each): each for each in names if re.findall(r"\d+", each) == numbers
    }
    meant_name = closest(_plain(name), plain_names, _OTHER_SPELLING)
    return plain_names[meant_name] if meant_name else ""


def _plain(name: str) -> str:
    """Return small letters and digits, without "vehicle." and the end of a plural."""
    word = unicodedata.normalize("NFKC", name).lower().strip(".")
    word = word.removeprefix("vehicle.").removeprefix("human.")
    return re.sub("(e?s)+$", "", "".join(filter(str.isalnum, word)))


def similar_class(name: str, names: Iterable[str]) -> str | None:
    """Return the class of ``names`` that is most like the class ``name``.

    It is the class itself, else one of its kind (vehicles, two wheels, people), else
    the first one. None where the name looks misspelt.
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
    """Return the one of ``names`` that is of the kind of the class ``name``.

    Of several it is the first in the order of `_KINDS`: vehicles, two wheels, people.
    """
    for kind in _KINDS:
        if name.lower() in kind:
            return next((word for word in kind if word in names), None)
    return None
