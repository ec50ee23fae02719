"""Errors, and checks of arrays that raise them. Each says what was got, what was expected, where, and what to do."""

import difflib
from collections.abc import Collection, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


class MtpBenchError(Exception):
    """Base of every error that a user can cause; the command line prints it without a traceback."""


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
    """A leaderboard record is missing, incomplete, was changed or cannot be compared with another."""


class ShapeError(MtpBenchError, ValueError):
    """An array has another shape, type or content than its function needs."""


class UnknownNameError(MtpBenchError, KeyError):
    """A name that is not among the known ones; the text suggests the nearest."""

    def __init__(
        self, kind: str, got: str, known: Iterable[str], hint: str = ""
    ) -> None:
        self.got = got
        known = tuple(known)
        self._given = (kind, got, known, hint)
        super().__init__(
            f"unknown {kind} {got!r}{nearest(got, known)}"
            + (f" ({hint})" if hint else "")
        )

    def __reduce__(
        self,
    ) -> tuple[type["UnknownNameError"], tuple[str, str, tuple[str, ...], str]]:
        return type(self), self._given  # workers send their errors home

    def __str__(self) -> str:  # KeyError would show the repr of the text
        return str(self.args[0])


def require_known(
    kind: str, got: object, known: Collection[str], hint: str = ""
) -> None:
    """Raise UnknownNameError unless ``got``, the name of a ``kind``, is one of ``known``."""
    if got not in known:
        raise UnknownNameError(kind, str(got), known, hint)


def describe_problem(got: str, expected: str, where: str, advice: str) -> str:
    """The text "<got>, expected <expected> (<where>); <advice>"; empty parts are left out."""
    wanted = f", expected {expected}" if expected else ""
    place = f" ({where})" if where else ""
    return f"{got}{wanted}{place}" + (f"; {advice}" if advice else "")


MOST_NAMES = 16  # listed in an error text


def nearest(got: str, known: Iterable[str]) -> str:
    """The part of an error text that names the nearest known name, else all of them."""
    names = sorted(known)
    close = closest(got, names)
    if close:
        return f": did you mean {close!r}?"
    shown = ", ".join(names[:MOST_NAMES]) + (
        f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    )
    return f": known are {shown}" if names else ": none is known"


def closest(got: object, known: Iterable[str], cutoff: float = 0.5) -> str:
    """The known name most similar to the text of ``got``; empty without one that is similar by ``cutoff``, 0 to 1."""
    lower = {
        name.lower(): name for name in sorted(known)
    }  # names that differ by case alone are the same
    close = difflib.get_close_matches(str(got).lower(), lower, n=1, cutoff=cutoff)
    return lower[close[0]] if close else ""


def require_shape(
    name: str, array: NDArray[Any], shape: tuple[int | None, ...]
) -> None:
    """Raise ShapeError unless ``array`` has ``shape``; None stands for any length."""
    if array.ndim != len(shape) or any(
        n not in (None, size) for n, size in zip(shape, array.shape, strict=True)
    ):
        want = tuple("any" if n is None else n for n in shape)
        raise ShapeError(f"{name} has shape {array.shape}, expected {want}")


def require_finite(name: str, array: NDArray[Any]) -> None:
    """Raise ShapeError naming the first entry of ``array`` that is NaN or infinite."""
    bad = ~np.isfinite(array)
    if bad.any():
        index = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ShapeError(
            f"{name}{list(index)} is {array[index]}, expected a finite number ({int(bad.sum())} such)"
        )
